"""The preflight report finds what is wrong with shapes that are wrong in a known way."""

import json

import numpy as np
import pytest

from deformer import MeshSequence, load_shapes
from deformer.preflight import examine
from paths import DATA


def grid(rows=6, columns=5):
    """A flat open rectangle of triangles."""
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    quads = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    return vertices, np.concatenate(quads)


def bent(vertices, amount):
    return vertices + amount * vertices[:, :1] ** 2 * np.array([0, 0, 1.0])


def rotation(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def healthy(count=4):
    vertices, faces = grid()
    return MeshSequence(np.stack([bent(vertices, 0.05 * i) for i in range(count)]), faces)


def messages(report, severity):
    found = [finding.message for finding in report.findings if finding.severity == severity]
    assert all("\n" not in message for message in found)
    return found


def the_message(shapes, severity):
    """The only message of that severity."""
    (message,) = messages(examine(shapes), severity)
    return message


def with_faces(shapes, extra):
    return MeshSequence(shapes.vertices, np.concatenate([shapes.faces, extra]))


def test_healthy_shapes_have_counts_and_no_complaint():
    report = examine(healthy())
    assert report.usable
    assert messages(report, "error") == messages(report, "warning") == []
    assert "boundary loops: 1" in report.of_kind("open")[0].message
    assert {finding.kind for finding in report.findings} == {"open", "few"}
    diagonals = [np.linalg.norm(np.ptp(v, axis=0)) for v in healthy().vertices]
    expected = {
        "shapes": 4,
        "vertices": 30,
        "faces": 40,
        "components": 1,
        "boundary_loops": 1,
        "non_manifold_edges": 0,
        "isolated_vertices": 0,
        "inconsistent_orientation": 0,
        "degenerate_faces": 0,
        "coincident_vertices": 0,
        "bounding_diagonal": {"min": min(diagonals), "max": max(diagonals)},
        "duplicate_shapes": [],
    }
    assert {name: report.facts[name] for name in expected} == expected


def test_closed_surface_has_no_boundary():
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    vertices = np.random.default_rng(0).normal(size=(3, 4, 3))
    report = examine(MeshSequence(vertices, faces))
    assert report.facts["boundary_loops"] == 0
    assert report.facts["inconsistent_orientation"] == 0


def test_hole_is_a_second_boundary_loop():
    shapes = healthy()
    middle = np.flatnonzero((shapes.faces == 12).any(axis=1))
    holed = MeshSequence(shapes.vertices, np.delete(shapes.faces, middle, axis=0))
    report = examine(holed)
    assert report.facts["boundary_loops"] == 2
    assert report.facts["isolated_vertices"] == 1
    assert report.of_kind("isolated")[0].vertices == (12,)


def test_report_is_json():
    report = examine(healthy())
    data = json.loads(json.dumps(report.as_dict()))
    assert data["usable"] is True
    assert data["facts"] == report.facts
    assert data["findings"][0]["severity"] == "info"


def test_one_shape_is_unusable():
    report = examine(healthy(1))
    assert not report.usable
    assert "1 shape" in messages(report, "error")[0]


@pytest.mark.parametrize(("count", "few"), [(2, True), (19, True), (20, False), (60, False)])
def test_few_shapes_are_said_as_information_and_stay_usable(count, few):
    report = examine(healthy(count))
    found = report.of_kind("few")
    assert [finding.severity for finding in found] == ["info"] * few
    assert report.usable
    if few:
        assert f"{count} shapes" in found[0].message


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_rigid_motion_alone_is_unusable_at_any_scale_and_in_float32(scale):
    vertices, faces = grid()
    vertices = scale * bent(vertices, 0.1)
    moved = [vertices @ rotation([1, i, 2], 0.3 * i).T + scale * i for i in range(4)]
    report = examine(MeshSequence(np.array(moved, dtype=np.float32), faces))
    assert not report.usable
    assert "rigid" in messages(report, "error")[0]
    assert report.facts["largest_rotation"] == pytest.approx(0.9, abs=1e-4)


def test_a_mirror_image_is_a_deformation():
    vertices, faces = grid()
    vertices = vertices + np.random.default_rng(0).normal(size=vertices.shape)
    assert examine(MeshSequence(np.stack([vertices, vertices * [-1, 1, 1]]), faces)).usable


@pytest.mark.parametrize("angle", [1e-6, 0.5, 3.0, np.pi])
def test_largest_rotation_is_the_angle_put_in(angle):
    vertices, faces = grid()
    vertices = bent(vertices, 0.2)
    turned = vertices @ rotation([1, 2, 3], angle).T
    report = examine(MeshSequence(np.stack([vertices, vertices, turned]), faces))
    assert report.facts["largest_rotation"] == pytest.approx(angle, abs=1e-9)


def test_large_rotation_names_shape_and_angle():
    shapes = healthy()
    vertices = shapes.vertices.copy()
    vertices[2] = vertices[0] @ rotation([0, 0, 1], np.radians(120)).T
    message = the_message(MeshSequence(vertices, shapes.faces), "warning")
    assert "shape 2" in message
    assert "120°" in message


def test_duplicates_are_pairs_of_first_and_later():
    shapes = healthy(3).subset([0, 1, 0, 2, 1, 0])
    report = examine(shapes)
    assert report.facts["duplicate_shapes"] == [[0, 2], [1, 4], [0, 5]]
    (message,) = messages(report, "warning")
    assert "shape 2 equals shape 0" in message
    assert report.usable


def test_point_shape_is_unusable():
    shapes = healthy()
    vertices = shapes.vertices.copy()
    vertices[3] = 1.0
    report = examine(MeshSequence(vertices, shapes.faces))
    assert not report.usable
    assert "shape 3" in messages(report, "error")[0]


@pytest.mark.parametrize("factor", [100.0, 0.0254])
def test_unit_mix_up_names_shape_and_scale(factor):
    shapes = healthy()
    vertices = shapes.vertices.copy()
    vertices[2] *= factor
    message = the_message(MeshSequence(vertices, shapes.faces), "warning")
    assert "shape 2" in message
    assert "units" in message
    assert f"scale by {1 / factor:.2g}"[:10] in message


def test_shuffled_vertex_order_is_told_from_a_unit_mix_up():
    vertices, faces = grid(30, 30)
    shapes = np.stack([bent(vertices, 0.01 * i) for i in range(4)])
    shapes[1] = np.random.default_rng(0).permutation(shapes[1])
    found = messages(examine(MeshSequence(shapes, faces)), "warning")
    assert "shape 1" in found[0]
    assert "another order" in found[0]


def test_non_manifold_edge_is_named():
    shapes = healthy()
    report = examine(with_faces(shapes, [[0, 6, 29]]))
    assert report.facts["non_manifold_edges"] == 1
    assert "[0, 6]" in messages(report, "warning")[0]


def test_turned_face_is_found_on_each_shared_edge():
    shapes = healthy()
    faces = shapes.faces.copy()
    inner = 5
    faces[inner] = faces[inner, ::-1]
    report = examine(MeshSequence(shapes.vertices, faces))
    assert report.facts["inconsistent_orientation"] == 3
    assert "orientation" in messages(report, "warning")[0]


def test_two_components_and_an_isolated_vertex():
    shapes = healthy()
    vertices = np.concatenate([shapes.vertices, shapes.vertices + 9, shapes.vertices[:, :1] - 1], 1)
    report = examine(MeshSequence(vertices, np.concatenate([shapes.faces, shapes.faces + 30])))
    assert report.facts["components"] == 2
    assert report.facts["isolated_vertices"] == 1
    assert not messages(report, "warning")
    assert report.of_kind("isolated")[0].vertices == (60,)
    assert "components: 2" in report.of_kind("pieces")[0].message


def test_faces_without_area_and_vertices_at_one_place():
    shapes = healthy()
    vertices = shapes.vertices.copy()
    vertices[:, 29] = vertices[:, 28]
    vertices[0, 12] = vertices[0, 11]
    report = examine(MeshSequence(vertices, shapes.faces))
    edge = ((shapes.faces == 28).any(axis=1)) & ((shapes.faces == 29).any(axis=1))
    # Collapsing vertex 29 also flattens the other face of the corner cell if it becomes a line.
    assert report.facts["degenerate_faces"] >= edge.sum() == 1
    assert report.facts["coincident_vertices"] == 2 and report.facts["seam_vertices"] == 1
    (degenerate,) = messages(report, "warning")
    assert "29 on 28" in report.of_kind("seams")[0].message
    assert "12 on 11" in report.of_kind("touching")[0].message
    assert degenerate.startswith("faces of ")


def test_repeated_corner_counts_as_no_area():
    report = examine(with_faces(healthy(), [[12, 12, 12]]))
    assert report.facts["degenerate_faces"] == 1
    assert report.facts["non_manifold_edges"] == 0


def test_errors_come_first():
    shapes = healthy(2).subset([0, 0])
    report = examine(with_faces(shapes, [[0, 6, 29]]))
    rank = [("error", "warning", "info").index(finding.severity) for finding in report.findings]
    assert rank == sorted(rank)
    assert rank[0] == 0


@pytest.mark.parametrize(
    ("name", "loops"), [("horse-gallop.npz", 2), ("ict-expressions.npz", 4), ("scape-obj", 0)]
)
def test_example_sets_are_usable_manifold_and_have_their_known_loops(name, loops):
    if not (DATA / name).exists():
        pytest.skip(f"example set {name} is not on this machine")
    report = examine(load_shapes(DATA / name))
    assert report.usable
    assert report.facts["boundary_loops"] == loops
    assert report.facts["non_manifold_edges"] == report.facts["inconsistent_orientation"] == 0
