"""From a latent code to all vertices within a frame.

Single precision. Vertices are in the order of the Laplacian's elimination, so that neighbours are
near in memory and nothing is permuted between decoding and solving. The decoder's matrix is
kept by blocks of 16 vertices, 16 bit a number, without the components that do not reach a block.
"""

from __future__ import annotations

import copy
from concurrent.futures import Future

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.editing.kernels import (
    BLOCK,
    MATRICES,
    VECTORS,
    add_green_functions,
    coefficients_by_block,
    decode_to_positions,
    fit_rotations,
    gradients_and_positions,
    rhs,
    to_user_order,
)
from deformer.geometry import FloatArray, IntArray
from deformer.linalg import CORES, over_ranges, ranges, run_calls, start_calls, wait_for
from deformer.network import Decoder

# Blocks below which a second thread does not pay.
_SHARE = 128


def schur_inverse(block: FloatArray) -> FloatArray:
    """Inverse of [G_hh 1; 1ᵀ 0] (H+1, H+1) for the block G_hh (H, H) of the handles' rows.

    [μ; t] = inverse [q − p_h; 0] makes p + Gᵀμ + t the smallest change of p, in the energy whose
    Green's functions G are, that meets the targets q: the Schur complement of the constrained
    system with free translation. Where targets cannot all be met (coincident vertices) it is the
    nearest.
    """
    H = len(block)
    system = np.ones((H + 1, H + 1))
    system[:H, :H] = block
    system[H, H] = 0.0
    return np.asarray(np.linalg.pinv(system, rcond=1e-13), dtype=np.float64)


class DecodedSurface:
    """All vertices of a model: decoded, solved for, and moved onto exact handles rigidly.

    The rest shape x is the reconstruction from the gradients T of a latent code. Exact handles
    deform it as rigidly as possible (Sorkine and Alexa 2007): every vertex has a rotation R_i,
    fitted to its edges and kept from frame to frame. The global step solves L p = e with
    e_i = Σ_j ½ c_ij (R_i + R_j)(x_i − x_j), and moves p by a sum of the handles' rows so that exact
    handles are at their targets. Green's functions of L as rows keep the edges best; the smoother
    `PoissonSystem.bending_rows` keep the bends, and handles leave no spikes.

    Args:
        decoder: of all vertices.
        system: the Poisson system of the same mesh.
    """

    def __init__(self, decoder: Decoder, system: PoissonSystem) -> None:
        """Copy the decoder's matrix and the mesh into the order of elimination."""
        self._decoder, self._system = decoder, system
        self._factor = system.factor
        order = self._factor.order
        V = len(order)
        self._blocks = -(-V // BLOCK)
        # The last block is filled up with its last vertex.
        self._padded: IntArray = np.concatenate(
            [order, np.full(self._blocks * BLOCK - V, order[-1])]
        )
        # Bounding diagonals are the unit of length: single precision has its range, too.
        self._unit = system.reference.bounding_diagonal
        weights = sparse.csr_array(system.weights[order][:, order])
        weights.sort_indices()
        self._indptr = weights.indptr.astype(np.int64)
        self._rings = weights.indices.astype(np.int32)
        self._halves = (0.5 * weights.data).astype(np.float32)
        v = (system.reference.vertices[order] - system.centroid) / self._unit
        self._reference = v.astype(np.float32).ravel()
        self._store_decoder(decoder)
        self._T = np.zeros(9 * len(self._padded), dtype=np.float32)
        self._x = np.zeros((V, 3), dtype=np.float32)
        self._rest = np.zeros((V, 3), dtype=np.float32)
        self._rested = False
        self._reset_rotations()
        self._relaxing: list[Future[None]] = []
        self._handles: IntArray = np.empty(0, dtype=np.int64)
        self._coefficients = np.empty((self._blocks, 0, VECTORS), dtype=np.float32)
        self._exact: IntArray = np.empty(0, dtype=np.int64)
        self._green = np.empty((0, V), dtype=np.float32)
        self._exact_inverse = np.zeros((1, 1))

    def copy(self) -> DecodedSurface:
        """A surface of the same model and handles with gradients and positions of its own."""
        other = copy.copy(self)
        other._T, other._x, other._rest = self._T.copy(), self._x.copy(), self._rest.copy()
        other._reset_rotations()
        other._relaxing = []
        other._exact, other._green = self._exact[:0], self._green[:0]
        return other

    def _store_decoder(self, decoder: Decoder) -> None:
        """Store the decoder's matrix by blocks, in 16 bit, without components that are zero."""
        K = decoder.components
        self._gain = np.repeat(decoder.gain, BLOCK).astype(np.float32)
        self._offset = np.repeat(decoder.offset, BLOCK).astype(np.float32)
        if not decoder.pointwise:
            return
        self._base = np.repeat(decoder.base, BLOCK).astype(np.float32)
        rows, scales, counts, components = [], [], [], []
        for start in range(0, self._blocks, 64):
            index = self._padded[start * BLOCK : (start + 64) * BLOCK]
            part = decoder.matrix[index].reshape(-1, BLOCK, 9, K).transpose(0, 3, 2, 1)
            part = part.reshape(-1, K, MATRICES)
            largest = np.abs(part).max(axis=2)
            used = largest > 0
            scale = largest[used] / 32767.0
            rows.append(np.rint(part[used] / scale[:, None]).astype(np.int16))
            scales.append(scale.astype(np.float32))
            counts.append(used.sum(axis=1))
            components.append(np.nonzero(used)[1].astype(np.int32))
        self._matrix, self._scale = np.concatenate(rows), np.concatenate(scales)
        self._components = np.concatenate(components)
        self._slices = np.concatenate([[0], np.cumsum(np.concatenate(counts))])

    def block_coefficients(self, coefficients: FloatArray) -> NDArray:
        """`PoissonSystem.position_coefficients` (V, 3) of one handle, by blocks (·, 48) float32."""
        blocks = np.empty((self._blocks, VECTORS), dtype=np.float32)
        over_ranges(
            coefficients_by_block,
            self._blocks,
            self._factor.order,
            coefficients,
            1.0 / self._unit,
            blocks,
        )
        return blocks

    def set_handles_by_block(self, vertices: IntArray, blocked: list[NDArray]) -> None:
        """Set the handles (H,), by `block_coefficients`, whose positions `decode` returns."""
        self._coefficients = _with_room(self._coefficients, 1, len(vertices), len(self._handles))
        for h in _changed(self._handles, vertices):
            self._coefficients[:, h] = blocked[h]
        self._handles = vertices

    def set_exact(self, vertices: IntArray, rows: list[NDArray], block: FloatArray) -> None:
        """Set the exact vertices (H,), which `move_to_targets` moves to targets.

        Args:
            vertices: (H,).
            rows: by which they move the rest, by `ordered`.
            block: (H, H) of these rows at the vertices, in double precision: rows of vertices
                side by side hardly differ.
        """
        changed = _changed(self._exact, vertices)
        if not changed and len(vertices) == len(self._exact):
            return
        self._green = _with_room(self._green, 0, len(vertices), len(self._exact))
        for h in changed:
            self._green[h] = rows[h]
        self._exact = vertices
        self._exact_inverse = schur_inverse(block)

    def ordered(self, green: FloatArray) -> NDArray:
        """A Green row (V,) in the order of elimination, single precision."""
        return green[self._factor.order].astype(np.float32)

    @property
    def gradients(self) -> NDArray:
        """Deformation gradients T (V, 3, 3) float32 of the last decoded code, in user order."""
        return self._T.reshape(-1, 3, 3)[self._factor.inverse_order]

    @property
    def inverse_order(self) -> IntArray:
        """Index of each vertex (V,) in the order of elimination."""
        return self._factor.inverse_order

    def reset(self) -> None:
        """Set all rotations to the identity."""
        self._wait()
        self._reset_rotations()

    def _reset_rotations(self) -> None:
        """Set all rotations to the identity: quaternions by blocks, and their matrices."""
        self._turned = False
        still = np.repeat(np.array([1, 0, 0, 0], dtype=np.float32), BLOCK)
        self._turn = np.tile(still, self._blocks)
        self._R = np.tile(np.eye(3, dtype=np.float32).ravel(), len(self._padded))

    def decode(self, z: FloatArray) -> FloatArray:
        """Gradients of a latent code (K,); handle positions (H, 3) of its rest shape.

        The positions are those of the free reconstruction, relative to its centroid.
        """
        self._rested = False
        pieces = ranges(self._blocks, _SHARE)
        sums = np.zeros((len(pieces), VECTORS * len(self._handles)))
        frame = self._coefficients.ravel(), self._T
        if self._decoder.pointwise:
            code = z.astype(np.float32)
            layer = self._slices, self._components, self._scale, self._matrix
            layer = *layer, code, self._base, self._gain, self._offset
            calls = [(*p, layer, *frame, s) for p, s in zip(pieces, sums, strict=True)]
            run_calls(decode_to_positions, calls)
        else:
            q = self._decoder.single_features(z)[self._padded].astype(np.float32)
            q = np.ascontiguousarray(q.reshape(-1, BLOCK, 9).transpose(0, 2, 1))
            q = q.reshape(-1, MATRICES)
            calls = [(a, b, q[a:b], *frame, s) for (a, b), s in zip(pieces, sums, strict=True)]
            run_calls(gradients_and_positions, calls)
        return self._unit * sums.sum(axis=0).reshape(-1, 3, BLOCK).sum(axis=2)

    def write_rhs(self) -> None:
        """Write the right-hand side into the positions: of the gradients, or of the rotations."""
        self._wait()
        mesh = self._indptr, self._rings, self._halves
        shape = (self._rest.ravel(), self._R) if self._rested else (self._reference, self._T)
        over_ranges(rhs, len(self._x), *mesh, *shape, self._x.ravel())

    def solve(self) -> None:
        """Positions from the gradients and rotations, up to a translation."""
        if not self._rested:
            self._solve_sums()
            self._rest, self._x = self._x, self._rest
            self._rested = True
        if self._turned:
            self._solve_sums()
        else:
            self._x[:] = self._rest

    def _solve_sums(self) -> None:
        self.write_rhs()
        self._factor.solve_in_order(self._x)

    def move_to_targets(self, targets: FloatArray) -> None:
        """Move the positions by the smallest change that brings exact handles to targets (H, 3).

        See `schur_inverse`. Without exact handles the centroid goes to the origin.
        """
        H = len(self._exact)
        if H == 0:
            push, shift = np.zeros((0, 3)), -self._x.mean(axis=0, dtype=np.float64)
        else:
            misfit = np.zeros((H + 1, 3))
            misfit[:H] = targets / self._unit - self._x[self._factor.inverse_order[self._exact]]
            solution = self._exact_inverse @ misfit
            push, shift = solution[:H], solution[H]
        change = self._green, push.astype(np.float32), shift.astype(np.float32)
        over_ranges(add_green_functions, len(self._x), *change, self._x)

    def positions(self, rotation: FloatArray, origin: FloatArray) -> FloatArray:
        """Positions (V, 3) in the user's order, turned by `rotation` and moved to `origin`."""
        out = np.empty((len(self._x), 3))
        where = self._unit * rotation, origin, self._x, out
        over_ranges(to_user_order, len(out), self._factor.order, *where)
        return out

    def relax(self, steps: int) -> None:
        """Local step: fit the rotations, vertex by vertex, to the edges of the positions.

        It goes on after the call returns; whatever needs it waits.
        """
        mesh = self._indptr, self._rings, self._halves
        shapes = self._rest.ravel(), self._x.ravel()
        rest = *mesh, *shapes, self._R, self._turn, steps
        self._turned = True
        # One core is left to the caller.
        share = max(_SHARE, -(-self._blocks // max(1, CORES - 1)))
        calls = [(*piece, *rest) for piece in ranges(self._blocks, share)]
        self._relaxing = start_calls(fit_rotations, calls)

    def _wait(self) -> None:
        wait_for(self._relaxing)
        self._relaxing = []

    @property
    def bytes_of_a_frame(self) -> int:
        """Bytes that a frame reads and writes: matrix, coefficients, mesh, factor, result."""
        arrays = [self._coefficients[:, : len(self._handles)], self._green[: len(self._exact)]]
        arrays += [self._rings, self._halves, self._reference, self._T]
        if len(self._exact):
            arrays += [self._rings, self._halves, self._rest, self._R, self._turn]
        if self._decoder.pointwise:
            arrays += [self._matrix, self._scale]
        out = 8 * 3 * len(self._x)
        return sum(a.nbytes for a in arrays) + self._factor.bytes_per_solve + out


def _changed(before: IntArray, now: IntArray) -> list[int]:
    """Indices at which the vertex differs from before."""
    return [h for h, v in enumerate(now.tolist()) if h >= len(before) or before[h] != v]


def _with_room(array: NDArray, axis: int, count: int, used: int) -> NDArray:
    """The array itself, or a larger one with its first `used` entries, if `count` do not fit."""
    if array.shape[axis] >= count:
        return array
    shape = list(array.shape)
    shape[axis] = max(count, 2 * array.shape[axis])
    larger = np.empty(shape, dtype=array.dtype)
    kept = (slice(None),) * axis + (slice(used),)
    larger[kept] = array[kept]
    return larger
