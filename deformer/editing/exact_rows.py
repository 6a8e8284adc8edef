"""Rows by which loads at exact handles move the vertices of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer.geometry import FloatArray, IntArray


def schur_inverse(block: FloatArray) -> FloatArray:
    """Inverse of the Schur complement [G_hh 1; 1ᵀ 0] of a system constrained at handles.

    With [μ; t] = inverse [q − p_h; 0], the positions p + Gᵀμ + t have the handles at the targets q
    and change p least, measured by the energy whose Green's functions are the rows of G; the
    translation t is free. If targets exclude each other (coincident vertices), the handles come as
    near to them as possible.

    Args:
        block: G_hh (H, H), entries of the rows of H handles at these handles.

    Returns:
        The pseudoinverse (H+1, H+1), float64.
    """
    H = len(block)
    system = np.ones((H + 1, H + 1))
    system[:H, :H] = block
    system[H, H] = 0.0
    return np.asarray(np.linalg.pinv(system, rcond=1e-13), dtype=np.float64)


class ExactRows:
    """Rows of H exact handles, in the order in which a surface stores its V vertices.

    Args:
        count: V.

    Attributes:
        index: (H,) places of the handles' vertices in that order; or (H, m) of vertices whose
            weighted means the handles are.
        weights: (H, m) with sums of 1; None if the handles are vertices.
    """

    def __init__(self, count: int) -> None:
        """Start without handles."""
        self._rows: list[NDArray] = []
        self._room = np.empty((0, count), dtype=np.float32)
        self.index: IntArray = np.empty(0, dtype=np.int64)
        self.weights: FloatArray | None = None
        self._inverse = np.zeros((1, 1))

    def __len__(self) -> int:
        """Count the handles."""
        return len(self._rows)

    @property
    def values(self) -> NDArray:
        """The rows (H, V), float32."""
        return self._room[: len(self._rows)]

    def set(
        self,
        index: IntArray,
        rows: list[NDArray],
        block: FloatArray,
        weights: FloatArray | None = None,
    ) -> None:
        """Replace the handles.

        Args:
            index, weights: as the attributes.
            rows: (V,) float32 each; the same array again costs nothing.
            block: (H, H) entries of the rows at the handles, in double precision: the rows of
                neighbouring vertices hardly differ.
        """
        changed = changed_arrays(self._rows, rows)
        if not changed and len(rows) == len(self._rows):
            return
        self._room = with_room(self._room, 0, len(rows), len(self._rows))
        for h in changed:
            self._room[h] = rows[h]
        self._rows, self.index, self.weights = rows, index, weights
        self._inverse = schur_inverse(block)

    def means(self, corners: NDArray) -> NDArray:
        """The handles' positions (H, 3), of those of `index`: (H, 3) or (H, m, 3)."""
        if self.weights is None:
            return corners
        return np.einsum("hm,hmc->hc", self.weights, corners)

    def loads(self, misfit: FloatArray) -> tuple[NDArray, NDArray]:
        """Loads (H, 3) of the handles and a translation (3,), float32, that move them by `misfit`.

        Args:
            misfit: (H, 3).
        """
        H = len(self)
        solution = self._inverse @ np.vstack([misfit, np.zeros((1, 3))])
        return solution[:H].astype(np.float32), solution[H].astype(np.float32)


def changed_arrays(before: list[NDArray], now: list[NDArray]) -> list[int]:
    """Indices h at which now[h] is not before[h], or beyond the end of `before`."""
    return [h for h, row in enumerate(now) if h >= len(before) or before[h] is not row]


def with_room(array: NDArray, axis: int, count: int, used: int) -> NDArray:
    """The array if it has room for `count` entries along an axis, else a larger copy.

    The first `used` entries are copied; the size at least doubles.
    """
    if array.shape[axis] >= count:
        return array
    shape = list(array.shape)
    shape[axis] = max(count, 2 * array.shape[axis])
    larger = np.empty(shape, dtype=array.dtype)
    kept = (slice(None),) * axis + (slice(used),)
    larger[kept] = array[kept]
    return larger
