"""Examination of a set of shapes: all that would harm training, with remedies."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from deformer.checks import checked_instance
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    MeshSequence,
    ShapeSequence,
    StoredShapes,
    find_seams,
    procrustes,
)
from deformer.preflight import frames, neighbours
from deformer.preflight.connectivity import examine_connectivity, examine_places
from deformer.preflight.orientation import examine_orientation
from deformer.preflight.report import Finding, Labels, Report, in_order
from deformer.preflight.statistics import Statistics
from deformer.workspace import Rows, blocks

# Residual of a rigid fit, in bounding diagonals, that the rounding of float32 data explains.
RIGID_TOLERANCE = 1e-5
# Below this number of shapes, more of them help much, whatever the number of components.
_FEW = 20


def examine(shapes: ShapeSequence, names: Sequence[str] | None = None) -> Report:
    """Check shapes before training; shape 0 is the reference.

    Args:
        shapes: at least one shape; those in a file are read some at a time.
        names: a name for each shape, as of its file, for messages.

    Returns:
        A report, with the facts shapes, vertices, faces, components and isolated_vertices (a vertex
        without a face is no component), seam_vertices (that lie on another one in all shapes; the
        surface is whole there), boundary_loops (connected pieces of the border),
        non_manifold_edges (more than two faces), inconsistent_orientation (edges that both faces
        traverse in the same direction), degenerate_faces and coincident_vertices (of the
        reference; of coincident vertices all but one), bounding_diagonal {min, max},
        duplicate_shapes (pairs, the earlier first), largest_rotation (radians, of the best rigid
        fit to the reference), local_rotations {as_they_are, aligned} (mean of (3 − tr R) / 3 over
        faces and shapes, R a face's rotation against the reference).

    Raises:
        InputError: another number of names than shapes.
    """
    if not isinstance(shapes, StoredShapes):
        checked_instance(shapes, "shapes", MeshSequence, remedy="load shapes with load_shapes")
    if names is not None:
        checked_instance(names, "names", Sequence, remedy="give a list of names")
    if names is not None and len(names) != len(shapes):
        raise InputError(f"names: got {len(names)}, expected one for each of {len(shapes)} shapes")
    label = Labels(names)
    findings: list[Finding] = []
    vertices = shapes.vertices
    extents = np.concatenate([np.ptp(vertices[part], axis=1) for part in blocks(vertices)])
    diagonals = np.linalg.norm(extents, axis=1)
    facts: dict[str, Any] = {
        "shapes": len(shapes),
        "vertices": shapes.vertices.shape[1],
        "faces": len(shapes.faces),
    }
    seams = find_seams(shapes.vertices)
    facts["seam_vertices"] = len(seams.closed) - len(seams.first)
    examine_connectivity(shapes.faces, seams, facts, findings)
    examine_places(shapes, seams, label, facts, findings)
    facts["bounding_diagonal"] = {"min": float(diagonals.min()), "max": float(diagonals.max())}
    points = frames.points(extents, label)
    findings += points or _examine_shapes(shapes, diagonals, facts, label)
    findings += _examine_variety(shapes, facts, label)
    return Report(in_order(findings), facts)


def _examine_shapes(
    shapes: ShapeSequence, diagonals: FloatArray, facts: dict[str, Any], label: Labels
) -> list[Finding]:
    """Findings about single shapes; each is called faulty for one reason only."""
    measures = Statistics.measure(shapes)
    order = frames.reordered(measures, label)
    far = frames.far_vertices(measures, _shapes_of(order), label)
    flat = frames.flattened(measures, _shapes_of(order), label)
    wrong = _shapes_of(order + flat)
    units = frames.sizes(measures, wrong, label)
    orientation = examine_orientation(measures, wrong, label)
    facts |= orientation.facts
    single = [finding for finding in orientation.findings if finding.kind != "turned"]
    wrong |= _shapes_of([*far, *units, *single])
    moved = neighbours.moved(shapes, diagonals, wrong, label)
    return [*order, *far, *flat, *units, *orientation.findings, *moved]


def _shapes_of(findings: list[Finding]) -> set[int]:
    return {n for finding in findings for n in finding.shapes}


def _examine_variety(shapes: ShapeSequence, facts: dict[str, Any], label: Labels) -> list[Finding]:
    """Findings about too few shapes, and shapes that are all alike or repeated."""
    duplicates = _duplicates(shapes.vertices)
    facts["duplicate_shapes"] = [list(pair) for pair in duplicates]
    if len(shapes) < 2:
        return [
            Finding(
                "error",
                "few",
                f"{len(shapes)} shape, expected at least 2 to learn from; add shapes",
            )
        ]
    if _all_rigid(shapes.vertices, RIGID_TOLERANCE * facts["bounding_diagonal"]["max"]):
        return [
            Finding(
                "error",
                "rigid",
                f"all {len(shapes)} shapes equal shape 0 up to rigid motion, expected "
                "deformation; add shapes that differ",
            )
        ]
    findings = []
    if len(shapes) < _FEW:
        findings.append(
            Finding(
                "info",
                "few",
                f"{len(shapes)} shapes: errors of poses like none of them fall as shapes are "
                f"added, up to a few dozen; add others that differ, at best to {_FEW} or more "
                "(fewer components gain little)",
            )
        )
    if not duplicates:
        return findings
    first, second = duplicates[0]
    return [
        *findings,
        Finding(
            "warning",
            "repeated",
            f"shapes that repeat an earlier one: {len(duplicates)}, e.g. {label([second])} equals "
            f"{label([first])}, expected none; remove the copies",
            tuple(later for _, later in duplicates),
        ),
    ]


def _all_rigid(vertices: Rows, tolerance: float) -> bool:
    first = vertices[0]
    for n in range(1, len(vertices)):
        shape = vertices[n]
        R, t = procrustes(first, shape)
        residual = first @ R.T + t - shape
        if np.sqrt((residual**2).sum(axis=1).mean()) > tolerance:
            return False
    return True


def _duplicates(vertices: Rows) -> list[tuple[int, int]]:
    """Pairs (first, later) of shapes with exactly the same positions."""
    seen: dict[bytes, int] = {}
    pairs = []
    for i, shape in enumerate(vertices):
        # Adding zero makes -0.0 and 0.0 the same bytes.
        key = hashlib.sha256((shape + 0.0).tobytes()).digest()
        if key in seen:
            pairs.append((seen[key], i))
        else:
            seen[key] = i
    return pairs
