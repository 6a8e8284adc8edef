"""Normals and tangents of polygon meshes, recomputed for new positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer.geometry import FloatArray, IntArray

# Stored normals of coincident vertices that agree to this are one normal, split at a seam.
_SAME_NORMAL = 2e-3
# Twice the area of a polygon by the sum of its squared edges, below which it counts for less.
_SLIVER = 0.02


def present(values: FloatArray) -> NDArray[np.bool_]:
    """True (n,) for rows of values (n, k) without a NaN, which stands for what a file lacks."""
    return np.logical_and.reduce(np.isfinite(values), axis=1)


def mean_normals(
    vertices: FloatArray,
    counts: IntArray,
    corners: IntArray,
    groups: IntArray,
    group_count: int,
) -> FloatArray:
    """Unit normals (G, 3) of groups of corners: the mean of their polygons' normals.

    Every polygon's normal is weighted by its angle at the corner, so that the result does not
    depend on how a flat face is cut into polygons; slivers count for less.

    Args:
        vertices: (V, 3) positions.
        counts: (P,) corners of each polygon.
        corners: (C,) vertices of all polygons, one polygon after the other.
        groups: (C,) group of each corner; −1 for none.
        group_count: G.

    Returns:
        the normals; zero for a group without corners, or whose normals cancel out.

    Source: Thürmer and Wüthrich, Computing Vertex Normals from Polygonal Facets, 1998; the normal
        of a polygon that is not flat is Newell's.
    """
    before, after = _neighbours(counts)
    here = vertices[corners]
    back, ahead = vertices[corners[before]] - here, vertices[corners[after]] - here
    polygon = np.repeat(np.arange(len(counts)), counts)
    # Relative to the first corner, for far from the origin the products would cancel.
    local = here - np.repeat(here[np.cumsum(counts) - counts], counts, axis=0)
    areas = np.zeros((len(counts), 3))
    np.add.at(areas, polygon, np.cross(local, local[after]))
    # The normals of slivers are noise, and one of their angles is large.
    edges = np.bincount(polygon, weights=(ahead**2).sum(axis=1))
    shape = np.linalg.norm(areas, axis=1) / np.where(edges > 0, edges, 1.0)
    normals = (np.minimum(shape / _SLIVER, 1.0)[:, None] * _unit(areas))[polygon]
    across = np.linalg.norm(np.cross(ahead, back), axis=1)
    angles = np.arctan2(across, (ahead * back).sum(axis=1))
    chosen = groups >= 0
    sums = np.zeros((group_count, 3))
    np.add.at(sums, groups[chosen], (angles[:, None] * normals)[chosen])
    # Rounding leaves something of normals that cancel.
    sums[np.linalg.norm(sums, axis=1) < 1e-9] = 0.0
    return _unit(sums)


def smooth_groups(vertices: FloatArray, normals: FloatArray) -> IntArray:
    """Group (V,) of every vertex: vertices of one place with one normal are shaded as one.

    Formats with a normal a vertex split vertices where texture coordinates or normals differ: the
    former stay smooth, and the latter hard edges.

    Args:
        vertices: (V, 3) positions.
        normals: (V, 3) the normals that the file has for them.
    """
    keys = np.concatenate([vertices + 0.0, np.round(normals / _SAME_NORMAL) + 0.0], axis=1)
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel().astype(np.int64)


def touched(corners: IntArray, counts: IntArray, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True (C,) for the corners of polygons with a vertex that has moved.

    Args:
        corners, counts: as of `mean_normals`.
        moved: (V,) true for the vertices that have moved.
    """
    polygon = np.repeat(np.arange(len(counts)), counts)
    hit = np.bincount(polygon, weights=moved[corners], minlength=len(counts)) > 0
    return hit[polygon]


def renewed_normals(
    old: FloatArray,
    groups: IntArray,
    before: FloatArray,
    vertices: FloatArray,
    counts: IntArray,
    corners: IntArray,
) -> FloatArray:
    """Normals (G, 3) for new positions; those whose polygons have not moved stay as they are.

    Args:
        old: (G, 3) the file's normals.
        groups: (C,) normal of each corner; −1 for none.
        before: (V, 3) the file's positions.
        vertices: (V, 3) the new positions.
        counts, corners: as of `mean_normals`.
    """
    changed = touched(corners, counts, (before != vertices).any(axis=1)) & (groups >= 0)
    anew = np.zeros(len(old), dtype=bool)
    anew[groups[changed]] = True
    found = mean_normals(vertices, counts, corners, groups, len(old))
    anew &= found.any(axis=1)
    return np.where(anew[:, None], found, old)


def tangents(
    vertices: FloatArray, faces: IntArray, uvs: FloatArray, normals: FloatArray, groups: IntArray
) -> FloatArray:
    """Unit directions (V, 3) in which the first texture coordinate grows; zero where it does not.

    Args:
        vertices: (V, 3) positions.
        faces: (F, 3).
        uvs: (V, 2) texture coordinates.
        normals: (V, 3), to which the directions are orthogonal.
        groups: (V,) vertices of one group have one direction.

    Source: Lengyel, Foundations of Game Engine Development 2, section 7.5, with the angles at the
        corners as weights.
    """
    p, t = vertices[faces], uvs[faces]
    first, second = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    a, b = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    along = np.sign(area)[:, None] * (first * b[:, 1:] - second * a[:, 1:])
    counts = np.full(len(faces), 3)
    before, after = _neighbours(counts)
    corners = faces.ravel()
    back, ahead = (vertices[corners[step]] - vertices[corners] for step in (before, after))
    angles = np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=1), (ahead * back).sum(axis=1))
    n = normals[corners]
    flat = np.repeat(along, 3, axis=0)
    flat = _unit(flat - n * (flat * n).sum(axis=1, keepdims=True))
    sums = np.zeros((int(groups.max()) + 1, 3))
    np.add.at(sums, groups[corners], angles[:, None] * flat)
    found = sums[groups]
    return _unit(found - normals * (found * normals).sum(axis=1, keepdims=True))


def _neighbours(counts: IntArray) -> tuple[IntArray, IntArray]:
    """The corners (C,) before and after each corner of its polygon."""
    total = int(counts.sum())
    start = np.repeat(np.cumsum(counts) - counts, counts)
    size = np.repeat(counts, counts)
    own = np.arange(total) - start
    return start + (own - 1) % size, start + (own + 1) % size


def _unit(vectors: FloatArray) -> FloatArray:
    """Vectors (n, 3) of length 1; zero stays zero."""
    scale = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = vectors / np.where(scale > 0, scale, 1.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(length > 0, length, 1.0)
