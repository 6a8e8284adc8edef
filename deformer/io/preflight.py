"""Preflight report: defects of a set of shapes that would harm training, with their remedies."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.geometry import FloatArray, IntArray, MeshSequence, connected_components

# Residual of a rigid fit, in bounding diagonals, that the rounding of float32 data explains.
RIGID_TOLERANCE = 1e-5
# Ratio of mean edge lengths: bending preserves them, another unit or vertex order does not.
SCALE_FACTOR = 2.0
LARGE_ROTATION = np.pi / 2
_DEGENERATE_AREA = 1e-12

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True)
class Finding:
    """One observation.

    Args:
        severity: "error" when training cannot work, "warning" when it may suffer, or "info".
        message: one line: the defect, where it is, what was expected, and the remedy.
    """

    severity: Severity
    message: str


@dataclass(frozen=True)
class Report:
    """Result of `examine`.

    Args:
        findings: errors first, then warnings, then information.
        facts: counts and measures by name; lengths in the units of the data, angles in radians.
    """

    findings: tuple[Finding, ...]
    facts: dict[str, Any]

    @property
    def usable(self) -> bool:
        """True if there is no error."""
        return all(finding.severity != "error" for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """The report as dictionaries and lists, for JSON."""
        return {
            "usable": self.usable,
            "facts": dict(self.facts),
            "findings": [asdict(finding) for finding in self.findings],
        }


def examine(shapes: MeshSequence) -> Report:
    """Check shapes before training; shape 0 is the reference.

    Args:
        shapes: at least one shape.

    Returns:
        A report. Facts: shapes, vertices, faces, components and isolated_vertices (a vertex
        without a face is no component), boundary_loops (connected pieces of the border),
        non_manifold_edges (more than two faces), inconsistent_orientation (edges that both faces
        traverse in the same direction), degenerate_faces and coincident_vertices (of the
        reference; of coincident vertices all but one), bounding_diagonal {min, max},
        duplicate_shapes (pairs, the earlier first), largest_rotation (radians, of the best rigid
        fit to the reference).
    """
    findings: list[Finding] = []
    facts: dict[str, Any] = {
        "shapes": len(shapes),
        "vertices": shapes.vertices.shape[1],
        "faces": len(shapes.faces),
    }
    _examine_connectivity(shapes.faces, shapes.vertices.shape[1], facts, findings)
    _examine_reference(shapes, facts, findings)
    _examine_sizes(shapes, facts, findings)
    _examine_motion(shapes, facts, findings)
    rank = {"error": 0, "warning": 1, "info": 2}
    return Report(tuple(sorted(findings, key=lambda finding: rank[finding.severity])), facts)


def _examine_connectivity(
    faces: IntArray, vertex_count: int, facts: dict[str, Any], findings: list[Finding]
) -> None:
    isolated = np.setdiff1d(np.arange(vertex_count), faces)
    # A vertex without a face is a component of its own to the graph.
    components = connected_components(faces, vertex_count)[0] - len(isolated)
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
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
        "boundary_loops": _loop_count(pairs[uses == 1], vertex_count),
        "non_manifold_edges": len(non_manifold),
        "isolated_vertices": len(isolated),
        "inconsistent_orientation": len(inconsistent),
    }
    if len(non_manifold):
        findings.append(
            Finding(
                "warning",
                f"edges with more than two faces: {len(non_manifold)}, e.g. "
                f"{non_manifold[0].tolist()}, expected none; split the surface there or remove "
                "double faces",
            )
        )
    if len(inconsistent):
        findings.append(
            Finding(
                "warning",
                f"edges between faces of opposite orientation: {len(inconsistent)}, e.g. "
                f"{inconsistent[0].tolist()}, expected all faces counter-clockwise from outside; "
                "recalculate the normals in every shape alike",
            )
        )
    if len(isolated):
        findings.append(
            Finding(
                "warning",
                f"vertices without a face: {len(isolated)}, e.g. vertex {isolated[0]}, expected "
                "none; they cannot follow the surface, remove them from all shapes",
            )
        )
    if components > 1:
        findings.append(
            Finding(
                "warning",
                f"connected components: {components}, expected 1; each moves on its own, weld "
                "seams or keep the largest component",
            )
        )
    if facts["boundary_loops"]:
        findings.append(
            Finding(
                "info",
                f"the surface is open, boundary loops: {facts['boundary_loops']}; nothing to do",
            )
        )


def _loop_count(border: IntArray, vertex_count: int) -> int:
    """Number of connected pieces of the border edges (B, 2)."""
    graph = sparse.csr_array(
        (np.ones(len(border)), (border[:, 0], border[:, 1])), shape=(vertex_count, vertex_count)
    )
    labels = csgraph.connected_components(graph, directed=False)[1]
    return len(np.unique(labels[border]))


def _examine_reference(
    shapes: MeshSequence, facts: dict[str, Any], findings: list[Finding]
) -> None:
    reference, faces = shapes.vertices[0], shapes.faces
    a, b, c = (reference[faces[:, corner]] for corner in range(3))
    double_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    degenerate = np.flatnonzero(double_area <= _DEGENERATE_AREA * longest)
    _, first, label = np.unique(reference + 0.0, axis=0, return_index=True, return_inverse=True)
    coincident = np.flatnonzero(first[label.ravel()] != np.arange(len(reference)))
    facts |= {"degenerate_faces": len(degenerate), "coincident_vertices": len(coincident)}
    if len(degenerate):
        findings.append(
            Finding(
                "warning",
                f"faces of shape 0 without area: {len(degenerate)}, e.g. face {degenerate[0]} "
                f"{faces[degenerate[0]].tolist()}, expected none; collapse them in all shapes",
            )
        )
    if len(coincident):
        other = first[label.ravel()][coincident[0]]
        findings.append(
            Finding(
                "warning",
                f"vertices of shape 0 that lie on another: {len(coincident)}, e.g. "
                f"{coincident[0]} on {other}, expected none; weld seams in all shapes alike",
            )
        )


def _examine_sizes(shapes: MeshSequence, facts: dict[str, Any], findings: list[Finding]) -> None:
    diagonals = np.array([float(np.linalg.norm(np.ptp(v, axis=0))) for v in shapes.vertices])
    half = np.concatenate([shapes.faces[:, [0, 1]], shapes.faces[:, [1, 2]]])
    edges = np.array(
        [np.linalg.norm(v[half[:, 0]] - v[half[:, 1]], axis=1).mean() for v in shapes.vertices]
    )
    facts["bounding_diagonal"] = {"min": float(diagonals.min()), "max": float(diagonals.max())}
    for i in np.flatnonzero(diagonals == 0):
        findings.append(
            Finding(
                "error",
                f"shape {i}: all vertices lie at one point, expected a surface; remove the shape "
                "or export it again",
            )
        )
    if (diagonals == 0).any():
        return
    # The lower median is the value of an existing shape, even when there are two.
    usual = np.sort(edges)[(len(edges) - 1) // 2]
    usual_diagonal = np.sort(diagonals)[(len(diagonals) - 1) // 2]
    for i in np.flatnonzero((edges > SCALE_FACTOR * usual) | (edges * SCALE_FACTOR < usual)):
        ratio, size = edges[i] / usual, diagonals[i] / usual_diagonal
        if size > ratio / 2 and size < ratio * 2:
            remedy = f"bring it to the units of the others (scale by {1 / ratio:.3g})"
        else:
            remedy = "its size is as usual, so its vertices are probably in another order"
        findings.append(
            Finding(
                "warning",
                f"shape {i}: edges are {ratio:.3g} times as long as in the other shapes, expected "
                f"about 1; {remedy}",
            )
        )


def _examine_motion(shapes: MeshSequence, facts: dict[str, Any], findings: list[Finding]) -> None:
    angles, residuals = _rigid_fits(shapes.vertices)
    duplicates = _duplicates(shapes.vertices)
    facts |= {
        "duplicate_shapes": [list(pair) for pair in duplicates],
        "largest_rotation": float(angles.max()),
    }
    if len(shapes) < 2:
        findings.append(
            Finding("error", f"{len(shapes)} shape, expected at least 2 to learn from; add shapes")
        )
        return
    size = facts["bounding_diagonal"]["max"]
    if (residuals <= RIGID_TOLERANCE * size).all():
        findings.append(
            Finding(
                "error",
                f"all {len(shapes)} shapes equal shape 0 up to rigid motion, expected "
                "deformation; add shapes that differ",
            )
        )
    elif duplicates:
        first, second = duplicates[0]
        findings.append(
            Finding(
                "warning",
                f"shapes that repeat an earlier one: {len(duplicates)}, e.g. shape {second} equals "
                f"shape {first}, expected none; remove the copies",
            )
        )
    if angles.max() > LARGE_ROTATION:
        findings.append(
            Finding(
                "warning",
                f"shape {angles.argmax()} is turned by {np.degrees(angles.max()):.0f}° as a whole "
                f"against shape 0, expected at most {np.degrees(LARGE_ROTATION):.0f}°; train "
                "with --align (align_shapes=True) if the turn means nothing",
            )
        )


def _rigid_fits(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle (N,) of the best rotation from shape 0 to each shape, and the RMS residual (N,).

    Kabsch: R = U diag(1, 1, det U Vᵀ) Vᵀ from the singular vectors of Σ_i p_i v_iᵀ, centred.
    """
    reference = vertices[0] - vertices[0].mean(axis=0)
    angles, residuals = np.empty(len(vertices)), np.empty(len(vertices))
    for n, shape in enumerate(vertices):
        centred = shape - shape.mean(axis=0)
        u, _, vt = np.linalg.svd(centred.T @ reference)
        u[:, 2] *= np.sign(np.linalg.det(u @ vt))
        rotation = u @ vt
        # ‖R − I‖_F = 2√2 sin(θ/2), exact for small angles where the trace is not.
        chord = np.linalg.norm(rotation - np.eye(3)) / np.sqrt(8.0)
        angles[n] = 2 * np.arcsin(min(chord, 1.0))
        residuals[n] = np.sqrt(((centred - reference @ rotation.T) ** 2).sum(axis=1).mean())
    return angles, residuals


def _duplicates(vertices: FloatArray) -> list[tuple[int, int]]:
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
