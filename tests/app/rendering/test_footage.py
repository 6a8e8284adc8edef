"""Pictures, folders of pictures and videos as frames in time."""

import numpy as np
import pytest
from PIL import Image

from deformer import InputError
from deformer_app.rendering.animation import save_animation
from deformer_app.rendering.footage import open_footage


def picture(value, size=(32, 24)):
    return Image.new("RGB", size, (value, 255 - value, 60))


def test_a_picture_is_one_frame_with_its_opacity(tmp_path):
    pixels = np.zeros((3, 2, 4), dtype=np.uint8)
    pixels[0, 1] = (10, 20, 30, 40)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    footage = open_footage(tmp_path / "a.png")
    assert (footage.count, footage.size) == (1, (2, 3))
    assert (footage.frame(0) == pixels).all()
    assert footage.index_at(-5.0) == footage.index_at(100.0) == 0
    assert footage.path == str((tmp_path / "a.png").resolve())


def test_a_folder_is_in_natural_order_and_times_choose_frames(tmp_path):
    for n in (1, 2, 10):
        picture(n * 20).save(tmp_path / f"frame{n}.png")
    (tmp_path / "notes.txt").write_text("no picture")
    footage = open_footage(tmp_path)
    assert footage.count == 3
    assert [int(footage.frame(n)[0, 0, 0]) for n in range(3)] == [20, 40, 200]
    step = 1.0 / footage.fps
    assert [footage.index_at(t * step) for t in (-1, 0, 0.9, 1, 2, 99)] == [0, 0, 0, 1, 2, 2]
    before = footage.sha256
    picture(0).save(tmp_path / "frame11.png")
    assert open_footage(tmp_path).sha256 != before


def test_a_frame_of_another_size_is_named(tmp_path):
    picture(1).save(tmp_path / "a.png")
    picture(1, (10, 10)).save(tmp_path / "b.png")
    footage = open_footage(tmp_path)
    with pytest.raises(InputError, match=r"b\.png: 10 × 10 pixels, expected 32 × 24"):
        footage.frame(1)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_video_gives_its_frames_in_any_order(tmp_path, suffix):
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    shades = [20, 90, 160, 230]
    frames = [np.asarray(picture(shade, (64, 48))) for shade in shades]
    save_animation(tmp_path / f"v{suffix}", frames, 10)
    footage = open_footage(tmp_path / f"v{suffix}")
    assert footage.count == 4 and footage.fps == pytest.approx(10.0) and footage.size == (64, 48)
    for n in (0, 3, 1, 2):
        assert footage.frame(n).shape == (48, 64, 4)
        np.testing.assert_allclose(footage.frame(n)[20, 30, 0], shades[n], atol=12)
        assert footage.frame(n)[20, 30, 3] == 255
    assert footage.index_at(0.25) == 2


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.png", None, "no such file"),
        ("a.txt", b"x", r"ending '\.txt', expected a picture"),
        ("a.png", b"not a picture", "cannot be read as a picture"),
        ("a.mp4", b"not a video", "cannot be read as a video"),
    ],
)
def test_what_cannot_be_shown_is_one_line_with_the_file(tmp_path, name, content, message):
    if name.endswith("mp4"):
        pytest.importorskip("imageio_ffmpeg")
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        open_footage(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="no picture in it"):
        open_footage(tmp_path)
