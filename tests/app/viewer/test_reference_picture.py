"""A picture or video behind or in front of the model."""

import json

import numpy as np
import pytest
from PIL import Image

from deformer import InputError
from deformer_app.viewer.changes import MistakeMade
from deformer_app.viewer.session import Session
from off_screen_editor import SIZE, finish, texts

GREEN = (0, 200, 0)
WIDTH, HEIGHT = SIZE


@pytest.fixture(params=[False, True], ids=["perspective", "orthographic"])
def editor(editor, request):
    if request.param:
        editor.state.viewpoint.toggle_orthographic()
    editor.picture.change_look(cube=False)
    finish(editor)
    return editor


@pytest.fixture
def green(tmp_path):
    path = tmp_path / "green.png"
    Image.new("RGB", (40, 20), GREEN).save(path)
    return path


def drawn(editor):
    finish(editor)
    editor.state.view.render()
    return editor.state.view.grab().astype(int)


def greens(picture):
    return (np.abs(picture - GREEN) <= 3).all(axis=2)


def test_it_is_where_it_should_be_behind_the_model_whatever_the_camera_does(editor, green):
    before = drawn(editor)
    reference = editor.state.reference_picture
    reference.open(green)
    reference.place(opacity=1.0, scale=0.5, x=0.1, y=-0.2)
    for _ in range(2):
        shown = greens(drawn(editor))
        left, top = WIDTH / 2 + 0.1 * HEIGHT - 0.5 * HEIGHT, HEIGHT * 0.7 - 0.25 * HEIGHT
        rows, columns = np.nonzero(shown)
        assert abs(columns.min() - left) <= 1 and abs(rows.min() - top) <= 1
        assert abs(columns.max() + 1 - left - HEIGHT) <= 1
        assert abs(rows.max() + 1 - top - HEIGHT / 2) <= 1
        editor.state.viewpoint.set_camera(
            editor.state.camera.orbited(60.0, 20.0, editor.state.viewpoint.sky)
        )
    editor.state.viewpoint.set_camera(
        editor.state.camera.orbited(-120.0, -40.0, editor.state.viewpoint.sky)
    )
    # The surface hides it.
    x, y = np.floor(editor.state.camera.project([editor.vertices.mean(axis=0)], SIZE)[0]).astype(
        int
    )
    reference.place(scale=2.0, x=0.0, y=0.0)
    behind = drawn(editor)
    assert not greens(behind)[y, x]
    reference.place(in_front=True)
    assert greens(drawn(editor))[y, x]
    reference.close()
    assert np.abs(drawn(editor) - before).max() <= 12  # the camera came back to rounding


def test_opacity_mixes_it_with_what_is_behind(editor, green):
    empty = drawn(editor)[5, 5]
    reference = editor.state.reference_picture
    reference.open(green)
    reference.place(scale=2.0, opacity=0.25)
    np.testing.assert_allclose(drawn(editor)[5, 5], 0.75 * empty + 0.25 * np.array(GREEN), atol=3)


def test_it_follows_the_time_and_skips_frames_that_are_not_wanted_any_more(editor, tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for n in range(10):
        Image.new("RGB", (8, 8), (25 * n, 0, 0)).save(folder / f"{n}.png")
    reference = editor.state.reference_picture
    reference.open(folder)
    reference.place(opacity=1.0, scale=2.0)
    for n in range(1, 8):
        reference.set_frame(n / 25.0)
    finish(editor)
    assert reference.frame == 7
    np.testing.assert_allclose(drawn(editor)[5, 5], [175, 0, 0], atol=2)
    reference.set_frame(1e9)
    finish(editor)
    assert reference.frame == 9
    reference.set_frame(0.0)
    reference.close()  # while a frame is being read
    finish(editor)
    assert reference.footage is None and not editor.state.view.plane.is_shown


def test_it_follows_the_playhead_of_the_timeline(editor, tmp_path):
    for n in range(10):
        Image.new("RGB", (8, 8), (25 * n, 0, 0)).save(tmp_path / f"{n}.png")
    reference, timeline = editor.state.reference_picture, editor.timeline
    reference.open(tmp_path)
    timeline.seek(4)
    finish(editor)
    assert reference.seconds == pytest.approx(4 / timeline.clip.fps)
    assert reference.frame == reference.footage.index_at(4 / timeline.clip.fps) > 0


def test_it_is_opened_at_the_playhead(editor, tmp_path):
    for n in range(10):
        Image.new("RGB", (8, 8), (25 * n, 0, 0)).save(tmp_path / f"{n}.png")
    reference, timeline = editor.state.reference_picture, editor.timeline
    timeline.seek(4)
    editor.picture.open_reference(tmp_path)
    finish(editor)
    assert reference.seconds == pytest.approx(4 / timeline.clip.fps)
    assert reference.frame == reference.footage.index_at(reference.seconds) > 0


def test_a_frame_that_cannot_be_read_is_told_and_the_last_one_stays(editor, heard, tmp_path):
    for n in range(3):
        Image.new("RGB", (8, 8), (25 * n, 0, 0)).save(tmp_path / f"{n}.png")
    reference = editor.state.reference_picture
    reference.open(tmp_path)
    (tmp_path / "1.png").write_bytes(b"damaged")
    reference.set_frame(1 / 25.0)
    finish(editor)
    (told,) = texts(heard, MistakeMade)
    assert "1.png" in told
    assert reference.frame == 0
    reference.set_frame(2 / 25.0)
    finish(editor)
    assert reference.frame == 2


def test_a_session_brings_it_back_and_tells_what_is_gone(editor, heard, green, tmp_path):
    reference = editor.state.reference_picture
    reference.open(green)
    reference.place(opacity=0.3, scale=0.7, x=0.2, y=0.1, in_front=True)
    reference.set_frame(1.5)
    placement = reference.placement
    editor.save_session(tmp_path / "s.json")
    reference.close()
    reference.place(opacity=1.0)
    editor.open_session(tmp_path / "s.json")
    assert reference.footage is not None and reference.footage.path == str(green)
    assert reference.placement == placement and reference.seconds == 1.5
    assert not texts(heard, MistakeMade)
    Image.new("RGB", (40, 20), (1, 2, 3)).save(green)
    editor.open_session(tmp_path / "s.json")
    (told,) = texts(heard, MistakeMade)
    assert "has changed" in told
    green.unlink()
    editor.open_session(tmp_path / "s.json")
    _, told = texts(heard, MistakeMade)
    assert "green.png" in told and reference.footage is None
    # The next save keeps the entry.
    editor.save_session(tmp_path / "again.json")
    view = json.loads((tmp_path / "again.json").read_text())["view"]
    assert view["picture"]["path"] == str(green)
    # A damaged entry is refused, and a session of an earlier version has none.
    session = Session.load(tmp_path / "s.json")
    session.view["picture"]["placement"]["opacity"] = 7
    session.save(tmp_path / "bad.json")
    with pytest.raises(InputError, match="opacity"):
        editor.open_session(tmp_path / "bad.json")
    del session.view["picture"]
    session.save(tmp_path / "old.json")
    editor.open_session(tmp_path / "old.json")
    assert reference.footage is None and reference.as_json() is None


def test_opening_a_file_that_is_none_keeps_the_picture(editor, green, tmp_path):
    reference = editor.state.reference_picture
    reference.open(green)
    with pytest.raises(InputError):
        reference.open(tmp_path / "gone.png")
    assert reference.footage is not None and editor.state.view.plane.is_shown
