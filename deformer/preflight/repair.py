"""Safe repairs of sets of shapes: each reports what it did, or why it did nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.checks import checked_instance
from deformer.geometry import FloatArray, IntArray, MeshSequence, align, edges
from deformer.preflight.connectivity import half_edges, isolated_vertices
from deformer.preflight.examination import examine
from deformer.preflight.report import Finding, Labels, Report
from deformer.preflight.statistics import Statistics
from deformer.preflight.vertex_order import find_order

# A shape with two defects, such as another unit and other axes, needs two rounds.
_ROUNDS = 4
_TEMPLATES = 4


@dataclass(frozen=True, eq=False)
class Repair:
    """A repaired set of shapes.

    Args:
        shapes: the set; the shapes are as many and in the same order.
        done: a line for everything that was changed, and for what could not be.
        changed: indices of the shapes whose vertices moved or changed their order.
        kept: (V',) the former indices of the vertices that are left.
        faces_changed: true if the faces are others than before, or numbered otherwise.
    """

    shapes: MeshSequence
    done: tuple[str, ...]
    changed: frozenset[int]
    kept: IntArray
    faces_changed: bool


def repair_shapes(shapes: MeshSequence, names: Sequence[str] | None = None) -> Repair:
    """Undo what `examine` finds wrong with shapes, as far as that is safe.

    Mirror images and mixed-up axes are brought back, units are made the same, vertices are put in
    the order of the others, vertices without a face are dropped, faces are turned to agree, and
    shapes that turn as a whole are aligned where that helps.
    A shape that is turned as a whole or moved away among quiet neighbours is put back between them.
    Repeated shapes, vertices far off and shapes pressed flat stay as they are.

    Args:
        shapes: at least one shape.
        names: as of `examine`.
    """
    checked_instance(shapes, "shapes", MeshSequence, remedy="load shapes with load_shapes")
    label = Labels(names)
    work = _Work(shapes, label)
    for _ in range(_ROUNDS):
        report = examine(work.shapes, names)
        if not work.mend_shapes(report):
            break
    work.drop_isolated()
    work.orient()
    if turned := examine(work.shapes, names).of_kind("turned"):
        work.align(turned[0])
    return Repair(
        work.shapes,
        tuple(work.done),
        frozenset(work.changed),
        work.kept,
        not np.array_equal(work.shapes.faces, shapes.faces),
    )


class _Work:
    """A set under repair."""

    def __init__(self, shapes: MeshSequence, label: Labels) -> None:
        self.shapes = shapes
        self.label = label
        self.done: list[str] = []
        self.changed: set[int] = set()
        self.kept = np.arange(shapes.vertices.shape[1])
        self._hopeless: set[int] = set()

    def mend_shapes(self, report: Report) -> bool:
        """Repair single shapes by the findings of `report`; true if anything was done."""
        vertices = self.shapes.vertices.copy()
        before = len(self.changed), len(self.done)
        for finding in report.findings:
            shapes = list(finding.shapes)
            if finding.kind in ("mirrored", "axes"):
                vertices[shapes] = vertices[shapes] @ np.array(finding.values["axes"]).T
                what = "mirrored back" if finding.kind == "mirrored" else "axes brought back"
                self._did(shapes, f"{what}: (x, y, z) is now {finding.values['text']}")
            elif finding.kind == "units" and "scale" in finding.values:
                vertices[shapes] *= finding.values["scale"]
                self._did(shapes, f"scaled by {finding.values['scale']:.6g}")
            elif finding.kind == "rotated":
                like, between = (
                    self.shapes.vertices[finding.values[k]] for k in ("like", "between")
                )
                centre = between.mean(axis=(0, 1)) - like.mean(axis=0)
                vertices[shapes] = align(vertices[shapes], like) + centre
                self._did(shapes, "turned back as a whole, and put between its neighbours")
            elif finding.kind == "moved":
                vertices[shapes] += finding.values["by"]
                self._did(shapes, "moved back between its neighbours")
            elif finding.kind == "order":
                self._reorder(finding, report, vertices)
        self.shapes = MeshSequence(vertices, self.shapes.faces, self.shapes.names)
        return before != (len(self.changed), len(self.done))

    def _did(self, shapes: list[int], what: str) -> None:
        self.changed |= set(shapes)
        self.done.append(f"{self.label(shapes)}: {what}")

    def _reorder(self, finding: Finding, report: Report, vertices: FloatArray) -> None:
        n = finding.shapes[0]
        if n in self._hopeless:
            return
        faulty = {m for f in report.findings if f.severity != "info" for m in f.shapes}
        faulty -= {m for f in report.of_kind("repeated") + report.of_kind("turned")
                   for m in f.shapes}  # fmt: skip
        sound = np.array([m for m in range(len(self.shapes)) if m not in faulty], dtype=np.int64)
        found = None
        if len(sound):
            # Shapes near each other in a sequence are the most alike.
            sound = sound[np.argsort(np.abs(sound - n), kind="stable")][:_TEMPLATES]
            measures = Statistics.measure(self.shapes.subset(sound))
            everything = np.arange(vertices.shape[1])
            chosen = np.array(finding.vertices, dtype=np.int64)
            found = find_order(
                vertices[n],
                chosen if len(chosen) else everything,
                [self.shapes.vertices[m] for m in sound],
                edges(self.shapes.faces),
                measures.usual_lengths,
            )
        if found is None:
            self._hopeless.add(n)
            self.done.append(
                f"{self.label([n])}: left as it is, no order of its vertices gives the usual "
                "lengths of edges; export it again with the vertex order of the others"
            )
            return
        moved = int((found != np.arange(len(found))).sum())
        vertices[n] = vertices[n][found]
        self._did([n], f"{moved} vertices put in the order of the others")

    def drop_isolated(self) -> None:
        """Remove vertices without a face."""
        gone = isolated_vertices(self.shapes.faces, self.shapes.vertices.shape[1])
        if not len(gone):
            return
        used = np.ones(self.shapes.vertices.shape[1], dtype=bool)
        used[gone] = False
        self._keep(used, self.shapes.faces)
        self.done.append(f"all shapes: {len(gone)} vertices without a face removed")

    def _keep(self, used: np.ndarray, faces: IntArray) -> None:
        number = np.cumsum(used) - 1
        self.kept = self.kept[used]
        self.shapes = MeshSequence(self.shapes.vertices[:, used], number[faces], self.shapes.names)

    def orient(self) -> None:
        """Turn faces to agree with their neighbours; in each piece the smaller part turns."""
        turned, unorientable = _turned_faces(self.shapes.faces)
        if turned.any():
            faces = self.shapes.faces.copy()
            faces[turned] = faces[turned][:, ::-1]
            self.shapes = MeshSequence(self.shapes.vertices, faces, self.shapes.names)
            self.done.append(f"all shapes: {turned.sum()} faces turned to agree with the others")
        if unorientable:
            self.done.append(
                f"pieces whose faces cannot all agree, as of a Möbius strip: {unorientable}, left "
                "as they are; cut them open"
            )

    def align(self, finding: Finding) -> None:
        """Move all shapes rigidly to the first, as training with alignment does."""
        vertices = align(self.shapes.vertices, self.shapes.vertices[0])
        vertices[0] = self.shapes.vertices[0]
        self.shapes = MeshSequence(vertices, self.shapes.faces, self.shapes.names)
        self._did(
            list(range(1, len(vertices))),
            f"aligned with shape 0, {len(finding.shapes)} of them turned back by more than 90°",
        )


def _crowded(faces: IntArray) -> int:
    """Number of edges with more than two faces."""
    half = np.sort(half_edges(faces), axis=1)
    return int((np.unique(half, axis=0, return_counts=True)[1] > 2).sum())


def _turned_faces(faces: IntArray) -> tuple[np.ndarray, int]:
    """Faces (F,) to turn so that neighbours agree, and the number of pieces where they cannot."""
    F = len(faces)
    half = half_edges(faces)
    keys = np.sort(half, axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    keys, half, face = keys[order], half[order], np.tile(np.arange(F), 3)[order]
    same = (keys[1:] == keys[:-1]).all(axis=1) & (keys[1:, 0] != keys[1:, 1])
    pair = np.flatnonzero(same & ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False])
    one, other = face[pair], face[pair + 1]
    agree = np.where(half[pair, 0] != half[pair + 1, 0], 1, -1)
    graph = sparse.csr_array((np.ones(len(pair)), (one, other)), shape=(F, F))
    count, piece = csgraph.connected_components(graph, directed=False)
    # Signs spread along a tree of neighbours, of any pair of faces that share several edges by one.
    relation: dict[tuple[int, int], int] = {}
    for a, b, s in zip(one.tolist(), other.tolist(), agree.tolist(), strict=True):
        relation[a, b] = relation[b, a] = s
    sign = np.zeros(F, dtype=np.int64)
    for root in np.unique(piece, return_index=True)[1].tolist():
        sign[root] = 1
        nodes, parents = csgraph.breadth_first_order(graph, root, directed=False)
        for node in nodes[1:].tolist():
            parent = int(parents[node])
            sign[node] = sign[parent] * relation[parent, node]
    bad = np.unique(piece[one[sign[one] * sign[other] != agree]])
    negative = np.bincount(piece, sign < 0, count) * 2 > np.bincount(piece, minlength=count)
    turned = (sign < 0) != negative[piece]
    turned[np.isin(piece, bad)] = False
    return turned, len(bad)
