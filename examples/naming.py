"""Names of a model's components: each has that of the region, or of the shape, it is most like.

Similarity is the cosine between what the component changes in its representative shape and the
region or the shape's own change. Names depend on what components do, not on their numbers, which
another training permutes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import deformer
from deformer import Activations, DeformationModel

MATCH = 1e-5  # of the bounding diagonal: how near a model's vertex is to that of its source
NEARLY = 0.02  # similarities that differ by less are equal: the smaller region or change is taken
LEAST = 0.5  # similarity from which a component is named after a shape


def find_vertices(model: DeformationModel, points: NDArray) -> NDArray:
    """Rows (V,) of `points` (U, 3), of which a training set took some, at a model's vertices.

    Raises:
        deformer.InputError: a vertex is at none of the points.
    """
    distances, rows = cKDTree(points).query(model.reference.vertices)
    if distances.max() > MATCH * model.reference.bounding_diagonal:
        raise deformer.InputError(
            f"the model's vertices are up to {distances.max():.3g} from those of the source; give "
            "the source that the model's training set was made from"
        )
    return rows


def name_by_region(model: DeformationModel, regions: Mapping[str, NDArray]) -> dict[int, str]:
    """Names of all components, after the regions that they change.

    Args:
        model: the prior.
        regions: name → (V,) share of every vertex in the region, 0 to 1.
    """
    activations = Activations(model)
    root = np.sqrt(_vertex_areas(model.reference))
    changes = np.stack([activations.displacement(k) for k in range(model.components)])
    names, fields = list(regions), np.stack(list(regions.values()))
    similarity = _unit(changes * root) @ _unit(fields * root).T
    best = _most_alike(similarity, fields @ root**2)
    return _numbered([names[n] for n in best], activations.order)


def name_by_shape(
    model: DeformationModel, shapes: Mapping[str, NDArray], regions: Mapping[str, str]
) -> dict[int, str]:
    """Names of all components, after the shapes that they, or their opposites, change alike.

    Args:
        model: the prior; its reference has no seams.
        shapes: name → (V, 3) vertices.
        regions: name of a shape → name of a component that is like no shape, least unlike this one.
    """
    activations = Activations(model)
    extractor, gain = model.extractor, model.scaler.gain
    rest = extractor.extract(model.reference.vertices)
    found = np.stack([(extractor.extract(p) - rest) / gain for p in shapes.values()])
    changes = np.stack([activations.change(k) / gain for k in range(model.components)])
    similarity = np.abs(_unit(changes) @ _unit(found).T)
    names = list(shapes)
    best = _most_alike(similarity, np.linalg.norm(found, axis=(1, 2)))
    titles = [
        names[n] if similarity[k, n] >= LEAST else regions[names[n]] for k, n in enumerate(best)
    ]
    return _numbered(titles, activations.order)


def _most_alike(similarity: NDArray, sizes: NDArray) -> list[int]:
    """Column of each row's largest similarity (K, n); of those nearly as large, the smallest."""
    rows = [np.flatnonzero(row > row.max() - NEARLY) for row in similarity]
    return [int(columns[sizes[columns].argmin()]) for columns in rows]


def _vertex_areas(mesh: deformer.Mesh) -> NDArray:
    """A third (V,) of the area of every vertex's triangles."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.bincount(mesh.faces.ravel(), np.repeat(areas, 3), len(mesh.vertices))


def _unit(values: NDArray) -> NDArray:
    """Rows (n, m) of length 1, from values (n, …); a row of zeros stays."""
    rows = values.reshape(len(values), -1)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)


def _numbered(titles: Sequence[str], order: NDArray) -> dict[int, str]:
    """Component → its title, with numbers from the second of equal ones on, in an order (K,)."""
    names: dict[int, str] = {}
    count: dict[str, int] = {}
    for k in order.tolist():
        title = titles[k]
        count[title] = count.get(title, 0) + 1
        names[k] = title if count[title] == 1 else f"{title} {count[title]}"
    return names
