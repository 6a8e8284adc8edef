"""A reference is one of the shapes, by name or number, or a file before them."""

from pathlib import Path

import numpy as np
import pytest

from deformer import io
from deformer.errors import InputError
from deformer.geometry import Mesh, MeshSequence

FACES = np.array([[0, 1, 2], [0, 2, 3]])
SHAPES = MeshSequence(
    np.stack([np.eye(4, 3) * n for n in (1, 2, 3)]), FACES, ("rest", "2", "bent.left")
)


def refusal(reference, shapes=SHAPES):
    with pytest.raises(InputError) as caught:
        io.with_reference(shapes, reference)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("reference", "index"),
    [("bent.left", 2), ("2", 1), ("0", 0), (2, 2), (-1, 2), (np.int64(1), 1)],
)
def test_a_name_comes_before_a_number(reference, index):
    shapes, found = io.with_reference(SHAPES, reference)
    assert shapes is SHAPES and found == index


@pytest.mark.parametrize("kind", [str, Path])
def test_a_file_becomes_shape_0(tmp_path, kind):
    io.save_mesh(tmp_path / "tpose.obj", Mesh(np.ones((4, 3)), FACES[::-1, [1, 2, 0]]))
    shapes, index = io.with_reference(SHAPES, kind(tmp_path / "tpose.obj"))
    assert index == 0 and shapes.names == ("tpose", "rest", "2", "bent.left")
    np.testing.assert_array_equal(shapes.vertices, [np.ones((4, 3)), *SHAPES.vertices])
    np.testing.assert_array_equal(shapes.faces, FACES)
    nameless = MeshSequence(SHAPES.vertices, FACES)
    assert io.with_reference(nameless, kind(tmp_path / "tpose.obj"))[0].names == ()


def test_other_references_are_refused(tmp_path):
    assert "'bent'" in refusal("bent") and "'rest'" in refusal("bent")
    assert "0…2" in refusal("7")
    assert "shape 7" in refusal(7)
    io.save_mesh(tmp_path / "a.obj", Mesh(np.ones((5, 3)), FACES))
    assert "a.obj: 5 vertices" in refusal(tmp_path / "a.obj")
    io.save_mesh(tmp_path / "b.obj", Mesh(np.ones((4, 3)), FACES[:, ::-1]))
    assert "connectivity" in refusal(tmp_path / "b.obj")
    assert "reference" in refusal("x" * 5000)


def test_names_are_of_every_shape_and_kept_by_subsets():
    assert SHAPES.subset([2, 0]).names == ("bent.left", "rest")
    assert MeshSequence(SHAPES.vertices, FACES).subset([1]).names == ()
    for names in (("a",), "abc", ("a", "b", 3), ("a", "b", "\ud800")):
        with pytest.raises(InputError, match="names"):
            MeshSequence(SHAPES.vertices, FACES, names)
