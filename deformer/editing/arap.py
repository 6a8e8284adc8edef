"""All vertices of a latent code, fast enough for each frame of a drag.

Arrays are in single precision. Vertices are in the order in which the Laplacian's factor eliminates
them: neighbours are near in memory, and nothing is permuted between decoding and solving. The
decoder's matrix is stored by blocks of 16 vertices, 16 bits a number, without the components that
do not reach a block.
"""

from __future__ import annotations

import copy
from concurrent.futures import Future

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.editing.exact_rows import ExactRows, changed_arrays, with_room
from deformer.editing.kernels import (
    BLOCK,
    MATRICES,
    OVER_RELAXATION,
    VECTORS,
    add_green_functions,
    coefficients_by_block,
    decode_to_positions,
    fit_rotations,
    gradients_and_positions,
    rhs,
    to_user_order,
)
from deformer.editing.lift_kernels import node_frames
from deformer.editing.momentum import Momentum
from deformer.editing.nodes import NodeSystem
from deformer.geometry import FloatArray, IntArray
from deformer.linalg import CORES, over_ranges, ranges, run_calls, start_calls, wait_for
from deformer.network import Decoder

# Fewest blocks for a thread: a smaller share costs more to start than it saves.
_SHARE = 128


class DecodedSurface:
    """Decodes a latent code to all vertices, and deforms that shape to reach exact handles.

    The rest shape x is the reconstruction from the gradients T of a latent code. Exact handles
    deform it as rigidly as possible (Sorkine and Alexa, As-Rigid-As-Possible Surface Modeling,
    2007, equations 8 and 9): every vertex has a rotation R_i, which the local step fits to its
    edges, and which stays from frame to frame. The global step solves L p = e with
    e_i = Σ_j ½ c_ij (R_i + R_j)(x_i − x_j), then adds to p a sum of rows, one an exact handle, that
    brings the handles to their targets. Green's functions of L as rows change the edges least; the
    smoother `PoissonSystem.bending_rows` change the bends least, and handles leave no spikes.

    Args:
        decoder: the model's decoder of all sites: V vertices, then B links.
        system: the Poisson system of the same vertices.

    Attributes:
        exact: rows of the exact handles.
        order: (V,) the vertices in the order of elimination.
        reference: (3 V,) the reference in that order, centroid at the origin, in the unit.
        unit: of length, the bounding diagonal.
        has_rotations: false if all rotations are the identity.
    """

    def __init__(self, decoder: Decoder, system: PoissonSystem | NodeSystem) -> None:
        """Copy the decoder's matrix and the mesh into the order of elimination."""
        self._decoder, self._system = decoder, system
        self._factor = system.factor
        self.order = order = self._factor.order
        links = system.reference.links
        V, B = len(order), len(links)
        # Sites: the vertices in the order of elimination, then the links.
        self._sites: IntArray = np.append(order, np.arange(V, V + B))
        self._blocks, self._vertex_blocks = -(-(V + B) // BLOCK), -(-V // BLOCK)
        # The last site is repeated to fill the last block.
        self._padded: IntArray = np.concatenate(
            [self._sites, np.full(self._blocks * BLOCK - V - B, self._sites[-1])]
        )
        self._links = self._factor.inverse_order[links]
        # Lengths are in bounding diagonals, so that no unit of the data leaves single precision.
        self.unit = system.reference.bounding_diagonal
        weights = sparse.csr_array(system.weights[order][:, order])
        weights.sort_indices()
        self._indptr = weights.indptr.astype(np.int64)
        self._rings = weights.indices.astype(np.int32)
        self._half_weights = (0.5 * weights.data).astype(np.float32)
        v = (system.reference.vertices[order] - system.centroid) / self.unit
        self.reference = v.astype(np.float32).ravel()
        self._store_decoder(decoder)
        self._T = np.zeros(9 * len(self._padded), dtype=np.float32)
        self._x = np.zeros((V, 3), dtype=np.float32)
        self._rest = np.zeros((V, 3), dtype=np.float32)
        self._has_rest_shape = False
        self._reset_rotations()
        self._running: list[Future[None]] = []
        self._handles: list[NDArray] = []
        self._coefficients = np.empty((self._blocks, 0, VECTORS), dtype=np.float32)
        self.exact = ExactRows(V)

    def copy(self) -> DecodedSurface:
        """A surface of the same model and handles, with its own gradients and positions.

        It has no exact handles, and its rotations are the identity.
        """
        other = copy.copy(self)
        other._T, other._x, other._rest = self._T.copy(), self._x.copy(), self._rest.copy()
        other._reset_rotations()
        other._running = []
        other.exact = ExactRows(len(self._x))
        return other

    def _store_decoder(self, decoder: Decoder) -> None:
        """Store the decoder's matrix by blocks, 16 bits a number, without zero components."""
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
        """Coefficients of one handle's position in the layout that `decode` reads.

        Args:
            coefficients: (V+B, 3) of one handle, from `PoissonSystem.position_coefficients`.

        Returns:
            (b, 48) float32, a row for each of b blocks of sites.
        """
        blocks = np.empty((self._blocks, VECTORS), dtype=np.float32)
        over_ranges(
            coefficients_by_block,
            self._blocks,
            self._sites,
            coefficients,
            1.0 / self.unit,
            blocks,
        )
        return blocks

    def set_handles_by_block(self, blocked: list[NDArray]) -> None:
        """Set the handles whose positions `decode` returns.

        Args:
            blocked: `block_coefficients` of each; the same array again costs nothing.
        """
        self._coefficients = with_room(self._coefficients, 1, len(blocked), len(self._handles))
        for h in changed_arrays(self._handles, blocked):
            self._coefficients[:, h] = blocked[h]
        self._handles = blocked

    def set_exact(
        self,
        vertices: IntArray,
        rows: list[NDArray],
        block: FloatArray,
        weights: FloatArray | None = None,
    ) -> None:
        """Set the exact handles, which `move_to_targets` moves to targets.

        Args:
            vertices: (H,) int64; or (H, m) vertices whose weighted means the handles are.
            rows: how a unit load at each handle moves all vertices: (V,) each, from `ordered`; the
                same array again costs nothing.
            block: (H, H) entries of the rows at the handles, in double precision: the rows of
                neighbouring vertices hardly differ.
            weights: (H, m) with sums of 1.
        """
        self.exact.set(self._factor.inverse_order[vertices], rows, block, weights)

    def ordered(self, green: FloatArray) -> NDArray:
        """A row (V,) of one entry a vertex, float32, in the order of elimination."""
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

    def take_rotations(self, other: DecodedSurface) -> None:
        """Copy the rotations of another surface of the same model."""
        self._wait()
        other._wait()
        self.has_rotations = other.has_rotations
        self._quaternions, self._R = other._quaternions.copy(), other._R.copy()

    @property
    def quaternions(self) -> NDArray:
        """Rotations (V, 4) as quaternions (w, x, y, z), float32, in the order of elimination."""
        self._wait()
        by_block = self._quaternions.reshape(-1, 4, BLOCK).transpose(0, 2, 1)
        return by_block.reshape(-1, 4)[: len(self._x)]

    def set_rotations(self, quaternions: NDArray) -> None:
        """Replace the rotations by those of quaternions (V, 4), as `quaternions` has them."""
        self.reset()
        padded = np.resize(quaternions, (self._vertex_blocks * BLOCK, 4))
        by_block = padded.reshape(-1, BLOCK, 4).transpose(0, 2, 1).reshape(-1)
        self._quaternions[: len(by_block)] = by_block
        self.relax(0)

    def frames(self, out: NDArray) -> None:
        """Write the affine maps x → M x + t, M = R T, from the reference to the positions.

        Args:
            out: (16 V,) float32, see `lift_kernels.node_frames`.
        """
        shape = self._R, self._T, self._x, self.reference, out
        over_ranges(node_frames, len(self._x), *shape)

    def _reset_rotations(self) -> None:
        """Set all rotations to the identity, both the quaternions and their matrices."""
        self.has_rotations = False
        identity = np.repeat(np.array([1, 0, 0, 0], dtype=np.float32), BLOCK)
        self._quaternions = np.tile(identity, self._blocks)
        self._R = np.tile(np.eye(3, dtype=np.float32).ravel(), len(self._padded))

    def decode(self, z: FloatArray) -> FloatArray:
        """Compute the deformation gradients of a latent code.

        Args:
            z: (K,) latent code.

        Returns:
            Handle positions (H, 3) float64 of the rest shape, relative to its centroid.
        """
        self._has_rest_shape = False
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
        return self.unit * sums.sum(axis=0).reshape(-1, 3, BLOCK).sum(axis=2)

    def write_rhs(self) -> None:
        """Write the right-hand side of the next Poisson solve into the positions.

        It is that of the rest shape, from the gradients, or, once that is solved, that of the
        global step, from the rotations.
        """
        self._wait()
        mesh = self._indptr, self._rings, self._half_weights
        reference, rest = (self.reference, self._T), (self._rest.ravel(), self._R)
        shape = rest if self._has_rest_shape else reference
        over_ranges(rhs, len(self._x), *mesh, *shape, self._x.ravel())
        if len(self._links) and not self._has_rest_shape:
            self._add_displacements()

    def _add_displacements(self) -> None:
        """Add the displacements of the links to the right-hand side of the rest shape."""
        V = len(self._x)
        T = self._T.reshape(-1, 3, 3)
        i, j = self._links.T
        lever = (self._system.lever / self.unit).astype(np.float32)
        displacement = (T[V : V + len(i)] - T[j]) @ lever
        np.add.at(self._x, i, displacement)
        np.subtract.at(self._x, j, displacement)

    def solve(self) -> None:
        """Compute the positions from the gradients and rotations, up to a translation."""
        if not self._has_rest_shape:
            self._solve_sums()
            self._rest, self._x = self._x, self._rest
            self._has_rest_shape = True
        if self.has_rotations:
            self._solve_sums()
        else:
            self._x[:] = self._rest

    def _solve_sums(self) -> None:
        self.write_rhs()
        self._factor.solve_in_order(self._x)

    def move_to_targets(self, targets: FloatArray) -> None:
        """Move the positions by the smallest change that brings exact handles to their targets.

        `schur_inverse` has the formula. Without exact handles the centroid moves to the origin.

        Args:
            targets: (H, 3) positions, before the rigid motion of `positions`.
        """
        exact = self.exact
        if len(exact):
            push, shift = exact.loads(targets / self.unit - exact.means(self._x[exact.index]))
        else:
            push = np.zeros((0, 3), dtype=np.float32)
            shift = -self._x.mean(axis=0, dtype=np.float64).astype(np.float32)
        self.move(exact.values, push, shift)

    def move(self, rows: NDArray, push: NDArray, shift: NDArray) -> None:
        """Add Σ_h rows_h push_h + shift to the positions.

        Args:
            rows: (H, V) float32 in the order of elimination.
            push: (H, 3) float32 in the surface's unit, the bounding diagonal.
            shift: (3,) float32.
        """
        over_ranges(add_green_functions, len(self._x), rows, push, shift, self._x)

    def positions(self, rotation: FloatArray, origin: FloatArray) -> FloatArray:
        """Positions (V, 3) float64 after a rigid motion, in the user's order and units.

        Args:
            rotation: (3, 3) about the origin.
            origin: (3,) translation after it.
        """
        out = np.empty((len(self._x), 3))
        where = self.unit * rotation, origin, self._x, out
        over_ranges(to_user_order, len(out), self._factor.order, *where)
        return out

    def move_on(self, momentum: Momentum) -> None:
        """Move the positions on by a momentum, for the next local step."""
        self._x[:] = momentum.moved_on(self._x)

    def relax(self, steps: int, over: float = float(OVER_RELAXATION)) -> None:
        """Local step: fit the rotations, vertex by vertex, to the edges of the positions.

        The step runs in other threads after the call returns; methods that need it wait for it.

        Args:
            steps: Newton steps of each rotation.
            over: factor by which each rotation goes beyond its optimum; 1 where positions have a
                momentum.
        """
        mesh = self._indptr, self._rings, self._half_weights
        shapes = self._rest.ravel(), self._x.ravel()
        rest = *mesh, *shapes, self._R, self._quaternions, steps, np.float32(over)
        self.has_rotations = True
        # One core is left to the caller.
        share = max(_SHARE, -(-self._vertex_blocks // max(1, CORES - 1)))
        calls = [(*piece, *rest) for piece in ranges(self._vertex_blocks, share)]
        self._running = start_calls(fit_rotations, calls)

    def _wait(self) -> None:
        wait_for(self._running)
        self._running = []

    @property
    def bytes_of_a_frame(self) -> int:
        """Bytes that a frame reads and writes: decoder, coefficients, mesh, factor, positions."""
        arrays = [self._coefficients[:, : len(self._handles)], self.exact.values]
        arrays += [self._rings, self._half_weights, self.reference, self._T]
        if len(self.exact):
            arrays += [self._rings, self._half_weights, self._rest, self._R, self._quaternions]
        if self._decoder.pointwise:
            arrays += [self._matrix, self._scale]
        out = 8 * 3 * len(self._x)
        return sum(a.nbytes for a in arrays) + self._factor.bytes_per_solve + out
