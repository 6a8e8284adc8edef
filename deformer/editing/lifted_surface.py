"""All vertices of a large mesh in a frame of a drag, computed for a few nodes that move them."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import DecodedSurface
from deformer.editing.lift_kernels import FRAME, lift
from deformer.editing.nodes import Nodes
from deformer.geometry import FloatArray, IntArray, spread
from deformer.linalg import over_ranges
from deformer.model import DeformationModel
from deformer.network import Decoder

# Codes at which it is measured how closely vertices follow nodes: some spread over those of the
# training shapes, and as many drawn from the prior with so many times its deviations, since drags
# leave the examples. Rounds in which nodes are added where vertices follow worst, the most of a
# round, the distance, in bounding diagonals, that needs none, and the most nodes as a share of the
# vertices.
_CODES, _DEVIATIONS = 6, 2.0
_ROUNDS, _ADDED, _CLOSE, _SHARE = 3, 2000, 4e-4, 0.2
# A surface of a frame: of all vertices, or of nodes.
Surface: TypeAlias = "DecodedSurface | LiftedSurface"


def moving_surface(model: DeformationModel, surface: DecodedSurface) -> Surface:
    """The surface of frames in which handles move.

    Args:
        model: the prior.
        surface: of all its vertices.

    Returns:
        `surface` itself if the mesh is small.
    """
    nodes = Nodes.of(model.poisson)
    if nodes is None:
        return surface
    codes = _codes(model)
    for _ in range(_ROUNDS):
        room = int(_SHARE * len(model.reference.vertices)) - len(nodes.vertices)
        if room <= 0:
            break
        distances = _distances(surface, nodes, codes)
        # In each node's cell the vertex that follows worst.
        worst = np.argsort(-distances, kind="stable")
        worst = worst[np.unique(nodes.influences[worst, 0], return_index=True)[1]]
        worst = worst[np.argsort(-distances[worst])][: min(_ADDED, room)]
        worst = worst[distances[worst] > _CLOSE]
        if not len(worst):
            break
        nodes = Nodes.at(model.poisson, np.union1d(nodes.vertices, worst))
    V, links = len(model.reference.vertices), len(model.reference.links)
    decoder = model.decoder_at(np.append(nodes.vertices, V + np.arange(links)))
    return LiftedSurface(surface, nodes, decoder)


def _codes(model: DeformationModel) -> FloatArray:
    """Codes (n, K) of examples, and beyond them."""
    prior, rng = model.prior, np.random.default_rng(0)
    beyond = rng.normal(scale=_DEVIATIONS, size=(_CODES, model.components)) @ prior.factor.T
    return np.concatenate([model.codes[spread(model.codes, _CODES)], prior.mean + beyond])


def _distances(surface: DecodedSurface, nodes: Nodes, codes: FloatArray) -> FloatArray:
    """Largest distances (V,), in bounding diagonals, of vertices that follow nodes.

    They are measured from the surface of the codes (n, K), to which the nodes belong.
    """
    followed = nodes.influences[surface.order].astype(np.int32).ravel()
    weights, V = nodes.weights[surface.order].ravel(), len(surface.order)
    places = surface.inverse_order[nodes.vertices]
    maps = np.empty(FRAME * V, dtype=np.float32)
    rows, push, shift = (np.zeros(shape, dtype=np.float32) for shape in ((0, V), (0, 3), 3))
    lifted, largest = np.empty((V, 3)), np.zeros(V)
    for z in codes:
        surface.reset()
        surface.decode(z)
        surface.solve()
        surface.frames(maps)
        frames = maps.reshape(-1, FRAME)[places].ravel()
        moves = rows, push, shift, surface.order, surface.unit * np.eye(3), np.zeros(3)
        over_ranges(lift, V, followed, weights, surface.reference, frames, *moves, lifted)
        away = lifted - surface.positions(np.eye(3), np.zeros(3))
        largest = np.maximum(largest, np.linalg.norm(away, axis=1) / surface.unit)
    return largest


class LiftedSurface:
    """The surface of a latent code, as `DecodedSurface`, but decoded and solved for nodes alone.

    Rotations are those of the nodes. Exact handles move the nodes, and all vertices, by the rows of
    the surface of all vertices, and are at their targets as exactly as there.

    Args:
        surface: of all V vertices; it has the exact handles.
        nodes: n nodes of the same mesh.
        decoder: of the nodes, then of the links.
    """

    def __init__(self, surface: DecodedSurface, nodes: Nodes, decoder: Decoder) -> None:
        """Copy the nodes that vertices follow into the surface's order."""
        self._surface, self._nodes = surface, DecodedSurface(decoder, nodes.system)
        # Places of the nodes, in their own order of elimination, among the vertices.
        self._places: IntArray = surface.inverse_order[nodes.vertices[self._nodes.order]]
        followed = self._nodes.inverse_order[nodes.influences[surface.order]]
        self._followed = followed.astype(np.int32)
        self._weights = np.ascontiguousarray(nodes.weights[surface.order])
        self._to_nodes = nodes.matrix().T.tocsr()
        v = surface.reference.reshape(-1, 3)
        # The node's part of the centroid is M_j moment_j + t_j share_j.
        moments = nodes.matrix()[surface.order].T @ np.column_stack([v, np.ones(len(v))]) / len(v)
        self._moments = moments[self._nodes.order]
        self._frames = np.zeros(FRAME * len(self._places), dtype=np.float32)
        self._rows = np.empty((0, len(self._places)), dtype=np.float32)
        self._stay()

    def _stay(self) -> None:
        """Let no handle move the vertices."""
        self._push = np.zeros((0, 3), dtype=np.float32)
        self._shift = np.zeros(3, dtype=np.float32)

    def block_coefficients(self, coefficients: FloatArray) -> NDArray:
        """As of `DecodedSurface`, of coefficients (V+B, 3) of the vertices and links."""
        V = self._to_nodes.shape[1]
        by_node = np.concatenate([self._to_nodes @ coefficients[:V], coefficients[V:]])
        return self._nodes.block_coefficients(by_node)

    def set_handles_by_block(self, blocked: list[NDArray]) -> None:
        """Set the handles whose positions `decode` returns."""
        self._nodes.set_handles_by_block(blocked)

    def decode(self, z: FloatArray) -> FloatArray:
        """Compute the nodes' gradients of a latent code z (K,); handle positions (H, 3)."""
        return self._nodes.decode(z)

    def handles_changed(self) -> None:
        """Adopt the exact handles of the surface of all vertices; call it after they change."""
        self._rows = np.ascontiguousarray(self._surface.exact.values[:, self._places])

    def restrict_rotations(self) -> None:
        """Give the nodes the rotations of the surface of all vertices."""
        if self._surface.has_rotations:
            self._nodes.set_rotations(self._surface.quaternions[self._places])
        else:
            self._nodes.reset()

    def prolong_rotations(self) -> None:
        """Give the surface of all vertices the rotations of the nodes, weighted."""
        if not self._nodes.has_rotations:
            self._surface.reset()
            return
        q = self._nodes.quaternions[self._followed]
        q *= np.where((q * q[:, :1]).sum(axis=2, keepdims=True) < 0, np.float32(-1), np.float32(1))
        mean = np.einsum("im,imc->ic", self._weights, q)
        self._surface.set_rotations(mean / np.linalg.norm(mean, axis=1, keepdims=True))

    def reset(self) -> None:
        """Set all rotations to the identity."""
        self._nodes.reset()

    def solve(self) -> None:
        """Compute the positions of the nodes, up to a translation."""
        self._nodes.solve()
        self._nodes.frames(self._frames)
        self._stay()

    def move_to_targets(self, targets: FloatArray) -> None:
        """Move exact handles to targets (H, 3) as `DecodedSurface.move_to_targets` does."""
        exact = self._surface.exact
        if len(exact):
            at = exact.means(self._lifted(exact.index))
            self._push, self._shift = exact.loads(targets / self._surface.unit - at)
        else:
            maps = self._frames.reshape(-1, FRAME)[:, :12].reshape(-1, 3, 4)
            self._shift = -np.einsum("jac,jc->a", maps, self._moments).astype(np.float32)
        self._nodes.move(self._rows, self._push, self._shift)

    def _lifted(self, index: IntArray) -> FloatArray:
        """Positions (..., 3) of the vertices in the places `index` (...), without handles."""
        maps = self._frames.reshape(-1, FRAME)[self._followed[index], :12].astype(np.float64)
        means = np.einsum("...m,...mc->...c", self._weights[index], maps)
        means = means.reshape(*index.shape, 3, 4)
        v = self._surface.reference.reshape(-1, 3)[index]
        return np.einsum("...ac,...c->...a", means[..., :3], v) + means[..., 3]

    def positions(self, rotation: FloatArray, origin: FloatArray) -> FloatArray:
        """Positions (V, 3) as `DecodedSurface.positions` returns them."""
        surface = self._surface
        out = np.empty((len(self._followed), 3))
        over_ranges(
            lift,
            len(out),
            self._followed.ravel(),
            self._weights.ravel(),
            surface.reference,
            self._frames,
            surface.exact.values,
            self._push,
            self._shift,
            surface.order,
            surface.unit * rotation,
            origin,
            out,
        )
        return out

    def relax(self, steps: int) -> None:
        """Local step of the nodes, as `DecodedSurface.relax`."""
        self._nodes.relax(steps)

    @property
    def bytes_of_a_frame(self) -> int:
        """Bytes that a frame reads and writes."""
        surface = self._surface
        arrays = [self._followed, self._weights, surface.reference, surface.exact.values]
        out = 8 * 3 * len(self._followed)
        return self._nodes.bytes_of_a_frame + sum(a.nbytes for a in arrays) + out
