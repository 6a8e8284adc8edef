"""Directories that are written whole: what is replaced there is what this program has written."""

import json
import os
import socket

import numpy as np
import pytest

from deformer import InputError, io, load_model
from shapes import sequence, small_model


def put(path, *names):
    """Write a directory with some files."""
    with io.atomic_directory(path, lambda entry: entry.suffix == ".txt") as folder:
        for name in names:
            (folder / name).write_text(f"contents of {name}")


def tree(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def refusal(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


@pytest.fixture
def target(tmp_path):
    put(tmp_path / "out", "a.txt", "b.txt")
    return tmp_path / "out"


def test_a_directory_as_it_was_written_is_replaced_as_a_whole(target):
    put(target, "c.txt")
    assert sorted(tree(target)) == [io.directories.MANIFEST, "c.txt"]
    (target / "c.txt").unlink()  # less than was written is nobody's loss
    put(target, "d.txt")
    assert "d.txt" in tree(target)


def mine(target):
    (target / "mine.txt").write_text("keep me")
    return "'mine.txt', which this program has not written"


def edited(target):
    text = (target / "a.txt").read_text()
    (target / "a.txt").write_text(text.upper())
    return "'a.txt', which has changed since"


def linked(target):
    (target.parent / "mine.txt").write_text("keep me")
    (target / "a.txt").unlink()
    (target / "a.txt").symlink_to(target.parent / "mine.txt")
    return "'a.txt', which has changed since"


def inside(target):
    (target / "a.txt").unlink()
    (target / "a.txt").mkdir()
    return "'a.txt', which this program does not write"


def unproved(target):
    (target / io.directories.MANIFEST).unlink()
    return "'a.txt', which this program has not written"


def of_others(target):
    (target / io.directories.MANIFEST).write_text('{"name": "mine"}')
    return f"'{io.directories.MANIFEST}', which this program"


@pytest.mark.parametrize("change", [mine, edited, linked, inside, unproved, of_others])
def test_what_is_not_proved_to_be_the_programs_stays(target, change):
    told, before = change(target), tree(target)
    for write in (lambda: put(target, "c.txt"), lambda: io.check_directory(target, lambda _: True)):
        message = refusal(write)
        assert message.startswith(f"{target}: already holds {told}")
    assert tree(target) == before
    assert [path for path in target.parent.iterdir() if path.name.startswith(".")] == []


def foreign_model(folder):
    (folder / "model.json").write_text(json.dumps({"name": "resnet", "layers": 50}))


def foreign_weights(folder):
    small_model().save(folder)
    (folder / "weights.safetensors").write_bytes(b"weights of my own")


def foreign_reference(folder):
    small_model().save(folder)
    io.save_mesh(folder / "reference.ply", sequence(2).mesh(1))


@pytest.mark.parametrize("put", [foreign_model, foreign_weights, foreign_reference])
def test_a_model_goes_over_no_file_that_only_has_its_name(tmp_path, put):
    put(tmp_path)
    before = tree(tmp_path)
    message = refusal(small_model().save, tmp_path)
    assert put.__name__.removeprefix("foreign_") in message
    assert tree(tmp_path) == before


def test_a_model_that_is_saved_again_keeps_its_card(tmp_path):
    """The card alone is no reason to refuse, either."""
    (tmp_path / "README.md").write_text("my notes")
    for _ in range(2):
        small_model().save(tmp_path)
    assert (tmp_path / "README.md").read_text() == "my notes"
    assert load_model(tmp_path).components == small_model().components


def test_shapes_of_the_user_are_not_replaced(tmp_path):
    shapes, folder = sequence(2), tmp_path / "mine"
    folder.mkdir()
    io.save_mesh(folder / "0000.ply", shapes.mesh(0))
    before = tree(folder)
    assert "'0000.ply'" in refusal(io.save_shapes, folder, shapes)
    kept = np.arange(shapes.vertices.shape[1])
    changes = {"changed": (), "kept": kept, "faces_changed": False}
    io.save_shapes(tmp_path / "source", shapes)
    message = refusal(lambda: io.save_copy(tmp_path / "source", folder, shapes, **changes))
    assert "'0000.ply'" in message
    assert tree(folder) == before


POSIX = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes")


def pipe(path):
    os.mkfifo(path)


def listening(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path.name)


@POSIX
@pytest.mark.parametrize("make", [pipe, listening])
@pytest.mark.parametrize("through", [False, True], ids=["itself", "through a link"])
def test_what_is_no_file_is_not_replaced_by_one(tmp_path, monkeypatch, make, through):
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    shapes = sequence(2)
    for name, write in {
        "out.json": lambda path: io.write_json(path, {}),
        "out.npz": lambda path: io.save_shapes(path, shapes),
        "out.safetensors": lambda path: io.write_tensors(path, {"a": np.zeros(3)}),
        "out.ply": lambda path: io.save_mesh(path, shapes.mesh(0)),
        "folder": lambda path: io.save_shapes(path, shapes),
        "model": small_model().save,
    }.items():
        path = tmp_path / name
        made = tmp_path / f"special-{name}" if through else path
        make(made)
        if through:
            path.symlink_to(made)
        before = made.lstat()
        assert refusal(write, path).startswith(f"{path}: is a ")
        after = made.lstat()
        assert (before.st_ino, before.st_mode) == (after.st_ino, after.st_mode)
        assert path.is_symlink() == through


@POSIX
def test_what_is_named_as_a_shape_but_is_no_file_is_told(tmp_path):
    io.save_shapes(tmp_path, sequence(2))
    for name, make, told in [
        ("0002.ply", pipe, "is a directory, pipe or device"),
        ("0003.ply", lambda path: path.symlink_to("gone"), "is a link to a file that does not"),
    ]:
        make(tmp_path / name)
        message = refusal(io.load_shapes, tmp_path)
        assert message.startswith(f"{tmp_path / name}: {told}")
        (tmp_path / name).unlink()
    (tmp_path / "0004.ply").symlink_to("0001.ply")
    assert len(io.load_shapes(tmp_path)) == 3
