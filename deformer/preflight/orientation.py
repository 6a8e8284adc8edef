"""Shapes that are mirrored, have their axes mixed up, or are turned as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from deformer.geometry import FloatArray, axes_text, procrustes
from deformer.preflight.axes import undoing
from deformer.preflight.handedness import mirrored as find_mirrored
from deformer.preflight.local_rotations import (
    LocalRotations,
    distances,
    face_frames,
    rotation_angles,
)
from deformer.preflight.report import Finding, Labels
from deformer.preflight.statistics import Statistics, evenly
from deformer.preflight.turns import rotated
from deformer.workspace import Rows

LARGE_ROTATION = np.pi / 2
_REFLECTION = np.array([-1.0, 1.0, 1.0])
# Aligning helps if it multiplies the distance from shape 0's local rotations by at most these
# factors: that of a turned shape, and the sum over all shapes. Where shapes bend far, aligning
# harms although it brings them a little closer.
_CLOSER, _ALL_CLOSER = 0.5, 1 / 3
# Faces that local rotations are compared at; of many shapes fewer, so that all shapes' numbers
# together are bounded.
_FRAMES, _LEAST_FRAMES, _ALL_FRAMES = 600, 60, 1_200_000


@dataclass(frozen=True)
class Orientation:
    """Findings about orientation, and facts for the report."""

    findings: list[Finding]
    facts: dict[str, Any]


def examine_orientation(measures: Statistics, excluded: set[int], label: Labels) -> Orientation:
    """Compare the orientations of shapes.

    Args:
        measures: of the shapes.
        excluded: shapes that something else is wrong with.
        label: names shapes.
    """
    vertices = measures.shapes.vertices
    kept = np.array([n for n in range(len(vertices)) if n not in excluded], dtype=np.int64)
    findings: list[Finding] = []
    frames = min(_FRAMES, max(_LEAST_FRAMES, _ALL_FRAMES // len(vertices)))
    faces = measures.sampled_faces[evenly(len(measures.sampled_faces), frames)]
    local = LocalRotations.of(vertices, faces)
    mirrored = find_mirrored(measures, kept)
    local.frames[mirrored] = face_frames(vertices[mirrored] * _REFLECTION, faces)
    good = np.setdiff1d(kept, mirrored)
    undone = undoing(local, good, mirrored)
    for n, P in undone.items():
        # Of the shape as it is: mirrored ones were compared after x → −x.
        change = P * _REFLECTION if n in mirrored else P
        text = axes_text(change)
        if n in mirrored:
            what = f"mirrored, expected as the others are; ({text}) of its (x, y, z) brings it back"
        else:
            what = (
                "its axes are mixed up, expected those of the others; it is near them as "
                f"({text}) of its (x, y, z)"
            )
        kind = "mirrored" if n in mirrored else "axes"
        values = {"axes": change.tolist(), "text": f"({text})"}
        findings.append(Finding("warning", kind, f"{label([n])}: {what}", (n,), values=values))
    single = rotated(local, np.setdiff1d(good, list(undone)), label)
    findings = _merged(findings, label) + single
    angles, K = _rigid_fits(vertices)
    facts: dict[str, Any] = {"largest_rotation": float(angles.max())}
    odd = {*undone, *(n for finding in single for n in finding.shapes)}
    if 0 in excluded or 0 in odd:
        return Orientation(findings, facts)
    others = np.setdiff1d(good, list(odd))
    C, _ = local.between(others, 0)
    before, after = distances(C), distances(C, K[others])
    facts["local_rotations"] = {"as_they_are": float(before.mean()), "aligned": float(after.mean())}
    turned = others[(angles[others] > LARGE_ROTATION) & (after < _CLOSER * before)]
    if len(turned) and after.sum() < _ALL_CLOSER * before.sum():
        worst = turned[angles[turned].argmax()]
        more, limit = len(turned) - 1, np.degrees(LARGE_ROTATION)
        others_text = f", as are {more} more by over {limit:.0f}°" if more else ""
        findings.append(
            Finding(
                "warning",
                "turned",
                f"{label([worst])} is turned by {np.degrees(angles[worst]):.0f}° as a whole "
                f"against shape 0{others_text}; aligning all brings their local rotations "
                f"{before.sum() / max(after.sum(), 1e-9):.2g} times closer, so train with --align "
                "(align_shapes=True) if the turns mean nothing",
                tuple(turned.tolist()),
            )
        )
    return Orientation(findings, facts)


def _merged(findings: list[Finding], label: Labels) -> list[Finding]:
    """One finding for all shapes with the same defect and the same remedy."""
    groups: dict[str, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(f"{finding.kind} {finding.values}", []).append(finding)
    merged = []
    for group in groups.values():
        first = group[0]
        if len(group) == 1:
            merged.append(first)
            continue
        shapes = tuple(n for finding in group for n in finding.shapes)
        message = first.message.replace(label(first.shapes), label(shapes), 1)
        merged.append(Finding(first.severity, first.kind, message, shapes, values=first.values))
    return merged


def _rigid_fits(vertices: Rows) -> tuple[FloatArray, FloatArray]:
    """Angle (N,) of the best rotation from shape 0 to each shape, and that rotation (N, 3, 3)."""
    first = vertices[0]
    R = np.array([procrustes(first, shape)[0] for shape in vertices])
    return rotation_angles(R), R
