"""Shapes unlike the others in size, thickness or vertex order, and single vertices far off."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from deformer.checks import rounded
from deformer.geometry import FloatArray, IntArray
from deformer.preflight.report import Finding, Labels
from deformer.preflight.statistics import Statistics

# Factor between two units: the names of the larger and of the smaller one.
_UNITS = (
    (1e6, "metres", "micrometres"),
    (1000.0, "metres", "millimetres"),
    (304.8, "feet", "millimetres"),
    (100.0, "metres", "centimetres"),
    (39.3700787, "metres", "inches"),
    (30.48, "feet", "centimetres"),
    (25.4, "inches", "millimetres"),
    (12.0, "feet", "inches"),
    (10.0, "centimetres", "millimetres"),
    (3.2808399, "metres", "feet"),
    (2.54, "inches", "centimetres"),
)
_UNIT_TOLERANCE = 0.1
# A size that no unit explains is reported from the factor _OTHER_SIZE on. Sizes without a gap of
# the factor _GAP between them belong to one motion.
_OTHER_SIZE = 4.0
_GAP = 1.6
# Typical edge over the radius of the shape: that of vertices in random order, at least.
_RANDOM_EDGE = 0.35
# A vertex has changed places if another is this much nearer to the middle of its neighbours.
_NEARER = 0.5
# A vertex lies beside another within so many typical edges.
_BESIDE = 2.0
# Part of the vertices from which on those far off are taken for vertices in another order.
_MANY = 0.1
# A shape is pressed flat if its thickness over the usual one is below _FLAT. The usual thickness
# over the length must be above _THICK: in a set of flat shapes, none is a defect.
_FLAT, _THICK = 1e-2, 1e-2
# Thickness over the length that is rounding alone.
_LINE = 1e-9
# A sheet that lies flat keeps its lengths; a body that is pressed flat loses many.
# Part of a flat shape's area that has its other side up when it is no sheet.
_BACK = 0.05
_LOST_LENGTH, _LOST_EDGES = 0.5, 0.05


def points(extents: FloatArray, label: Labels) -> list[Finding]:
    """An error for shapes with all vertices at one point.

    Args:
        extents: (N, 3) of the shapes' bounding boxes.
        label: names shapes.
    """
    found = np.flatnonzero(extents.max(axis=1) == 0)
    if not len(found):
        return []
    return [
        Finding(
            "error",
            "point",
            f"{label(found.tolist())}: all vertices lie at one point, expected a surface; remove "
            "the shape or export it again",
            tuple(found.tolist()),
        )
    ]


def reordered(measures: Statistics, label: Labels) -> list[Finding]:
    """Warnings of shapes whose vertices, all or some, are in another order."""
    N = len(measures.scale)
    rough = np.array([measures.roughness(n) for n in range(N)])
    usual = np.sort(rough)[(N - 1) // 2]
    limit = max(_RANDOM_EDGE, min(2.0 * usual, 0.8))
    findings = []
    on_a_line = measures.sigma[:, 1] < _LINE * measures.sigma[:, 0]
    for n in np.flatnonzero(~on_a_line).tolist():
        if rough[n] > max(limit, 1.5 * usual) and measures.spread[n] > 0.25:
            times = rounded(rough[n] / usual)
            findings.append(_order(label, n, None, f"edges are {times} times as "
                                   "long as usual while its size is as usual"))  # fmt: skip
        elif len(measures.far.get(n, ())) > max(5, _MANY * measures.shapes.vertices.shape[1]):
            off = np.union1d(measures.long[n], measures.far[n])
            findings.append(_order(label, n, off, f"{len(off)} vertices lie far from their "
                                   "neighbours"))  # fmt: skip
        elif n in measures.long and len(off := _exchanged(measures, n, measures.long[n])):
            findings.append(_order(label, n, off, f"{len(off)} vertices, e.g. {off[0]}, lie where "
                                   "others of them belong"))  # fmt: skip
        elif n in measures.far and len(off := _elsewhere(measures, n, measures.long[n])):
            findings.append(_order(label, n, None, f"{len(off)} vertices, e.g. {off[0]}, lie on a "
                                   "part of the surface that is not theirs"))  # fmt: skip
    return findings


def _order(label: Labels, n: int, off: IntArray | None, reason: str) -> Finding:
    what = "its vertices" if off is None else "some of its vertices"
    return Finding(
        "warning",
        "order",
        f"{label([n])}: {reason}, so {what} are in another order, expected one order in all "
        "shapes; export it again with the vertex order of the others",
        (n,),
        () if off is None else tuple(off.tolist()),
    )


def _exchanged(measures: Statistics, n: int, long: IntArray) -> IntArray:
    """All of the vertices `long` if most of their places are taken by others of them, else none.

    The place of a vertex is the middle of its neighbours.
    """
    p = measures.shapes.vertices[n]
    middles, known = ring_middles(p, measures.edges, long)
    if known.sum() < 2:
        return long[:0]
    typical = measures.scale[n] * np.median(measures.usual_lengths)
    distance, nearest = map(np.asarray, KDTree(p[long]).query(middles))
    own = np.linalg.norm(p[long] - middles, axis=1)
    # Another one of them is in its place, and it is not.
    taken = known & (distance < _NEARER * own) & (distance < 2.0 * typical)
    share = len(np.unique(nearest[taken])) / known.sum()
    return long if taken.sum() > 1 and share > 0.5 else long[:0]


def _elsewhere(measures: Statistics, n: int, long: IntArray) -> IntArray:
    """Those of the vertices `long` that lie beside vertices far from them on the surface.

    None unless they are most of `long`, and at least two. An order that is shifted gives this: all
    but a few vertices are near their neighbours nevertheless.
    """
    p, pairs = measures.shapes.vertices[n], measures.edges
    typical = measures.scale[n] * np.median(measures.usual_lengths)
    # Several at one place are lost ones, put at the origin for example.
    _, place, count = np.unique(p[long], axis=0, return_inverse=True, return_counts=True)
    alone = count[place.ravel()] == 1
    near = KDTree(p).query_ball_point(p[long], _BESIDE * typical)
    beside = np.zeros(len(long), dtype=bool)
    for k in np.flatnonzero(alone):
        around = pairs[np.isin(pairs, pairs[(pairs == long[k]).any(axis=1)]).any(axis=1)]
        beside[k] = len(np.setdiff1d(near[k], around)) > 0
    return long[beside] if beside.sum() > max(1, len(long) // 2) else long[:0]


def ring_middles(p: FloatArray, edges: IntArray, chosen: IntArray) -> tuple[FloatArray, np.ndarray]:
    """Mean positions (n, 3) of neighbours outside of `chosen` (n,), and true (n,) if any."""
    inside = np.zeros(len(p), dtype=bool)
    inside[chosen] = True
    total, count = np.zeros((len(p), 3)), np.zeros(len(p))
    for one, other in (edges.T, edges.T[::-1]):
        kept = inside[one] & ~inside[other]
        np.add.at(total, one[kept], p[other[kept]])
        np.add.at(count, one[kept], 1.0)
    known = count[chosen] > 0
    return total[chosen] / np.maximum(count[chosen], 1.0)[:, None], known


def far_vertices(measures: Statistics, excluded: set[int], label: Labels) -> list[Finding]:
    """Warnings of single vertices far from their neighbours."""
    findings = []
    for n, off in measures.far.items():
        if n in excluded:
            continue
        place = np.round(measures.shapes.vertices[n, off[0]], 6).tolist()
        findings.append(
            Finding(
                "warning",
                "far",
                f"{label([n])}: {len(off)} "
                f"{'vertices lie' if len(off) > 1 else 'vertex lies'} far from the neighbours, "
                f"e.g. vertex {off[0]} at {place}, expected edges of about the usual length; "
                "correct the positions or remove the shape",
                (n,),
                tuple(off.tolist()),
            )
        )
    return findings


def sizes(measures: Statistics, excluded: set[int], label: Labels) -> list[Finding]:
    """Warnings of shapes in other units, or of another size than all others."""
    kept = np.array([n for n in range(len(measures.scale)) if n not in excluded], dtype=np.int64)
    if len(kept) < 2:
        return []
    logs = np.log(measures.scale[kept])
    order = np.argsort(logs, kind="stable")
    group = np.empty(len(kept), dtype=np.int64)
    group[order] = np.cumsum(np.concatenate([[0], np.diff(logs[order]) > np.log(_GAP)]))
    count = np.bincount(group)
    main = group[0] if count[group[0]] == count.max() else count.argmax()
    usual = np.exp(np.median(logs[group == main]))
    usual_radius = np.median(measures.radius[kept][group == main])
    findings = []
    for other in np.flatnonzero(np.arange(len(count)) != main):
        members = kept[group == other]
        ratio = float(np.exp(np.median(logs[group == other])) / usual)
        size = float(np.median(measures.radius[members]) / usual_radius)
        # Another unit scales all edges alike; a small factor may also be a motion.
        uniform = np.median(measures.spread[members]) < 0.15 or not 0.2 < ratio < 5.0
        if not (0.4 < size / ratio < 2.5 and uniform):
            continue
        unit = _unit(ratio)
        if unit is None and 1.0 / _OTHER_SIZE < ratio < _OTHER_SIZE:
            continue
        found = (int(n) for n in members)
        verb = "is" if len(members) == 1 else "are"
        text = f"{label(members.tolist())} {verb} {rounded(ratio)} times as large as the others"
        if unit is None:
            text += (
                ", a factor between no two usual units, expected about 1; export again, or scale "
                f"by {1 / ratio:.4g}"
            )
        else:
            text += (
                f", as if in {unit[1]} where they are in {unit[2]}, expected the same units; scale "
                f"by {1 / unit[0]:.4g}"
            )
        values = {} if unit is None else {"scale": 1 / unit[0]}
        findings.append(Finding("warning", "units", text, tuple(found), values=values))
    return findings


def _unit(ratio: float) -> tuple[float, str, str] | None:
    """The factor between two units nearest to `ratio`, the unit found, and the usual one."""
    for factor, large, small in _UNITS:
        if abs(np.log(ratio / factor)) < _UNIT_TOLERANCE:
            return factor, small, large
        if abs(np.log(ratio * factor)) < _UNIT_TOLERANCE:
            return 1 / factor, large, small
    return None


def flattened(measures: Statistics, excluded: set[int], label: Labels) -> list[Finding]:
    """Warnings of shapes pressed to a plane or a line; an error if no shape is a surface."""
    sigma = measures.sigma
    relative = sigma[:, 1:] / np.maximum(sigma[:, :1], 1e-300)
    if (relative[:, 0] < _LINE).all():
        return [
            Finding(
                "error",
                "line",
                "the vertices of every shape lie on a line, expected surfaces; export them again",
            )
        ]
    usual = np.median(relative, axis=0)
    findings = []
    if (relative[:, 1] < _LINE).all():
        return _all_flat(measures)
    for n in (n for n in range(len(sigma)) if n not in excluded):
        thin = (relative[n] < _FLAT * usual) & (usual > _THICK)
        if not thin.any() or not _lost_lengths(measures, n):
            continue
        if not thin[0] and not _has_two_sides(measures, n):
            continue  # a sheet that lies flat, and stretches where it bulges
        what = "line" if thin[0] else "plane"
        findings.append(
            Finding(
                "warning",
                "flat",
                f"{label([n])}: pressed flat to a {what}, expected a thickness of about "
                f"{usual[0 if thin[0] else 1] * sigma[n, 0]:.3g}; remove the shape or export it "
                "again",
                (n,),
            )
        )
    return findings


def _all_flat(measures: Statistics) -> list[Finding]:
    """A warning if all shapes lie in planes with faces of both sides up, as a body pressed flat."""
    if not _has_two_sides(measures, 0):
        return []
    return [
        Finding(
            "warning",
            "flat",
            "every shape lies in a plane and has faces of both sides up, as a body pressed flat "
            "does, expected a thickness; export the shapes again with all three coordinates",
        )
    ]


def _has_two_sides(measures: Statistics, n: int) -> bool:
    """True if a flat shape has faces of both sides up, as a body that is pressed flat."""
    faces = measures.sampled_faces
    a, b, c = (measures.shapes.vertices[n][faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1).sum()
    return bool(np.linalg.norm(normals.sum(axis=0)) <= (1 - 2 * _BACK) * area)


def _lost_lengths(measures: Statistics, n: int) -> bool:
    """True if more than a twentieth of the edges are shorter than half their usual lengths."""
    p, pairs = measures.shapes.vertices[n], measures.edges
    found = np.linalg.norm(p[pairs[:, 0]] - p[pairs[:, 1]], axis=1)
    # Lengths cannot grow when a shape is pressed flat: the longest ones tell the scale.
    relative = found / measures.usual_lengths
    scale = np.quantile(relative, 0.95)
    return bool((relative < _LOST_LENGTH * scale).mean() > _LOST_EDGES)
