"""Components as named shape keys with in-betweens, and a clip that sweeps each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deformer.analysis.synthesis import Synthesis
from deformer.animation import Clip, morph_glb
from deformer.checks import checked_flag, checked_instance, checked_number
from deformer.documents import upright_glb
from deformer.geometry import FloatArray
from deformer.io import atomic_path
from deformer.model import DeformationModel

# Numbers of straight pieces between weight 0 and ±1, and weights at which they are compared.
_PIECES = (1, 2, 3, 4, 6, 8, 12)
_COMPARED = 24
_SECONDS = 4.0  # of the clip of a component


@dataclass(frozen=True, eq=False)
class ComponentKeys:
    """Shapes of components at weights from −1 to 1, which follow their curved paths.

    Args:
        model: the prior.
        names: T names of the keys, such as "nod +0.5".
        targets: (T, V, 3) displacements from the reference in single precision.
        components: (T,) component of each key.
        weights: (T,) weight of its component.
        errors: by component, the largest distance of a vertex, on the straight way from key to key,
            from its place on the path, as a share of the reference's diagonal.
    """

    model: DeformationModel
    names: tuple[str, ...]
    targets: np.ndarray
    components: tuple[int, ...]
    weights: tuple[float, ...]
    errors: dict[int, float]

    def glb(self, bare: bool = False) -> bytes:
        """A GLB file with the reference, the keys as morph targets, and a clip for each component.

        A clip goes from 0 to 1, to −1 and back to 0, from key to key in straight lines. The file
        has what the model's document has beside positions and triangles.

        Args:
            bare: write positions and triangles alone.
        """
        checked_flag(bare, "bare")
        model, faces = self.model, self.model.reference.faces
        clips = [self._clip(k) for k in self.errors]
        document = None if bare else model.document
        base = model.decode(Synthesis(model).start)
        data = morph_glb(base, faces, self.targets, self.names, clips, document, "model")
        return upright_glb(data, model.up, document)

    def save(self, path: str | Path, bare: bool = False) -> None:
        """Write `glb` to a file; an existing one is replaced once all is written.

        Args:
            path: the file.
            bare: as of `glb`.

        Raises:
            InputError: the directory is missing or not writable.
        """
        data = self.glb(bare)
        with atomic_path(path) as temporary:
            temporary.write_bytes(data)

    def _clip(self, component: int) -> Clip:
        own = {w: t for t, (k, w) in enumerate(zip(self.components, self.weights, strict=True))
               if k == component}  # fmt: skip
        knots = sorted({0.0, *own})
        middle = knots.index(0.0)
        back = knots[::-1]
        way = [*knots[middle:], *back[1:], *knots[1 : middle + 1]]
        weights = np.zeros((len(way), len(self.names)))
        for n, w in enumerate(way):
            if w != 0.0:
                weights[n, own[w]] = 1.0
        # As fast everywhere: from 0 to 1, to −1 and to 0 the weight goes 4 units.
        times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way)))]) / 4.0 * _SECONDS
        return Clip(self.model.label(component), times, weights)


def component_keys(
    model: DeformationModel,
    components: Sequence[int | str] | None = None,
    tolerance: float = 1e-3,
) -> ComponentKeys:
    """Shape keys of components, each driven from −1 to 1.

    The path of a vertex is curved, and mixtures of shape keys are straight: a component has as many
    keys on each side of 0, at weights of equal distance, as the tolerance needs, but at most 12.

    Args:
        model: the prior.
        components: which of them, by index or name; None is all.
        tolerance: largest distance of a vertex from its place on the path, as a share of the
            reference's bounding-box diagonal.

    Raises:
        InputError: no such component, or a negative tolerance.
    """
    checked_instance(model, "model", DeformationModel, remedy="load or train one")
    allowed = checked_number(tolerance, "tolerance", least=0)
    given = range(model.components) if components is None else components
    checked_instance(given, "components", Sequence, remedy="give a list of indices or names")
    chosen = dict.fromkeys(model.component(k) for k in given)
    synthesis = Synthesis(model)
    rest = model.decode(synthesis.start)
    size = model.reference.bounding_diagonal or 1.0
    names: list[str] = []
    targets: list[np.ndarray] = []
    owners: list[int] = []
    weights: list[float] = []
    errors: dict[int, float] = {}
    for k in chosen:
        errors[k] = 0.0
        for side in (-1.0, 1.0):
            grid = side * np.arange(1, _COMPARED + 1) / _COMPARED
            path = np.concatenate([rest[None], synthesis.sweep(k, grid)])
            pieces, error = _fewest(path, allowed * size)
            errors[k] = max(errors[k], error / size)
            for n in range(1, pieces + 1):
                w = side * n / pieces
                owners.append(k)
                weights.append(w)
                names.append(f"{model.label(k)} {w:+.3g}")
                shape = path[n * _COMPARED // pieces]
                targets.append((shape - rest).astype(np.float32))
    V = len(model.reference.vertices)
    shapes = np.array(targets, np.float32).reshape(-1, V, 3)
    return ComponentKeys(model, tuple(names), shapes, tuple(owners), tuple(weights), errors)


def _fewest(path: FloatArray, tolerance: float) -> tuple[int, float]:
    """Fewest straight pieces that keep a path (n + 1, V, 3) to a tolerance, and their error."""
    error = np.inf
    for pieces in _PIECES:
        knots = path[:: _COMPARED // pieces]
        t = np.linspace(0, pieces, len(path))
        low = np.minimum(t.astype(int), pieces - 1)
        share = (t - low)[:, None, None]
        straight = (1 - share) * knots[low] + share * knots[low + 1]
        error = float(np.linalg.norm(straight - path, axis=2).max())
        if error <= tolerance:
            return pieces, error
    return _PIECES[-1], error
