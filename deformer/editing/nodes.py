"""Nodes: a bounded number of vertices whose frames move all vertices of a large mesh.

A vertex follows the nearest nodes along the surface: p_i = Σ_j w_ij (M_j (v_i − v_j) + p_j), with
the nodes' gradients M_j and positions p_j (Sumner, Schmid and Pauly, Embedded Deformation for Shape
Manipulation, 2007, equation 2). The cells of vertices nearest to each node give the Laplacian that
places the nodes: weights are lengths of the border between two cells over the distance of their
nodes, as in a finite-volume method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.editing.lift_kernels import INFLUENCES
from deformer.geometry import FloatArray, IntArray, Mesh, farthest_rows, graph_laplacian
from deformer.linalg import CORES, SparseCholesky

# Nodes of a mesh, apart from those that links, small components and details need.
_NODES = 5000
# A frame by nodes costs as much as one of about twice as many vertices: a mesh of fewer than this
# many times the nodes would gain little.
_LARGE = 4
# Nodes are chosen among this many random vertices of a larger mesh.
_POOL = 20_000
# Candidates for the nodes that a vertex follows: the nearest in space.
_CANDIDATES = 10


@dataclass(frozen=True, eq=False)
class NodeReference:
    """The nodes of an undeformed mesh.

    Args:
        vertices: (n, 3) their positions.
        links: (B, 2) the mesh's links, between nodes.
        bounding_diagonal: that of the mesh, the unit of length.
    """

    vertices: FloatArray
    links: IntArray
    bounding_diagonal: float


class NodeSystem:
    """Positions of nodes from their gradients, as `PoissonSystem` does for vertices.

    Args:
        reference: n nodes.
        weights: (n, n) symmetric positive weights of their edges, the links apart.
        system: that of all vertices.
    """

    def __init__(
        self, reference: NodeReference, weights: sparse.csr_array, system: PoissonSystem
    ) -> None:
        """Factor the Laplacian."""
        self.reference, self.lever, self.centroid = reference, system.lever, system.centroid
        n = len(reference.vertices)
        i, j = reference.links.T
        # As in `PoissonSystem`: links have the weight 1, the stiffness of one node keeps all rows.
        links = sparse.csr_array((np.ones(len(i)), (i, j)), shape=(n, n))
        self.weights = sparse.csr_array(weights + links + links.T)
        self.weights.sort_indices()
        stiffness = float(self.weights.data.mean())
        ground = sparse.coo_array(([stiffness], ([0], [0])), shape=(n, n))
        self.factor = SparseCholesky(graph_laplacian(self.weights) + ground, reference.vertices)


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a mesh of V vertices.

    Args:
        vertices: (n,) int64 the nodes.
        influences: (V, 4) int64 numbers of the nodes that each vertex follows.
        weights: (V, 4) their weights w_ij, float32; sums are 1.
        system: places the nodes.
    """

    vertices: IntArray
    influences: IntArray
    weights: NDArray
    system: NodeSystem

    @classmethod
    def of(cls, system: PoissonSystem, count: int = _NODES) -> Nodes | None:
        """Nodes of a mesh; None of one that is too small for them.

        Args:
            system: of the mesh.
            count: number of nodes; the ends of links, and a node for each component that would have
                none, are added.
        """
        V = len(system.reference.vertices)
        if _LARGE * count > V:
            return None
        chosen = _chosen(system.reference, count)
        return cls.at(system, chosen) if _LARGE * len(chosen) <= V else None

    @classmethod
    def at(cls, system: PoissonSystem, chosen: IntArray) -> Nodes:
        """Nodes at vertices (n,), among which are both ends of all links, all different."""
        mesh, v = system.reference, system.reference.vertices
        cells, weights = _cells(system, chosen)
        influences, shares = _influences(v, chosen, cells, weights)
        number = np.full(len(v), -1)
        number[chosen] = np.arange(len(chosen))
        reference = NodeReference(v[chosen], number[mesh.links], mesh.bounding_diagonal)
        return cls(chosen, influences, shares, NodeSystem(reference, weights, system))

    def matrix(self) -> sparse.csr_array:
        """The weights as a matrix (V, n)."""
        V, m = self.weights.shape
        rows = np.repeat(np.arange(V), m)
        shape = V, len(self.vertices)
        return sparse.csr_array((self.weights.ravel(), (rows, self.influences.ravel())), shape)


def _chosen(mesh: Mesh, count: int) -> IntArray:
    """Vertices far from each other, the ends of links, and one of each component at least."""
    v, V = mesh.vertices, len(mesh.vertices)
    pool = np.arange(V)
    if V > _POOL:
        pool = np.sort(np.random.default_rng(0).choice(V, _POOL, replace=False))
    # Coordinates in single precision may coincide far from the origin.
    places = ((v[pool] - v.mean(axis=0)) / mesh.bounding_diagonal).astype(np.float32)
    chosen = np.append(pool[farthest_rows(places, count)[0]], mesh.links)
    labels, firsts = np.unique(mesh.labels, return_index=True)
    without = np.setdiff1d(labels, mesh.labels[chosen])
    return np.unique(np.append(chosen, firsts[without]))


def _cells(system: PoissonSystem, nodes: IntArray) -> tuple[IntArray, sparse.csr_array]:
    """The node (V,) nearest to each vertex along the edges, and the weights (n, n) of nodes."""
    from scipy.sparse import csgraph  # only large meshes need it

    mesh, v, n = system.reference, system.reference.vertices, len(nodes)
    i = np.repeat(np.arange(len(v)), np.diff(system.indptr))
    inside = mesh.labels[i] == mesh.labels[system.rings]
    i, j, c = i[inside], system.rings[inside], system.c[inside]
    # Coincident vertices are neighbours, too.
    least = 1e-9 * mesh.bounding_diagonal
    lengths = np.maximum(np.linalg.norm(v[i] - v[j], axis=1), least)
    graph = sparse.csr_array((lengths, (i, j)), shape=(len(v), len(v)))
    _, _, sources = csgraph.dijkstra(graph, indices=nodes, min_only=True, return_predecessors=True)
    number = np.full(len(v), -1)
    number[nodes] = np.arange(n)
    cells = number[sources]
    a, b = cells[i], cells[j]
    apart = a != b
    a, b, border = a[apart], b[apart], (c * lengths)[apart]
    borders = sparse.csr_array(sparse.coo_array((border, (a, b)), shape=(n, n)))
    a, b = borders.nonzero()
    distances = np.maximum(np.linalg.norm(v[nodes[a]] - v[nodes[b]], axis=1), least)
    weights = borders.data / distances
    return cells, sparse.csr_array((weights, (a, b)), shape=(n, n))


def _influences(
    v: FloatArray, nodes: IntArray, cells: IntArray, weights: sparse.csr_array
) -> tuple[IntArray, NDArray]:
    """Nodes (V, 4) that vertices follow, and shares (V, 4): less the farther, none at the fifth.

    Nodes near in space but not along the surface, as those of the other lip, are left out: their
    cells are neither neighbours of the vertex's nor of its neighbours.
    """
    from scipy.spatial import KDTree

    n = len(nodes)
    query = KDTree(v[nodes]).query(v, k=min(_CANDIDATES, n), workers=CORES)
    distances, near = np.asarray(query[0]), np.asarray(query[1])
    steps = weights + sparse.eye_array(n, format="csr")
    reached = sparse.csr_array(steps @ steps)
    reached.sort_indices()
    rows = np.repeat(np.arange(n), np.diff(reached.indptr))
    keys = rows * n + reached.indices
    wanted = cells[:, None] * n + near
    found = keys[np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)] == wanted
    distances = np.where(found, distances, np.inf)
    none = ~found.any(axis=1)
    near[none, 0], distances[none, 0] = cells[none], 1.0
    order = np.argsort(distances, axis=1, kind="stable")[:, : INFLUENCES + 1]
    distances = np.take_along_axis(distances, order, axis=1)
    near = np.take_along_axis(near, order, axis=1)
    missing = INFLUENCES + 1 - order.shape[1]
    distances = np.pad(distances, [(0, 0), (0, missing)], constant_values=np.inf)
    near = np.pad(near, [(0, 0), (0, missing)])
    farthest = np.where(np.isfinite(distances), distances, 0.0).max(axis=1)
    last = np.where(np.isfinite(distances[:, -1]), distances[:, -1], 2.0 * farthest)
    shares = 1.0 - (distances[:, :-1] / np.maximum(last, np.finfo(float).tiny)[:, None]) ** 2
    shares = np.maximum(shares, 0.0) ** 2
    # Nodes at the same distance as the fifth, a coincident one's.
    shares[shares.sum(axis=1) == 0, 0] = 1.0
    shares /= shares.sum(axis=1, keepdims=True)
    return near[:, :-1].astype(np.int64), shares.astype(np.float32)
