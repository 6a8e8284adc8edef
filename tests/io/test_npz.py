"""NPZ files that other programs wrote, and copies of them."""

import io as streams
import warnings
import zipfile

import numpy as np
import pytest

from deformer import InputError, io
from shapes import sequence


def member(array):
    stream = streams.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


def test_headers_of_python_2_are_read_without_a_warning(tmp_path):
    shapes = sequence(2)
    with zipfile.ZipFile(tmp_path / "old.npz", "w") as archive:
        for name in ("vertices", "faces"):
            content = member(getattr(shapes, name))
            # Python 2 wrote long integers with an L; the padding makes room for it.
            old = content.replace(b", 3)", b", 3L)", 1).replace(b" \n", b"\n", 1)
            archive.writestr(f"{name}.npy", old)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = io.load_shapes(tmp_path / "old.npz")
    np.testing.assert_array_equal(found.vertices, shapes.vertices)


@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("notes.txt", b"hello", "notes.txt"),
        ("weights.npy", member(np.zeros(4))[:-8], "array 'weights': 24 bytes"),
        ("weights.npy", b"\x93NUMPY\x01\x00", "array 'weights'"),
    ],
)
def test_what_a_copy_would_not_keep_is_refused(tmp_path, name, content, part):
    """Shapes are read past it, for which it is of no account."""
    shapes = sequence(2)
    io.write_npz(tmp_path / "walk.npz", {"vertices": shapes.vertices, "faces": shapes.faces})
    with zipfile.ZipFile(tmp_path / "walk.npz", "a") as archive:
        archive.writestr(name, content)
    read = io.load_shapes(tmp_path / "walk.npz")
    options = {"changed": (), "kept": np.arange(read.vertices.shape[1]), "faces_changed": False}
    with pytest.raises(InputError) as caught:
        io.save_copy(tmp_path / "walk.npz", tmp_path / "copy", read, **options)
    assert str(caught.value).startswith(str(tmp_path / "walk.npz"))
    assert part in str(caught.value)
    assert not (tmp_path / "copy").exists()
