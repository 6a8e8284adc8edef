"""Recordings, turntables and screenshots of an editor."""

import time

import numpy as np
import pytest
from PIL import Image

import deformer
from deformer_app.rendering.animation import save_animation
from deformer_app.viewer import recording
from deformer_app.viewer.exports import save_screenshot
from deformer_app.viewer.recording import Recorder, save_recording, save_turntable
from off_screen_editor import SIZE, drag, finish, seen


def test_recordings_and_turntables_are_animations(editor, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "_TURN", 5)
    recorder = Recorder(editor)
    _, at = seen(editor, 0.95)
    drag(editor, at, at + np.array([-25, -40]))
    pictures = recorder.stop()
    assert len(pictures) >= 2 and pictures[0].shape == (*SIZE[::-1], 3)
    assert (pictures[0] != pictures[-1]).any()
    editor.run(save_recording(editor, tmp_path / "drag.glb", pictures))
    finish(editor)
    shapes = deformer.load_shapes(tmp_path / "drag.glb", clip="drag", fps=recording.FPS).vertices
    assert len(shapes) == len(pictures)
    # The clip ends at the pose, to its tolerance, and has begun elsewhere.
    size = editor.model.reference.bounding_diagonal
    np.testing.assert_allclose(shapes[-1], editor.vertices, atol=2e-3 * size)
    assert np.abs(shapes[0] - shapes[-1]).max() > 1e-2 * size
    save_animation(tmp_path / "drag.gif", pictures, recording.FPS)
    with Image.open(tmp_path / "drag.gif") as movie:
        assert movie.size == SIZE and getattr(movie, "n_frames", 1) > 1
    camera = editor.state.camera
    editor.run(save_turntable(editor, tmp_path / "turn.gif"))
    finish(editor)
    assert (tmp_path / "turn.gif").is_file() and editor.state.camera == camera
    pytest.importorskip("imageio_ffmpeg", reason="MP4 needs imageio-ffmpeg")
    save_animation(tmp_path / "drag.mp4", pictures, recording.FPS)
    assert (tmp_path / "drag.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_recording_of_too_many_shapes_is_one_of_pictures(editor, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "_MOST_BYTES", 100)
    recorder = Recorder(editor)
    _, at = seen(editor, 0.95)
    drag(editor, at, at + np.array([-25, -40]))
    pictures = recorder.stop()
    assert len(pictures) >= 2 and pictures.shapes is None
    with pytest.raises(deformer.InputError, match="record a shorter drag"):
        list(save_recording(editor, tmp_path / "drag.glb", pictures))


def test_a_recording_survives_another_size_of_the_window(editor):
    recorder = Recorder(editor)
    for size in (SIZE, (300, 200)):
        editor.state.view.plotter.window_size = list(size)
        editor.state.viewpoint.set_camera(editor.state.camera)
        time.sleep(2 / recording.FPS)
        editor.tick()
    assert {picture.shape for picture in recorder.stop()} == {(200, 300, 3)}


def test_a_screenshot_shows_the_mesh(editor, tmp_path):
    save_screenshot(editor, tmp_path / "a.png")
    image = np.asarray(Image.open(tmp_path / "a.png")).astype(int)
    pixels = np.floor(editor.state.camera.project(editor.vertices, SIZE))
    shown = [v for v, at in enumerate(pixels) if editor.stage.vertex_at(at + 0.5) == v]
    x, y = pixels[shown].astype(int).T
    # The light makes some of the surface as bright as what is behind it, left of the tube.
    assert np.median(np.abs(image[y, x] - image[y, 2]).sum(axis=1)) > 30
