"""Shapes that are mirrored, have their axes mixed up, or are turned as a whole.

What training sees of a turn is the local rotations: shapes are compared by the mean over faces of
the rotation from one to the other, tr(Pᵀ C) / 3 with C = 1/f Σ_i F_ni F_miᵀ, F the faces' frames.
Where that is near 1, the shapes differ by the rotation P of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
from typing import Any

import numpy as np

from deformer.geometry import (
    FloatArray,
    IntArray,
    closest_rotations,
    connected_components,
    procrustes,
)
from deformer.preflight.connectivity import half_edges
from deformer.preflight.report import Finding, Labels
from deformer.preflight.statistics import Statistics, evenly, face_frames

LARGE_ROTATION = np.pi / 2
# Aligning helps if it multiplies the distance from shape 0's local rotations by at most these
# factors: that of a turned shape, and the sum over all shapes. Where shapes bend far, aligning
# harms although it brings them a little closer.
_CLOSER, _ALL_CLOSER = 0.5, 1 / 3
# A shape's axes are mixed up if undoing it multiplies the distance of its local rotations from
# those of the nearest shape by less than _MUCH_CLOSER, and at most _FEW of all shapes are so.
_MUCH_CLOSER = 0.4
_FEW = 0.3
_LEFT_OVER = np.radians(20.0)
_FRAMES, _EDGES = 600, 2000
_COMPARED = 200
# |mean normal| of a piece from which on it is a sheet, which may bend either way; and the typical
# sine of the angle between its faces below which there is no curvature to judge by.
_SHEET = 0.75
_CURVED = 0.02
# Correlation of curvatures with the usual ones that tells a shape from its mirror image.
_ALIKE = 0.3


def _signed_axes() -> FloatArray:
    """The proper signed permutations (24, 3, 3), the identity first."""
    found = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    proper = [P for P in found if np.linalg.det(P) > 0]
    return np.array(sorted(proper, key=lambda P: -np.trace(P)))


_PROPER_AXES = _signed_axes()


def axes_text(P: FloatArray) -> str:
    """A signed permutation as the coordinates it gives: "-x, y, z" for the mirror image in x."""
    words = []
    for row in P:
        axis = int(np.abs(row).argmax())
        words.append(("-" if row[axis] < 0 else "") + "xyz"[axis])
    return ", ".join(words)


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
    faces = measures.sampled_faces[evenly(len(measures.sampled_faces), _FRAMES)]
    frames = face_frames(vertices, faces)
    count = np.maximum((frames != 0).any(axis=1).sum(axis=1) / 3.0, 1.0)
    mirrored = _mirrored(measures, kept)
    frames[mirrored] = face_frames(vertices[mirrored] * [-1.0, 1.0, 1.0], faces)
    good = np.setdiff1d(kept, mirrored)
    undone = _undoing(frames, count, good, mirrored)
    for n, P in undone.items():
        # Of the shape as it is: mirrored ones were compared after x → −x.
        change = P * np.array([-1.0, 1.0, 1.0]) if n in mirrored else P
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
    angles, K = _rigid_fits(vertices)
    facts: dict[str, Any] = {"largest_rotation": float(angles.max())}
    if 0 in excluded or 0 in undone:
        return Orientation(_merged(findings, label), facts)
    others = np.setdiff1d(good, list(undone))
    C = frames[others] @ frames[0].T / np.minimum(count[others], count[0])[:, None, None]
    before = 1.0 - np.trace(C, axis1=1, axis2=2) / 3.0
    after = 1.0 - np.einsum("nij,nij->n", K[others], C) / 3.0
    facts["local_rotations"] = {"as_they_are": float(before.mean()), "aligned": float(after.mean())}
    turned = others[(angles[others] > LARGE_ROTATION) & (after < _CLOSER * before)]
    if len(turned) and after.sum() < _ALL_CLOSER * before.sum():
        worst = turned[angles[turned].argmax()]
        findings.append(
            Finding(
                "warning",
                "turned",
                f"{label([worst])} is turned by {np.degrees(angles[worst]):.0f}° as a whole "
                f"against shape 0, as are {len(turned) - 1} more by over "
                f"{np.degrees(LARGE_ROTATION):.0f}°; aligning all brings their local rotations "
                f"{before.sum() / max(after.sum(), 1e-9):.2g} times closer, so train with --align "
                "(align_shapes=True) if the turns mean nothing",
                tuple(turned.tolist()),
            )
        )
    return Orientation(_merged(findings, label), facts)


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


def _mirrored(measures: Statistics, kept: IntArray) -> IntArray:
    """Shapes among `kept` (n,) whose surface is curved the other way at the same places.

    The signed angle between faces at an edge changes its sign in a mirror image, and keeps it,
    at most edges, in any other deformation of a body. A sheet may bend either way.
    """
    none = np.empty(0, dtype=np.int64)
    if len(kept) < 3:
        return none
    corners = _across_edges(measures.shapes.faces)
    vertices = measures.shapes.vertices
    if not len(corners) or _is_sheet(measures, kept):
        return none
    h = np.array([_curvatures(vertices[n], corners) for n in kept])
    size = np.sqrt((h**2).mean(axis=1))
    if np.median(size) < _CURVED:
        return none
    h /= np.maximum(size, 1e-12)[:, None] * np.sqrt(h.shape[1])
    # The direction that most shapes agree with up to sign.
    usual = h[0]
    for _ in range(10):
        usual = np.sign(h @ usual) @ h
        usual /= max(float(np.linalg.norm(usual)), 1e-12)
    c = h @ usual
    clear = np.abs(c) > _ALIKE
    if clear.mean() < 0.7:
        return none
    negative = (c < 0) & clear
    positive = (c > 0) & clear
    if negative.sum() > positive.sum() or (negative.sum() == positive.sum() and negative[0]):
        negative = positive
    return kept[negative]


def _across_edges(faces: IntArray) -> IntArray:
    """Corners (e, 4) of inner edges, evenly chosen: the edge, and the tips of its two faces."""
    half = half_edges(faces)
    tips = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    keys = np.sort(half, axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    sorted_keys = keys[order]
    same = (sorted_keys[1:] == sorted_keys[:-1]).all(axis=1)
    # The first of exactly two.
    pair = same & ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False]
    first = np.flatnonzero(pair)
    first = first[evenly(len(first), _EDGES)] if len(first) else first
    one, other = order[first], order[first + 1]
    corners = np.column_stack([half[one], tips[one], tips[other]])
    return corners[(np.diff(np.sort(corners, axis=1), axis=1) > 0).all(axis=1)]


def _curvatures(p: FloatArray, corners: IntArray) -> FloatArray:
    """Sines (e,) of the signed angles at edges: six times the tetrahedron's volume, scaled."""
    a, b, c, d = (p[corners[:, k]] for k in range(4))
    n, m = np.cross(b - a, c - a), np.cross(d - a, b - a)
    edge = np.linalg.norm(b - a, axis=1)
    volume = np.einsum("ei,ei->e", n, d - a)
    scale = np.linalg.norm(n, axis=1) * np.linalg.norm(m, axis=1)
    return np.divide(volume * edge, scale, out=np.zeros(len(p[corners])), where=scale > 0)


def _is_sheet(measures: Statistics, kept: IntArray) -> bool:
    """True if in some shape the normals of each piece point, on the whole, one way."""
    faces = measures.sampled_faces
    piece = connected_components(measures.shapes.faces, measures.shapes.vertices.shape[1])[1]
    piece = piece[faces[:, 0]]
    for n in kept[evenly(len(kept), 33)]:
        a, b, c = (measures.shapes.vertices[n][faces[:, corner]] for corner in range(3))
        normals = np.cross(b - a, c - a)
        total = np.zeros((piece.max() + 1, 3))
        np.add.at(total, piece, normals)
        area = np.linalg.norm(normals, axis=1).sum()
        if np.linalg.norm(total, axis=1).sum() > _SHEET * area:
            return True
    return False


def _undoing(
    frames: FloatArray, count: FloatArray, good: IntArray, mirrored: IntArray
) -> dict[int, FloatArray]:
    """The signed permutation that brings a shape back, for shapes that need one.

    Args:
        frames: (N, 3, 3f) frames of faces; those of mirrored shapes after x → −x.
        count: (N,) numbers of faces whose frames are not zero.
        good: shapes that are not mirrored.
        mirrored: shapes that are.
    """
    if len(good) < 3:
        return {n: np.eye(3) for n in mirrored.tolist()}
    near = _Nearness(frames, count, good, good)
    undone: dict[int, FloatArray] = {}
    while True:
        gain, P = near.best()
        # The oddest first: a shape that is right may look odd only beside one that is not.
        row = int(np.where(gain < _MUCH_CLOSER, near.oddness(), -1.0).argmax())
        if gain[row] >= _MUCH_CLOSER:
            break
        undone[int(good[row])] = P[row]
        near.remove(row)
        if len(undone) > _FEW * len(good):
            # Many orientations: shapes that turn as a whole, by steps or all the way.
            undone = {}
            break
    # Beside one that is not right, its neighbour looked odd; beside the rest it does not.
    if undone:
        chosen = np.array(sorted(undone))
        gain, P = _Nearness(frames, count, chosen, np.setdiff1d(good, chosen)).best()
        undone = {int(n): P[k] for k, n in enumerate(chosen) if gain[k] < _MUCH_CLOSER}
    # A mirrored shape is always brought back, by what brings it nearest.
    if len(mirrored):
        others = np.setdiff1d(good, list(undone))
        _, axes = _Nearness(frames, count, mirrored, others).best()
        undone |= dict(zip(mirrored.tolist(), axes, strict=True))
    return undone


class _Nearness:
    """Distances 1 − tr(P C_nm) / 3 of local rotations of shapes n, after P, from those of m.

    Args:
        frames, count: as in `_undoing`.
        chosen: (n,) shapes.
        others: the shapes to compare with: evenly chosen ones, and the next on either side.
    """

    def __init__(
        self, frames: FloatArray, count: FloatArray, chosen: IntArray, others: IntArray
    ) -> None:
        spaced = others[evenly(len(others), _COMPARED)]
        place = np.searchsorted(others, chosen)
        beside = others[np.clip(place[:, None] + [-1, 1], 0, len(others) - 1)]
        self._compared = np.column_stack([np.tile(spaced, (len(chosen), 1)), beside])
        self._chosen = chosen
        # C_mn (n, m, 3, 3) with m first, the transpose of C_nm.
        f = frames.astype(np.float32)
        among = f[spaced].reshape(-1, f.shape[2]) @ f[chosen].reshape(-1, f.shape[2]).T
        among = among.reshape(len(spaced), 3, len(chosen), 3).transpose(2, 0, 1, 3)
        next_to = f[beside] @ f[chosen].transpose(0, 2, 1)[:, None]
        C = np.concatenate([among, next_to], axis=1)
        C /= np.minimum(count[self._compared], count[chosen][:, None])[..., None, None]
        axes = _PROPER_AXES.astype(np.float32).reshape(24, 9)
        self._distance = 1.0 - np.tensordot(axes, C.reshape(*C.shape[:2], 9), axes=(1, 2)) / 3.0
        self._C = C
        self._distance[:, self._compared == chosen[:, None]] = np.inf

    def remove(self, row: int) -> None:
        """Compare neither the shape of a row nor others with it."""
        self._distance[:, self._compared == self._chosen[row]] = np.inf
        self._distance[0, row] = 0.0

    def best(self) -> tuple[FloatArray, FloatArray]:
        """For each shape how much nearer the best P (n, 3, 3) brings it, as a quotient (n,).

        The quotient is 1 where a turn as a whole remains, so that it was not of the axes.
        """
        least = np.maximum(self._distance.min(axis=2), 1e-6)
        q, rows = least.argmin(axis=0), np.arange(len(self._chosen))
        P, gain = _PROPER_AXES[q], least.min(axis=0) / least[0]
        nearest = self._distance[q, rows].argmin(axis=1)
        remaining = closest_rotations(self._C[rows, nearest] @ P.transpose(0, 2, 1))
        gain[_angles(remaining) > _LEFT_OVER] = 1.0
        return gain, P

    def oddness(self) -> FloatArray:
        """Median distance (n,) of each shape as it is from the others."""
        return np.median(self._distance[0], axis=1)


def _rigid_fits(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle (N,) of the best rotation from shape 0 to each shape, and that rotation (N, 3, 3)."""
    R = np.array([procrustes(vertices[0], shape)[0] for shape in vertices])
    return _angles(R), R


def _angles(R: FloatArray) -> FloatArray:
    """Angles (n,) of rotations (n, 3, 3), in radians."""
    # ‖R − I‖_F = 2√2 sin(θ/2), exact for small angles where the trace is not.
    chord = np.linalg.norm(R - np.eye(3), axis=(1, 2)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))
