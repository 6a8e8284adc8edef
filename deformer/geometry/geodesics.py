"""Geodesic distances by the heat method, from one vertex at a time.

The distances from a vertex to all others, a row of the V×V matrix that is never built, cost one
back-substitution; the latest rows are cached. To other connected components they are lengths of
shortest paths along edges and links (`Mesh.links`).
"""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property
from threading import Lock

import numpy as np
import potpourri3d
from scipy import sparse
from scipy.sparse import csgraph

from deformer.checks import checked_instance, checked_integer
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, Mesh, edges


class Geodesics:
    """Distances over the surface of a mesh: Crane, Weischedel and Wardetzky, "Geodesics in Heat".

    Args:
        mesh: V vertices in any unit; distances are in the same unit. Slivers and non-manifold
            edges are handled by the intrinsic Delaunay triangulation that the solver builds.
        cache_rows: number of cached rows (the least recently used is dropped first); the memory is
            cache_rows × V floats.
    """

    def __init__(self, mesh: Mesh, cache_rows: int = 256) -> None:
        """Factor the heat and Poisson systems."""
        checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
        checked_integer(cache_rows, "cache_rows", least=1)
        self.mesh = mesh
        V = len(mesh.vertices)
        used = np.zeros(V, dtype=bool)
        used[mesh.faces] = True
        self._used = np.flatnonzero(used)
        self._position = np.cumsum(used) - 1
        # Unit size: the heat method's time step squares lengths, which under- or overflows
        # in extreme units.
        self._unit = mesh.bounding_diagonal or 1.0
        self._solver = potpourri3d.MeshHeatMethodDistanceSolver(
            mesh.vertices[self._used] / self._unit, self._position[mesh.faces]
        )
        self._cache_rows = cache_rows
        self._cache: OrderedDict[int, FloatArray] = OrderedDict()
        # Several threads may ask for rows of one mesh.
        self._lock = Lock()
        self._extent: float | None = None

    def __reduce__(self) -> tuple[type[Geodesics], tuple[Mesh, int]]:
        """Pickle the mesh: another process factors the systems itself."""
        return Geodesics, (self.mesh, self._cache_rows)

    @cached_property
    def _graph(self) -> sparse.csr_array:
        """Lengths (V, V) of edges and links."""
        v = self.mesh.vertices
        i, j = np.concatenate([edges(self.mesh.faces), self.mesh.links]).T
        # A stored 0 would be no edge.
        lengths = np.maximum(np.linalg.norm(v[i] - v[j], axis=1), np.finfo(float).tiny)
        return sparse.csr_array((lengths, (i, j)), shape=(len(v), len(v)))

    def row(self, vertex: int) -> FloatArray:
        """Distances (V,) from `vertex`, read-only.

        Args:
            vertex: index, from 0.

        Raises:
            InputError: no such vertex.
        """
        V = len(self.mesh.vertices)
        vertex = checked_integer(vertex, "vertex")
        if not 0 <= vertex < V:
            raise InputError(f"vertex {vertex} does not exist; the mesh has vertices 0…{V - 1}")
        with self._lock:
            if vertex not in self._cache:
                self._cache[vertex] = self._computed(vertex)
            self._cache.move_to_end(vertex)
            while len(self._cache) > self._cache_rows:
                self._cache.popitem(last=False)
            return self._cache[vertex]

    def _computed(self, vertex: int) -> FloatArray:
        """The row of a vertex."""
        distance = np.zeros(len(self.mesh.vertices))
        same = self.mesh.labels == self.mesh.labels[vertex]
        if same.sum() > 1:
            found = self._solver.compute_distance(int(self._position[vertex]))
            distance[self._used] = np.maximum(found, 0.0) * self._unit
        if len(self.mesh.links) > 0:
            along_edges = csgraph.dijkstra(self._graph, directed=False, indices=vertex)
            distance[~same] = along_edges[~same]
        distance[vertex] = 0.0
        distance.setflags(write=False)
        return distance

    @property
    def extent(self) -> float:
        """Largest distance between two vertices that have faces.

        Found by going from the first vertex to the farthest one until the distance no longer
        grows: exact on trees and, in practice, within a few per cent on surfaces.
        """
        if self._extent is None:
            vertex, longest = int(self._used[0]), -1.0
            for _ in range(8):
                distance = self.row(vertex)[self._used]
                if distance.max() <= longest:
                    break
                longest, vertex = float(distance.max()), int(self._used[distance.argmax()])
            self._extent = longest
        return self._extent

    def normalised_row(self, vertex: int) -> FloatArray:
        """Distances (V,) from `vertex` in units of `extent` (0 to about 1)."""
        return self.row(vertex) / (self.extent or 1.0)


class SiteGeodesics:
    """Distances between the sites of a mesh: its V vertices, then its B links.

    A link is where its first vertex is.

    Args:
        geodesics: distances over the mesh.
    """

    def __init__(self, geodesics: Geodesics) -> None:
        """Find the vertex of each site."""
        self._geodesics = geodesics
        mesh = geodesics.mesh
        self._vertices = np.append(np.arange(len(mesh.vertices)), mesh.links[:, 0])

    def normalised_row(self, site: int) -> FloatArray:
        """Distances (V+B,) from `site` in units of `Geodesics.extent`."""
        return self._geodesics.normalised_row(int(self._vertices[site]))[self._vertices]
