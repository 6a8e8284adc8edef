"""Sequences as keys, and clips as files, read back."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import deformer
from deformer import MeshSequence, io, save_shapes
from deformer_app.cli.fit import sequence as fit_file
from deformer_app.viewer.changes import MistakeMade, NoticeGiven
from deformer_app.viewer.edit import Edit, Handle, point
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.handle_changes import with_disc
from deformer_app.viewer.timeline.clip_job import Request, fit_clip
from deformer_app.viewer.timeline.exports import export_clip, handle_frames
from deformer_app.viewer.timeline.keys import SLIDERS, Clip, Key, Placement, Track
from deformer_app.viewer.timeline.sequences import load_sequence
from off_screen_editor import SIZE, finish, texts
from shapes import small_model

MARKERS = (10, 60, 110, 85)


@pytest.fixture
def keyed(editor):
    for vertex in MARKERS[:3]:
        editor.handles.place(vertex, add=True)
    editor.commit("Place handle")
    editor.handles.select_all()
    editor.handles.set_kind("exact")
    editor.timeline.set_clip(length=9, fps=30)
    editor.timeline.keys.set()
    editor.timeline.seek(8)
    editor.handles.select([1])
    editor.handles.move_selected(translation([0.1, 0.2, 0.1]))
    editor.commit("Drag")
    finish(editor)
    return editor.timeline


def motion(model, frames=12):
    share = np.linspace(0.0, 1.0, frames)[:, None]
    codes = (1 - share) * model.codes[8] + share * model.codes[3]
    return np.array([model.decode(z) for z in codes])


def marker_file(path, shapes, lost=()):
    frames = [
        [
            {"vertex": v, "position": None if (f, v) in lost else shapes[f, v].tolist()}
            for v in MARKERS
        ]
        for f in range(len(shapes))
    ]
    path.write_text(json.dumps({"frames": frames}))


@pytest.mark.parametrize("name", ["clip.npz", "clip.glb", "clip.mdd", "clip.pc2", "clip"])
def test_an_exported_clip_is_read_back(editor, keyed, tmp_path, name):
    editor.run(export_clip(editor, tmp_path / name))
    finish(editor)
    clip = {"clip": "clip", "fps": 30} if name == "clip.glb" else {}
    found = deformer.load_shapes(tmp_path / name, **clip).vertices
    diagonal = editor.model.reference.bounding_diagonal
    assert found.shape == keyed.fitted.vertices.shape
    assert np.abs(found - keyed.fitted.vertices).max() < 3e-3 * diagonal


def test_exported_frames_of_handles_are_those_of_the_clip_and_can_be_fitted(
    editor, keyed, tmp_path
):
    editor.run(export_clip(editor, tmp_path / "clip.json"))
    finish(editor)
    model = editor.model
    file = io.load_handles(tmp_path / "clip.json", len(model.reference.vertices))
    assert len(file.frames) == 9
    for frame in (0, 4, 8):
        edit = keyed.clip.at(editor.edit, frame)
        rows = {row.vertex: row for row in file.frames[frame]}
        assert all(row.kind == "exact" for row in rows.values())
        for handle in edit.handles:
            assert rows[handle.vertices[0]].position == pytest.approx(handle.targets[0])
    vertices, _ = fit_file(
        model, file, hard=False, noise=None, smoothness=None, device="cpu", backend=None,
        progress=lambda done, total: None,
    )  # fmt: skip
    file.check_model("clip.json", model.fingerprint)
    assert file.fingerprint == model.fingerprint
    diagonal = model.reference.bounding_diagonal
    assert np.abs(vertices - keyed.fitted.vertices).max() < 1e-6 * diagonal


@pytest.mark.parametrize("seed", range(6))
def test_a_clip_and_the_fit_of_its_export_are_one(tmp_path, seed):
    """Of random keys, lost markers, regions, discs of pins, turns, gaps, sliders, floors."""
    chance, model = np.random.default_rng(seed), small_model()
    rest, diagonal = model.reference.vertices, model.reference.bounding_diagonal
    shapes = motion(model, 10)
    discs = [with_disc(Handle(0, (v,), (point(rest[v]),), "pin"), 0.1, model) for v in (15, 75)]
    vertices = [(v,) for v in MARKERS[:4]] + [discs[0].vertices, (101, 104, 107), discs[1].vertices]
    handles, tracks = [], []
    for number, chosen in enumerate(vertices):
        if seed and chance.random() < 0.3:
            continue
        handle = Handle(
            number,
            chosen,
            tuple(point(p) for p in shapes[0, list(chosen)]),
            "pin" if len(chosen) > 3 else ("soft", "exact")[chance.integers(2)],
            float(chance.uniform(0.5, 2.0)),
            chosen if len(chosen) > 1 else (),
        )
        if len(chosen) > 3 or chance.random() < 0.5:
            gaps = 0.01 * diagonal * chance.normal(size=(len(chosen), 3))
            handle = handle.at(handle.targets, gaps)
        if number % 2:
            handle = handle.oriented(np.eye(3)) if len(chosen) == 1 else handle
        handles.append(handle)
        seen = np.flatnonzero(chance.random(10) < 0.6)
        if number and len(seen):
            turn = handle.orientation
            keys = (
                Key(int(f), Placement(tuple(point(p) for p in shapes[f, list(chosen)]), turn))
                for f in seen
            )
            tracks.append(Track(number, tuple(keys), measured=bool(chance.random() < 0.6)))
    codes = tuple(Key(f, tuple(model.codes[f].tolist())) for f in (0, 9))
    tracks += [Track(SLIDERS, codes)] if seed % 2 else []
    lowest = float(shapes[:, :, 1].min())
    edit = Edit(
        tuple(model.codes[1].tolist()),
        tuple(handles),
        float(chance.uniform(0.005, 0.02)),
        ("auto", "stays", "moves")[seed % 3],
        lowest + 0.02 * diagonal if seed > 2 else None,
    )
    request = Request.of(Clip(10, 24, (0.0, 10.0)[seed % 2], tuple(tracks)), edit)
    fitted = fit_clip(model, request, lambda done, total: None)
    io.write_json(tmp_path / "clip.json", handle_frames(fitted, edit.handles))
    counts = len(rest), model.reference.faces, model.components
    file = io.load_handles(tmp_path / "clip.json", *counts)
    found, _ = fit_file(
        model, file, hard=False, noise=None, smoothness=None, device="cpu", backend=None,
        progress=lambda done, total: None,
    )  # fmt: skip
    assert np.abs(found - fitted.vertices).max() < 1e-6 * diagonal
    if edit.floor is not None:
        assert found[..., 1].min() > edit.floor - 1e-3 * diagonal


def test_options_go_before_what_a_file_tells(run_json, tmp_path):
    model = small_model()
    model.save(tmp_path / "model")
    shapes = motion(model, 6) + 0.02 * np.random.default_rng(0).normal(size=(6, 1, 1))
    frames = [[{"vertex": v, "position": shape[v].tolist()} for v in MARKERS] for shape in shapes]
    file = {"frames": frames, "smoothness": 300.0, "prior": {"noise": 0.05, "body": "stays"}}
    (tmp_path / "told.json").write_text(json.dumps(file))
    (tmp_path / "plain.json").write_text(json.dumps({"frames": frames}))

    def fitted(name, *options):
        run_json("fit", tmp_path / "model", tmp_path / name, "-o", tmp_path / "out.npz", *options)
        return deformer.load_shapes(tmp_path / "out.npz").vertices

    options = {"smoothness": 300.0, "noise": 0.05, "freedom": "stays"}
    expected = deformer.fit_sequence(model, MARKERS, shapes[:, MARKERS], **options).vertices
    np.testing.assert_allclose(fitted("told.json"), expected, atol=1e-9)
    options["smoothness"] = 0.0
    expected = deformer.fit_sequence(model, MARKERS, shapes[:, MARKERS], **options).vertices
    np.testing.assert_allclose(fitted("told.json", "--smoothness", 0), expected, atol=1e-9)
    plain = deformer.fit_sequence(model, MARKERS, shapes[:, MARKERS]).vertices
    np.testing.assert_allclose(fitted("plain.json"), plain, atol=1e-9)
    assert np.abs(plain - expected).max() > 1e-3


def test_an_exported_animation_has_a_picture_a_frame(editor, keyed, tmp_path):
    editor.run(export_clip(editor, tmp_path / "clip.gif"))
    finish(editor)
    picture = Image.open(tmp_path / "clip.gif")
    assert picture.n_frames == 9 and picture.size == SIZE
    assert editor.timeline.frame == 8


@pytest.mark.parametrize(
    ("name", "words"), [("clip.abc", "names a file of format .abc"), ("none/clip.glb", "none")]
)
def test_what_cannot_be_written_is_one_line_before_any_work(
    editor, keyed, heard, tmp_path, name, words
):
    editor.run(export_clip(editor, tmp_path / name))
    finish(editor)
    (mistake,) = texts(heard, MistakeMade)
    assert words in mistake


def test_without_keys_there_is_nothing_to_write(editor, heard, tmp_path):
    editor.run(export_clip(editor, tmp_path / "clip.npz"))
    finish(editor)
    assert "set keys first" in texts(heard, MistakeMade)[0] and not (tmp_path / "clip.npz").exists()


def test_a_clip_that_one_has_keyed_stays_as_long_as_it_is(editor, keyed, heard, tmp_path):
    keyed.set_clip(length=40)
    marker_file(tmp_path / "markers.json", motion(editor.model))
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)
    assert keyed.clip.length == 40 and 8 in keyed.clip.track(1).frames
    assert "Smooth is 10 now" in texts(heard, NoticeGiven)[-1]


def test_markers_become_soft_handles_with_a_key_where_they_are_seen(editor, tmp_path):
    shapes = motion(editor.model)
    lost = {(f, 60) for f in (4, 5, 6)}
    marker_file(tmp_path / "markers.json", shapes, lost)
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)
    timeline = editor.timeline
    assert [handle.vertices[0] for handle in editor.edit.handles] == list(MARKERS)
    assert {handle.kind for handle in editor.edit.handles} == {"soft"}
    assert timeline.clip.length == 12 and timeline.clip.smoothness > 0
    track = timeline.clip.track(editor.edit.handles[1].id)
    assert track.frames == [0, 1, 2, 3, 7, 8, 9, 10, 11]
    diagonal = editor.model.reference.bounding_diagonal
    off = np.abs(timeline.fitted.vertices - shapes).max(axis=(1, 2))
    assert off.max() < 0.05 * diagonal
    editor.undo()
    assert timeline.clip.names == [] and editor.edit.handles == ()


def test_markers_at_vertices_of_handles_move_those_handles(editor, tmp_path):
    shapes = motion(editor.model)
    marker_file(tmp_path / "markers.json", shapes, set())
    number = editor.handles.place(MARKERS[2])
    editor.commit("Place handle")
    editor.handles.names.rename(number, "elbow")
    finish(editor)
    for _ in range(2):
        editor.run(load_sequence(editor, tmp_path / "markers.json"))
        finish(editor)
        vertices = [handle.vertices[0] for handle in editor.edit.handles]
        assert sorted(vertices) == sorted(MARKERS), "no vertex has two handles"
        assert editor.edit.handle(number).vertices == (MARKERS[2],)
        assert editor.edit.handle(number).name == "elbow"
        owners = [track.owner for track in editor.timeline.clip.tracks]
        assert sorted(owners) == sorted(handle.id for handle in editor.edit.handles)


def test_a_marker_that_is_not_seen_pulls_at_nothing(editor, tmp_path):
    """Between its keys the handle is drawn on a straight line, which the motion does not follow."""
    shapes = motion(editor.model)
    swung = shapes.copy()
    swung[:, :, 2] += 0.5 * np.sin(np.linspace(0, np.pi, 12))[:, None]
    lost = {(f, 60) for f in range(2, 10)}
    marker_file(tmp_path / "markers.json", swung, lost)
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)
    timeline = editor.timeline
    drawn = timeline.clip.at(editor.edit, 6).handles[1].targets[0]
    found = timeline.fitted.vertices[6]
    assert np.abs(drawn - swung[6, 60]).max() > 0.3
    assert np.abs(found[60] - swung[6, 60]).max() < 0.12


def test_jitter_is_smoothed_away(editor, tmp_path):
    shapes = motion(editor.model, 24)
    noise = 0.02 * np.random.default_rng(3).normal(size=shapes.shape)
    marker_file(tmp_path / "markers.json", shapes + noise)
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)

    def jitter(found):
        return (np.diff(found, 2, axis=0) ** 2).mean()

    cleaned = editor.timeline.fitted.vertices
    assert jitter(cleaned[:, MARKERS]) < 0.5 * jitter((shapes + noise)[:, MARKERS])


def test_a_sequence_is_keyed_over_by_another_handle(editor, tmp_path):
    shapes = motion(editor.model)
    marker_file(tmp_path / "markers.json", shapes)
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)
    timeline = editor.timeline
    before = timeline.fitted.vertices.copy()
    timeline.seek(6)
    finish(editor)
    number = editor.handles.place(119)
    editor.commit("Place handle")
    editor.handles.select([number])
    editor.handles.set_kind("exact")
    editor.handles.move_selected(translation([0.0, 0.0, 0.3]))
    editor.commit("Drag")
    finish(editor)
    wanted = editor.edit.handle(number).targets[0]
    np.testing.assert_allclose(timeline.fitted.vertices[6, 119], wanted, atol=1e-6)
    assert np.abs(timeline.fitted.vertices[6] - before[6]).max() > 0.1


@pytest.mark.parametrize("name", ["walk.npz", "walk", "walk.glb", "walk.mdd"])
def test_posed_meshes_are_followed_by_handles_and_shown(editor, tmp_path, name):
    shapes = motion(editor.model)
    save_shapes(tmp_path / name, MeshSequence(shapes, editor.model.reference.faces))
    editor.run(load_sequence(editor, tmp_path / name))
    finish(editor)
    timeline = editor.timeline
    diagonal = editor.model.reference.bounding_diagonal
    assert len(editor.edit.handles) > 4 and timeline.clip.length == 12
    assert np.abs(timeline.fitted.vertices - shapes).max() < 0.03 * diagonal
    assert np.abs(timeline.footage - shapes).max() < 2e-3 * diagonal


def test_what_is_no_sequence_of_the_model_is_one_line(editor, heard, tmp_path):
    one = {"handles": [{"vertex": 3, "position": [0, 0, 0]}]}
    (tmp_path / "one.json").write_text(json.dumps(one))
    off = {"frames": [[{"vertex": 3, "position": [0, 0, 0], "offset": 0.1}]]}
    (tmp_path / "off.json").write_text(json.dumps(off))
    other = motion(editor.model, 3)
    save_shapes(
        tmp_path / "other.npz",
        MeshSequence(other, editor.model.reference.faces[:, [1, 2, 0]]),
    )
    for name in ("one.json", "off.json", "other.npz"):
        editor.run(load_sequence(editor, tmp_path / name))
        finish(editor)
    mistakes = texts(heard, MistakeMade)
    assert len(mistakes) == 3 and editor.timeline.clip.names == []
    assert "one.json" in mistakes[0] and "frames" in mistakes[0]
    assert "off.json" in mistakes[1] and "frames[0][0]" in mistakes[1]
    assert "other.npz" in mistakes[2]


@pytest.mark.parametrize("name", ["walk.npz", "markers.json"])
def test_a_sequence_with_other_axes_is_one_line_and_no_clip(editor, heard, tmp_path, name):
    shapes = motion(editor.model)[..., [0, 2, 1]] * [1, 1, -1]
    if name == "markers.json":
        marker_file(tmp_path / name, shapes)
    else:
        save_shapes(tmp_path / name, MeshSequence(shapes, editor.model.reference.faces))
    editor.run(load_sequence(editor, tmp_path / name))
    finish(editor)
    (mistake,) = texts(heard, MistakeMade)
    assert "\n" not in mistake
    assert name in mistake and "x, -z, y in place of x, y, z" in mistake
    assert editor.timeline.clip.names == [] and editor.timeline.footage is None
    assert editor.edit.handles == ()


def test_a_clip_of_a_model_with_z_up_is_loaded_in_its_axes(editor, tmp_path):
    shapes = motion(editor.model)
    sequence = MeshSequence(shapes, editor.model.reference.faces)
    save_shapes(tmp_path / "walk.glb", sequence, up="z")
    editor.run(load_sequence(editor, tmp_path / "walk.glb"))
    finish(editor)
    diagonal = editor.model.reference.bounding_diagonal
    assert np.abs(editor.timeline.footage - shapes).max() < 2e-3 * diagonal
    assert np.abs(editor.timeline.fitted.vertices - shapes).max() < 0.03 * diagonal


def test_a_session_keeps_a_loaded_sequence(editor, tmp_path):
    from deformer_app.viewer.session import Session

    shapes = motion(editor.model)
    marker_file(tmp_path / "markers.json", shapes, {(4, 60)})
    editor.run(load_sequence(editor, tmp_path / "markers.json"))
    finish(editor)
    editor.timeline.set_clip(smoothness=3.0)
    editor.session.save(tmp_path / "work.json")
    loaded = Session.load(tmp_path / "work.json")
    assert loaded.clip == editor.timeline.clip
    data = json.loads((tmp_path / "work.json").read_text())
    assert len(data["tracks"]) == len(MARKERS)  # once, though two steps have them
    assert replace(loaded.clip, smoothness=10.0) == loaded.entries[-2].clip


def test_a_session_keeps_loaded_meshes_and_tells_if_their_file_is_another_or_gone(
    editor, heard, model_path, tmp_path
):
    from deformer_app.viewer.session import Session

    def opened():
        del heard[:]
        editor.open_model(model_path, Session.load(tmp_path / "session.json"))
        assert editor.timeline.footage is None, "they are loaded in the background"
        finish(editor)
        return texts(heard, MistakeMade)

    shapes, faces = motion(editor.model), editor.model.reference.faces
    file = tmp_path / "walk.npz"
    save_shapes(file, MeshSequence(shapes, faces))
    editor.run(load_sequence(editor, file))
    finish(editor)
    editor.save_session(tmp_path / "session.json")
    assert opened() == []
    np.testing.assert_array_equal(editor.timeline.footage, deformer.load_shapes(file).vertices)
    save_shapes(file, MeshSequence(shapes[::-1], faces))
    (told,) = opened()
    assert "walk.npz" in told and "changed" in told
    np.testing.assert_allclose(editor.timeline.footage[0], shapes[-1], atol=1e-6)
    file.rename(tmp_path / "moved.npz")
    (told,) = opened()
    assert "loaded meshes" in told and "walk.npz: does not exist" in told
    editor.save_session(tmp_path / "session.json")
    (tmp_path / "moved.npz").rename(file)
    opened()
    assert editor.timeline.footage is not None, "the name of a file that was gone is kept"
    editor.open_model(model_path)
    finish(editor)
    assert editor.timeline.footage is None
