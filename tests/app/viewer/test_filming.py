"""Animations that are drawn and written: their progress, their end, and what is not on them."""

import numpy as np
import pytest
from PIL import Image

from deformer import InputError
from deformer_app.viewer import recording
from deformer_app.viewer.changes import NoticeGiven, WaitBegun, WaitEnded
from deformer_app.viewer.recording import Recorder, save_turntable
from deformer_app.viewer.view_cube import REACH, centre
from off_screen_editor import SIZE, drag, finish, seen, texts
from waiting import wait_for

SHOTS = 6


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(recording, "_TURN", SHOTS)


def unevenness(picture):
    """The largest difference along the row of pixels through the orientation cube's place."""
    x, y = centre(SIZE).astype(int)
    row = np.asarray(picture, dtype=int)[y, x - REACH : x + REACH]
    return int(np.ptp(row, axis=0).max())


def test_the_user_is_told_of_every_frame_and_of_the_end(editor, heard, tmp_path):
    editor.run(save_turntable(editor, tmp_path / "turn.gif"))
    assert not editor.filming.running
    finish(editor)
    told = texts(heard, WaitBegun)
    for n in range(1, SHOTS + 1):
        assert f"Drawing turn.gif: frame {n} of {SHOTS}. Esc cancels." in told
    assert any(text.startswith("Writing turn.gif: frame ") for text in told)
    assert sum(isinstance(change, WaitEnded) for change in heard) == 1
    assert texts(heard, NoticeGiven) == [f"Wrote {tmp_path / 'turn.gif'}"]
    with Image.open(tmp_path / "turn.gif") as movie:
        assert movie.n_frames > 1 and unevenness(movie.convert("RGB")) < 12
    assert editor.state.view.cube.shown and not editor.filming.give_up()


def test_given_up_it_leaves_no_file_and_the_picture_as_it_was(editor, heard, tmp_path):
    camera = editor.state.camera
    editor.run(save_turntable(editor, tmp_path / "turn.gif"))
    wait_for(lambda: len(texts(heard, WaitBegun)) == 2, editor.tick, pause=0.001)
    assert editor.filming.give_up()
    finish(editor)
    assert list(tmp_path.iterdir()) == [] and editor.state.camera == camera
    assert texts(heard, NoticeGiven) == ["turn.gif was given up"]
    assert sum(isinstance(change, WaitEnded) for change in heard) == 1
    assert not editor.filming.running


def test_given_up_while_it_is_written_it_leaves_no_file(editor, heard, tmp_path, monkeypatch):
    def write(path, pictures, fps):
        assert editor.filming.give_up()
        path.write_bytes(bytes(pictures[0].ravel()))

    monkeypatch.setattr("deformer_app.viewer.filming.save_animation", write)
    editor.run(save_turntable(editor, tmp_path / "turn.gif"))
    finish(editor)
    assert list(tmp_path.iterdir()) == []
    assert texts(heard, NoticeGiven) == ["turn.gif was given up"]


def test_two_at_a_time_are_refused(editor, tmp_path):
    first = save_turntable(editor, tmp_path / "first.gif")
    next(first)
    with pytest.raises(InputError, match=r"first\.gif is still being written"):
        next(save_turntable(editor, tmp_path / "second.gif"))
    first.close()
    assert not editor.filming.running


def test_a_recording_has_no_orientation_cube(editor):
    view, at = editor.state.view, tuple(centre(SIZE))
    view.render()
    assert unevenness(view.grab()) > 40 and editor.state.cube_at(at) is not None
    recorder = Recorder(editor)
    assert editor.state.cube_at(at) is None, "what is not drawn is not clicked"
    _, start = seen(editor, 0.95)
    drag(editor, start, start + np.array([-25, -40]))
    pictures = recorder.stop()
    assert len(pictures) and all(unevenness(picture) < 20 for picture in pictures)
    finish(editor)
    assert unevenness(view.grab()) > 40
