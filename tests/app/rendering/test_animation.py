"""Animations: what is written is what was drawn, at the rate that was asked for."""

import re
import sys

import numpy as np
import pytest
from PIL import Image

from bars import bending_bar
from deformer import InputError
from deformer_app.rendering.animation import (
    check_animation_path,
    save_animation,
    side_by_side,
    there_and_back,
)
from deformer_app.rendering.camera import aim, eased, turntable
from deformer_app.rendering.offscreen import render


def numbered(count, size=4):
    """Pictures whose grey tells their place."""
    return [np.full((size, size, 3), n, np.uint8) for n in range(count)]


def test_a_gif_comes_back_from_disk(tmp_path):
    shapes = bending_bar(count=6)
    camera = aim(shapes.vertices)
    frames = [render(shapes.mesh(i), camera, (96, 96)) for i in range(6)]
    save_animation(tmp_path / "all.gif", frames, fps=25)
    with Image.open(tmp_path / "all.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"]) == (6, (96, 96), 40)
        for index, frame in enumerate(frames):
            gif.seek(index)
            shown = np.asarray(gif.convert("RGB")).astype(int)
            assert np.abs(shown - frame).mean() < 4


def test_another_ending_or_nothing_to_show_is_refused_and_writes_nothing(tmp_path):
    with pytest.raises(InputError, match=r"\.gif or \.mp4"):
        save_animation(tmp_path / "a.avi", numbered(1), 10)
    with pytest.raises(InputError, match="nothing was drawn"):
        save_animation(tmp_path / "none.gif", [], 10)
    assert not list(tmp_path.iterdir())


def test_there_and_back_shows_each_end_once():
    shown = [int(frame[0, 0, 0]) for frame in there_and_back(numbered(4))]
    assert shown == [0, 1, 2, 3, 2, 1]


def test_rows_stand_side_by_side_and_have_equally_many_frames():
    joined = side_by_side({"a": numbered(3, 40), "b": numbered(3, 40)})
    assert len(joined) == 3 and joined[0].shape[1] > 2 * 40
    with pytest.raises(ValueError, match="shorter"):
        side_by_side({"a": numbered(3), "b": numbered(2)})


def test_easing_ends_at_one_and_is_fastest_in_the_middle():
    way = np.concatenate([[0.0], eased(20)])
    assert way[-1] == pytest.approx(1.0)
    assert np.diff(way).argmax() in (9, 10) and (np.diff(way) > 0).all()


def test_a_turntable_closes():
    first = aim(np.eye(3))
    cameras = turntable(first, 8, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(cameras[0].position, first.position)
    step = cameras[-1].orbited(360.0 / 8, 0.0, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(step.position, first.position)


def test_mp4_without_its_library_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr("deformer_app.rendering.animation.find_spec", lambda name: None)
    with pytest.raises(InputError, match=rf"^{re.escape(str(tmp_path / 'a.mp4'))}: MP4 needs"):
        check_animation_path(tmp_path / "a.mp4")


@pytest.mark.skipif(sys.platform == "win32", reason="files have no limits of size on Windows")
def test_a_film_that_does_not_fit_on_the_disk_is_told_by_its_own_name(tmp_path, capfd):
    pytest.importorskip("imageio_ffmpeg", reason="MP4 needs imageio-ffmpeg")
    import resource
    import signal

    noise = np.random.default_rng(0).integers(0, 255, (30, 120, 160, 3), dtype=np.uint8)
    file, before = tmp_path / "film.mp4", resource.getrlimit(resource.RLIMIT_FSIZE)
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(OSError, match="could not write") as told:
            save_animation(file, list(noise), 25)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, old)
    assert told.value.filename == str(file) and list(tmp_path.iterdir()) == []
    assert ".film" not in "".join(capfd.readouterr())
