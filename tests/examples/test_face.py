"""The face set: what is read of the kit, its reduction on both sides alike, and mixtures."""

import numpy as np
import pytest
from decimation import boundary_vertices
from face import expressions, kit
from face.expressions import CLOSED_JAW, PAIRED, SINGLE, draw_weights, mix, schedule
from face.kit import EXPRESSIONS, NEUTRAL, load_face
from face.reduction import reduce_face, strain_importance

import deformer
from paths import DATA

pytestmark = pytest.mark.slow
COLUMNS, ROWS = 21, 16


@pytest.fixture(scope="module")
def example(load_example):
    return load_example("12_make_face")


def symmetric_grid(columns=COLUMNS, rows=ROWS):
    """A bent sheet, symmetric about x = 0, with a row of vertices on that plane."""
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows), indexing="ij")
    # Not symmetric about any other plane.
    points = np.stack([x, y + 0.1 * y**2, 0.5 - x**2 + 0.3 * y**3], axis=2).reshape(-1, 3)
    n = np.arange(columns * rows).reshape(columns, rows)
    a, b, c, d = n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]
    left = (np.arange(columns - 1) < columns // 2)[:, None]
    one = np.where(left[..., None], np.stack([a, b, c], 2), np.stack([a, b, d], 2))
    two = np.where(left[..., None], np.stack([a, c, d], 2), np.stack([b, c, d], 2))
    return points, np.concatenate([one.reshape(-1, 3), two.reshape(-1, 3)])


def small_face():
    """A face whose expressions are bumps, those of the two sides mirror images."""
    points, faces = symmetric_grid()
    offsets = {}
    for number, name in enumerate(EXPRESSIONS):
        place = np.array([0.5, np.cos(2.0 * number)])
        for side in (1, -1):
            if (name.endswith("_L") and side < 0) or (name.endswith("_R") and side > 0):
                continue
            far = ((points[:, :2] - place * [side, 1]) ** 2).sum(axis=1)
            bump = 0.1 * np.exp(-far / 0.05)[:, None] * [0.2 * side, 0.5, 1.0]
            offsets[name] = offsets.get(name, 0.0) + bump
        if name.endswith("_R"):
            left = offsets[name.removesuffix("R") + "L"].reshape(COLUMNS, ROWS, 3)
            offsets[name] = (left[::-1] * [-1, 1, 1]).reshape(-1, 3)
    return kit.Face(points, faces, offsets)


def write_folder(folder, face, extra=5):
    """The kit's OBJ files of a face, with vertices and a triangle of other parts after it."""
    folder.mkdir()
    more = np.random.default_rng(0).normal(size=(extra, 3))
    faces = np.concatenate([face.faces, len(face.neutral) + np.array([[0, 1, 2]])])
    for name in (NEUTRAL, *EXPRESSIONS):
        points = face.neutral + face.offsets.get(name, 0.0)
        mesh = deformer.Mesh(np.concatenate([points, more]), faces)
        deformer.save_mesh(folder / f"{name}.obj", mesh)


@pytest.fixture
def face(monkeypatch):
    found = small_face()
    monkeypatch.setattr(kit, "SKIN", len(found.neutral))
    return found


def test_a_folder_and_an_npz_give_the_same_face_without_the_other_parts(face, tmp_path):
    write_folder(tmp_path / "kit", face)
    shapes = [face.neutral, *(face.neutral + face.offsets[name] for name in EXPRESSIONS)]
    np.savez(tmp_path / "kit.npz", vertices=np.stack(shapes), faces=face.faces)
    for source in ("kit", "kit.npz"):
        found = load_face(tmp_path / source)
        np.testing.assert_array_equal(found.faces, face.faces)
        np.testing.assert_allclose(found.neutral, face.neutral, atol=1e-6)
        assert tuple(found.offsets) == EXPRESSIONS
        for name in EXPRESSIONS:
            np.testing.assert_allclose(found.offsets[name], face.offsets[name], atol=1e-6)


def test_what_is_missing_or_does_not_fit_is_named(face, tmp_path):
    write_folder(tmp_path / "kit", face)
    (tmp_path / "kit" / "jawOpen.obj").rename(tmp_path / "jawOpen.obj")
    with pytest.raises(deformer.InputError, match=r"jawOpen\.obj"):
        load_face(tmp_path / "kit")
    deformer.save_mesh(tmp_path / "kit" / "jawOpen.obj", deformer.Mesh(*symmetric_grid(5, 5)))
    with pytest.raises(deformer.InputError, match=r"jawOpen\.obj: 25 vertices, expected 341"):
        load_face(tmp_path / "kit")
    np.savez(tmp_path / "few.npz", vertices=np.stack([face.neutral] * 3), faces=face.faces)
    with pytest.raises(deformer.InputError, match="3 shapes, expected"):
        load_face(tmp_path / "few.npz")


def test_reduction_is_the_same_on_both_sides_and_keeps_boundaries(face):
    reduced = reduce_face(face, 200)
    count = len(reduced.neutral)
    assert abs(count - 200) <= 1
    mirrored = (reduced.neutral * [-1, 1, 1])[:, None] - reduced.neutral
    distance = np.linalg.norm(mirrored, axis=2)
    opposite = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 1e-9
    # The mirror images of the triangles are the triangles, turned round.
    lowest = {tuple(np.roll(face, -face.argmin())) for face in reduced.faces}
    image = opposite[reduced.faces][:, ::-1]
    assert {tuple(np.roll(face, -face.argmin())) for face in image} == lowest
    assert len(boundary_vertices(reduced.faces)) == len(boundary_vertices(face.faces))
    edges = np.sort(np.concatenate([reduced.faces[:, p] for p in ([0, 1], [1, 2], [2, 0])]), axis=1)
    assert count - len(np.unique(edges, axis=0)) + len(reduced.faces) == 1  # still a disc
    # Of every expression the displacements at the vertices that stay.
    kept = [np.flatnonzero((face.neutral == p).all(axis=1))[0] for p in reduced.neutral]
    for name in EXPRESSIONS:
        np.testing.assert_array_equal(reduced.offsets[name], face.offsets[name][kept])


def test_strained_vertices_are_the_important_ones(face):
    moved = face.neutral[:, 0] > 0.5
    offset = moved[:, None] * np.random.default_rng(0).normal(size=face.neutral.shape)
    found = strain_importance(kit.Face(face.neutral, face.faces, {"jitter": offset}))
    assert found.max() == 20 and found[moved].min() > 2
    assert (found[face.neutral[:, 0] < 0.3] == 1).all()
    # Nothing that moves as one is strained.
    rigid = strain_importance(
        kit.Face(face.neutral, face.faces, {"jitter": offset, "all": 0 * offset + 5})
    )
    np.testing.assert_allclose(rigid, found)


def test_an_asymmetric_face_is_refused(face):
    points = face.neutral + np.random.default_rng(0).normal(0, 0.01, face.neutral.shape)
    with pytest.raises(deformer.InputError, match="differs from its mirror image"):
        reduce_face(kit.Face(points, face.faces, face.offsets), 200)


def test_drawn_weights_are_expressions_that_go_together():
    used, alike = set(), 0
    for seed in range(400):
        weights = draw_weights(np.random.default_rng(seed))
        assert weights and set(weights) <= set(EXPRESSIONS)
        assert all(0 < w <= 1 for w in weights.values())
        if "mouthClose" in weights:
            assert weights["jawOpen"] == weights["mouthClose"] <= 0.5
        for lids in ("_L", "_R"):
            assert sum(f"eye{what}{lids}" in weights for what in ("Blink", "Squint", "Wide")) <= 1
        pairs = [(f"{n}_L" in weights, f"{n}_R" in weights) for n in PAIRED]
        alike += sum(left and right for left, right in pairs)
        used |= set(weights)
    assert used == {*SINGLE, "mouthClose"}
    assert alike > 400


def test_the_set_has_the_neutral_face_every_expression_and_mixtures(example, face):
    arrays = example.make_set(face, 6, seed=1, vertex_count=None)
    names = arrays["names"].tolist()
    assert len(set(names)) == len(names) == 1 + len(SINGLE) + 1 + len(PAIRED) + 6
    assert names[0] == "neutral" and CLOSED_JAW in names and "eyeLookUp_L" not in names
    vertices = arrays["vertices"]
    assert vertices.dtype == np.float32 and arrays["faces"].dtype == np.int32
    np.testing.assert_allclose(vertices[0], face.neutral, atol=1e-6)
    smile = face.neutral + face.offsets["mouthSmile_L"] + face.offsets["mouthSmile_R"]
    np.testing.assert_allclose(vertices[names.index("mouthSmile")], smile, atol=1e-6)
    weights = dict(schedule(6, 1))["mixture 4"]
    np.testing.assert_allclose(vertices[-2], mix(face, weights), atol=1e-6)
    again = example.make_set(face, 6, seed=1, vertex_count=None)
    other = example.make_set(face, 6, seed=2, vertex_count=None)
    np.testing.assert_array_equal(again["vertices"], vertices)
    assert np.abs(other["vertices"] - vertices)[-6:].max() > 0.01


def test_the_written_file_needs_no_pickle(example, face, tmp_path, monkeypatch):
    monkeypatch.setattr(example, "load_face", lambda _: face)
    monkeypatch.setattr(example, "VERTICES", 200)
    monkeypatch.setattr(example.make_set, "__defaults__", (200,))
    example.main(tmp_path, tmp_path / "deep" / "face.npz", mixtures=2, seed=0)
    with np.load(tmp_path / "deep" / "face.npz", allow_pickle=False) as stored:
        assert stored["vertices"].shape == (3 + len(SINGLE) + len(PAIRED) + 1, 200, 3)
        assert stored["names"][-1] == "mixture 1"
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["face.npz"]


def test_the_shipped_model_is_of_the_set_that_the_example_makes(example):
    source = DATA / "ict-expressions.npz"
    if not source.exists():
        pytest.skip(f"needs {source.name}, the kit's neutral face and expressions")
    face = load_face(source)
    model = deformer.load_model("face")
    arrays = example.make_set(face, 0, seed=0)
    np.testing.assert_array_equal(arrays["faces"], model.reference.faces)
    np.testing.assert_allclose(arrays["vertices"][0], model.reference.vertices, atol=1e-6)
    # Of two-sided expressions, which the model was trained on.
    rebuilt = model.decode(model.encode(arrays["vertices"][-len(PAIRED) :]))
    assert deformer.e_rms(arrays["vertices"][-len(PAIRED) :], rebuilt) < 30


def test_expressions_are_drawn_from_the_kit():
    named = {
        n for _, actions in expressions.REGIONS.values() for a in actions for n in a.split("+")
    }
    assert named <= {*PAIRED, *EXPRESSIONS}
