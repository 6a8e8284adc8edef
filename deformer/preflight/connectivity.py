"""Findings about connectivity: pieces, borders, seams, faces of opposite orientation."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.geometry import (
    FloatArray,
    IntArray,
    Seams,
    ShapeSequence,
    connected_components,
    same_place,
)
from deformer.preflight.report import Finding, Labels

_DEGENERATE_AREA = 1e-12


def examine_connectivity(
    faces: IntArray, seams: Seams, facts: dict[str, Any], findings: list[Finding]
) -> None:
    """Add facts and findings that depend on the faces (F, 3) and seams alone, not on positions."""
    isolated = isolated_vertices(faces, len(seams.closed))
    # Along seams a surface is whole. A vertex without a face is a component of its own.
    whole, U = seams.closed[faces], len(seams.first)
    components = connected_components(whole, U)[0] - len(isolated_vertices(whole, U))
    half = half_edges(faces)
    half = half[half[:, 0] != half[:, 1]]
    pairs, label, uses = np.unique(
        np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    non_manifold = pairs[uses > 2]
    # Consistently oriented faces traverse their common edge in opposite directions.
    balance = np.bincount(label.ravel(), np.where(half[:, 0] < half[:, 1], 1, -1), len(pairs))
    inconsistent = pairs[(uses == 2) & (balance != 0)]
    facts |= {
        "components": components,
        "boundary_loops": len(np.unique(border_loops(whole, U)[1])),
        "non_manifold_edges": len(non_manifold),
        "isolated_vertices": len(isolated),
        "inconsistent_orientation": len(inconsistent),
    }
    if len(non_manifold):
        findings.append(
            Finding(
                "warning",
                "non-manifold",
                f"edges with more than two faces: {len(non_manifold)}, e.g. "
                f"{non_manifold[0].tolist()}, expected none; split the surface there or remove "
                "double faces",
                vertices=tuple(np.unique(non_manifold).tolist()),
            )
        )
    if len(inconsistent):
        findings.append(
            Finding(
                "warning",
                "orientation",
                f"edges between faces of opposite orientation: {len(inconsistent)}, e.g. "
                f"{inconsistent[0].tolist()}, expected all faces counter-clockwise from outside; "
                "recalculate the normals in every shape alike",
                vertices=tuple(np.unique(inconsistent).tolist()),
            )
        )
    if len(isolated):
        findings.append(
            Finding(
                "info",
                "isolated",
                f"vertices without a face: {len(isolated)}, e.g. vertex {isolated[0]}; they go "
                "where the surface near them goes, remove them from all shapes if they are no use",
                vertices=tuple(isolated.tolist()),
            )
        )
    if components > 1:
        findings.append(
            Finding(
                "info",
                "pieces",
                f"connected components: {components}; where each of them lies is learned, too",
            )
        )
    if facts["boundary_loops"]:
        findings.append(
            Finding(
                "info",
                "open",
                f"the surface is open, boundary loops: {facts['boundary_loops']}; nothing to do",
            )
        )


def examine_places(
    shapes: ShapeSequence,
    seams: Seams,
    label: Labels,
    facts: dict[str, Any],
    findings: list[Finding],
) -> None:
    """Add facts and findings about faces of shape 0 without area, and coincident vertices."""
    degenerate = np.flatnonzero(_without_area(shapes.vertices[0], shapes.faces))
    first = same_place(shapes.vertices[:1])
    coincident = np.flatnonzero(first != np.arange(len(first)))
    facts |= {"degenerate_faces": len(degenerate), "coincident_vertices": len(coincident)}
    if len(degenerate):
        i = degenerate[0]
        findings.append(
            Finding(
                "warning",
                "degenerate",
                f"faces of {label([0])} without area: {len(degenerate)}, e.g. face {i} "
                f"{shapes.faces[i].tolist()}, expected none; collapse them in all shapes",
                faces=tuple(degenerate.tolist()),
            )
        )
    always = seams.first[seams.closed]
    split = np.flatnonzero(always != np.arange(len(always)))
    if len(split):
        findings.append(
            Finding(
                "info",
                "seams",
                f"vertices that lie on another in all shapes: {len(split)}, e.g. {split[0]} on "
                f"{always[split[0]]}; a model closes such seams and has these vertices at one "
                "place, nothing to do",
                vertices=tuple(split.tolist()),
            )
        )
    touching = np.setdiff1d(coincident, split, assume_unique=True)
    if len(touching):
        i = touching[0]
        findings.append(
            Finding(
                "info",
                "touching",
                f"vertices of {label([0])} that lie on another there but not in all shapes: "
                f"{len(touching)}, e.g. {i} on {first[i]}; nothing to do if "
                "surfaces touch there",
                shapes=(0,),
                vertices=(int(i),),
            )
        )


def half_edges(faces: IntArray) -> IntArray:
    """The sides (3F, 2) of faces (F, 3), each in the direction of its face."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def isolated_vertices(faces: IntArray, vertex_count: int) -> IntArray:
    """Vertices without a face."""
    used = np.zeros(vertex_count, dtype=bool)
    used[faces] = True
    return np.flatnonzero(~used)


def _without_area(p: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (p[faces[:, corner]] for corner in range(3))
    double_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return double_area <= _DEGENERATE_AREA * longest


def border_loops(faces: IntArray, vertex_count: int) -> tuple[IntArray, IntArray]:
    """Sides (B, 2) of only one face, in its direction, and the loop (B,) of each, 0, 1 and so on.

    Loops that meet in a vertex are one.
    """
    half = half_edges(faces)
    half = half[half[:, 0] != half[:, 1]]
    _, label, uses = np.unique(
        np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    border = half[uses[label.ravel()] == 1]
    graph = sparse.csr_array(
        (np.ones(len(border)), (border[:, 0], border[:, 1])), shape=(vertex_count, vertex_count)
    )
    labels = csgraph.connected_components(graph, directed=False)[1]
    return border, np.unique(labels[border[:, 0]], return_inverse=True)[1].ravel()
