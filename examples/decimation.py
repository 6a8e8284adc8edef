"""Decimation of a mesh to some of its own vertices, and what it needs to know of a mesh.

The shapes of a set keep one connectivity: what stays of one shape stays of all.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


def reduce_mesh(
    points: NDArray, faces: NDArray, importance: NDArray, vertex_count: int
) -> tuple[NDArray, NDArray]:
    """Faces (G, 3) of the decimated mesh and, for its vertices, their indices in the given one.

    Arguments and errors are those of `decimate`.
    """
    return compact(decimate(points, faces, importance, vertex_count))


def decimate(points: NDArray, faces: NDArray, importance: NDArray, vertex_count: int) -> NDArray:
    """Triangles over a subset of a mesh's own vertices.

    Half-edge collapses, cheapest first: Garland–Heckbert quadric error (SIGGRAPH 1997) times the
    importance of the vertex that goes, plus a term that keeps triangles even. A collapse that would
    change the topology or turn or flatten a triangle is not made; vertices of boundaries stay.

    Args:
        points: (V, 3) positions.
        faces: (F, 3) triangles, consistently oriented.
        importance: (V,) factors of the error, positive.
        vertex_count: number of vertices that stay.

    Returns:
        The triangles (G, 3), as indices of the given vertices.

    Raises:
        ValueError: no allowed collapse is left before.
    """
    quadrics = _quadrics(points, faces)
    normals = vertex_normals(points, faces)
    fixed = np.zeros(len(points), dtype=bool)
    fixed[boundary_vertices(faces)] = True
    around: list[set[int]] = [set() for _ in points]
    triangles = {index: tuple(map(int, face)) for index, face in enumerate(faces)}
    for index, face in triangles.items():
        for i in face:
            around[i].add(index)

    def neighbours(i: int) -> set[int]:
        return {j for index in around[i] for j in triangles[index]} - {i}

    def cost(i: int, j: int) -> float:
        p = points[j]
        error = p @ quadrics[i][:3, :3] @ p + 2 * p @ quadrics[i][:3, 3] + quadrics[i][3, 3]
        length = float(((points[i] - p) ** 2).sum())
        return importance[i] * (max(error, 0.0) + 2e-3 * length**2)

    def allowed(i: int, j: int) -> bool:
        if fixed[i] or len(neighbours(i) & neighbours(j)) != 2:
            return False
        valence = len(neighbours(i) | neighbours(j)) - 2
        if valence > 9:
            return False
        for index in around[i]:
            face = triangles[index]
            if j in face:
                continue
            n0, shape0 = _normal_and_shape(points[list(face)])
            n1, shape1 = _normal_and_shape(points[[j if k == i else k for k in face]])
            if shape1 < min(0.11, shape0) or shape1 < 1e-4:
                return False
            # A sliver's own normal means little: compare with that of the skin around it.
            if (n0 @ n1 < 0.5) if shape0 > 0.03 else (normals[j] @ n1 < 0.3):
                return False
        return True

    version = np.zeros(len(points), dtype=int)
    queue = [(cost(i, j), i, j, 0, 0) for i in range(len(points)) for j in sorted(neighbours(i))]
    heapq.heapify(queue)
    remaining, refused = len(points), []
    while remaining > vertex_count and queue:
        entry = heapq.heappop(queue)
        _, i, j, version_i, version_j = entry
        if version[i] != version_i or version[j] != version_j or not around[i] or not around[j]:
            continue
        if not allowed(i, j):
            refused.append(entry)
            continue
        for index in list(around[i]):
            face = triangles.pop(index)
            for k in face:
                around[k].discard(index)
            if j not in face:
                triangles[index] = tuple(j if k == i else k for k in face)
                for k in triangles[index]:
                    around[k].add(index)
        quadrics[j] += quadrics[i]
        remaining -= 1
        if remaining % 400 == 0:  # what was refused may be allowed by now
            for entry in refused:
                heapq.heappush(queue, entry)
            refused.clear()
        ring = neighbours(j)
        version[j] += 1
        patch = ring | {j}
        for s, t in sorted((a, b) for a in patch for b in neighbours(a) & patch):
            heapq.heappush(queue, (cost(s, t), s, t, version[s], version[t]))
    if remaining > vertex_count:
        raise ValueError(f"the mesh could be reduced to {remaining} vertices only")
    return np.array([triangles[index] for index in sorted(triangles)])


def _normal_and_shape(triangle: NDArray) -> tuple[NDArray, float]:
    """Unit normal of a (3, 3) triangle and its area / longest edge²."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    length = max(float(np.linalg.norm(normal)), 1e-300)
    longest = max(((triangle - triangle[[1, 2, 0]]) ** 2).sum(1))
    return normal / length, 0.5 * length / longest


def vertex_normals(points: NDArray, faces: NDArray) -> NDArray:
    """(V, 3) unit normals, area-weighted over the triangles at each vertex."""
    a, b, c = points[faces].transpose(1, 0, 2)
    total = np.zeros_like(points)
    for corner in range(3):
        np.add.at(total, faces[:, corner], np.cross(b - a, c - a))
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def worst_triangles(points: NDArray, faces: NDArray) -> NDArray:
    """Smallest area / longest edge² (0.43 if equilateral) of the triangles at each vertex, (V,)."""
    a, b, c = points[faces].transpose(1, 0, 2)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    shape = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1) / longest
    worst = np.full(len(points), np.inf)
    np.minimum.at(worst, faces, shape[:, None])
    return worst


def _quadrics(points: NDArray, faces: NDArray) -> NDArray:
    """(V, 4, 4) sums of the area-weighted plane quadrics of the triangles around each vertex."""
    a, b, c = points[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = normal / area
    plane = np.concatenate([unit, -(unit * a).sum(1, keepdims=True)], 1)
    per_face = 0.5 * area[:, :, None] * plane[:, :, None] * plane[:, None, :]
    total = np.zeros((len(points), 4, 4))
    for corner in range(3):
        np.add.at(total, faces[:, corner], per_face)
    return total


def adjacency(faces: NDArray, vertex_count: int) -> sparse.csr_array:
    """Symmetric (V, V) matrix with a 1 for every edge."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    shape = (vertex_count, vertex_count)
    matrix = sparse.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    matrix.sum_duplicates()
    matrix.data[:] = 1.0
    return matrix


def compact(faces: NDArray) -> tuple[NDArray, NDArray]:
    """Faces over vertices that are numbered without gaps, and the old numbers (V,) of these."""
    kept, renumbered = np.unique(faces, return_inverse=True)
    return renumbered.reshape(-1, 3), kept


def boundary_vertices(faces: NDArray) -> NDArray:
    """Indices of the vertices on edges of one triangle only, sorted."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    return np.unique(pairs[counts == 1])
