"""Writes beside readers, interrupts and killed processes."""

import os
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from deformer import InputError, io
from deformer.io import atomic, directories

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="renameat2")


def put(path, content):
    """Write a directory with one file."""
    with io.atomic_directory(path, lambda entry: True) as folder:
        (folder / "a.txt").write_text(content)


@pytest.fixture
def target(tmp_path):
    put(tmp_path / "model.v2", "old")
    return tmp_path / "model.v2"


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@LINUX
def test_a_directory_is_replaced_without_a_moment_without_one(target, monkeypatch):
    def no_rename(*_):
        raise AssertionError("renamed in two steps")

    monkeypatch.setattr(Path, "rename", no_rename)
    put(target, "new")
    assert (target / "a.txt").read_text() == "new"
    assert names(target.parent) == ["model.v2"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, MemoryError])
@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("late", [False, True])
def test_where_it_takes_two_steps_neither_version_is_lost(target, monkeypatch, error, number, late):
    """An exception just before or after one of the two renames."""
    rename, calls = Path.rename, []

    def failing(path, other):
        calls.append(path)
        if len(calls) == number and not late:
            raise error
        found = rename(path, other)
        if len(calls) == number and late:
            raise error
        return found

    monkeypatch.setattr(directories, "_LINUX", False, raising=False)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", failing)
        with pytest.raises(error):
            put(target, "new")
    assert (target / "a.txt").read_text() == ("new" if number == 2 and late else "old")
    assert names(target.parent) == ["model.v2"]
    put(target, "newer")
    assert (target / "a.txt").read_text() == "newer"


def test_what_killed_processes_left_is_removed(target):
    died = subprocess.Popen([sys.executable, "-c", ""])
    died.wait()
    old = time.time() - 2 * 3600
    here, other = atomic._system(), "0" * 6
    kept, gone = [], []
    for where, system, process, age, suffix in [
        (gone, here, died.pid, time.time(), ".v2"),
        (gone, other, died.pid, old, ".v2"),
        (kept, other, died.pid, time.time(), ".v2"),
        (kept, here, os.getpid(), old, ".v2"),
        (kept, here, died.pid, old, ".v3"),  # of another directory
    ]:
        left = target.parent / f".model-{system}-{process}-0123abc{len(kept + gone)}{suffix}"
        left.mkdir()
        (left / "a.txt").write_text("half")
        os.utime(left, (age, age))
        where.append(left.name)
    put(target, "new")
    assert names(target.parent) == sorted([*kept, "model.v2"])


SAVER = """
import sys, deformer
from pathlib import Path
one, other = map(deformer.load_model, sys.argv[2:])
print("ready", flush=True)
while not Path(sys.argv[1] + "-stop").exists():
    one.save(sys.argv[1])
    other.save(sys.argv[1])
"""


@LINUX
@pytest.mark.slow
def test_a_reader_beside_a_writer_always_finds_a_whole_model(tmp_path):
    import deformer

    model = deformer.load_model("humanoid")
    versions = [
        replace(model, codes=factor * model.codes, component_names={0: name})
        for factor, name in ((1.0, "one"), (2.0, "other"))
    ]
    folder = tmp_path / "model"
    for version, path in zip(versions, (tmp_path / "one", tmp_path / "other"), strict=True):
        version.save(path)
    versions[0].save(folder)
    command = [sys.executable, "-c", SAVER, folder, tmp_path / "one", tmp_path / "other"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as saver:
        try:
            assert saver.stdout is not None
            assert saver.stdout.readline() == "ready\n"
            found = Counter()
            while min(found["one"], found["other"]) < 25:
                found[deformer.load_model(folder).component_names[0]] += 1
                assert saver.poll() is None
        finally:
            Path(f"{folder}-stop").touch()
    assert saver.returncode == 0
    assert found.keys() == {"one", "other"}
    assert names(tmp_path) == ["model", "model-stop", "one", "other"]


def test_a_name_too_long_for_its_temporary_file_is_one_line_before_anything_is_written(tmp_path):
    name = "x" * 240
    for write in (io.atomic_path, lambda path: io.atomic_directory(path, lambda entry: True)):
        with (
            pytest.raises(InputError, match="longer than the system allows"),
            write(tmp_path / name),
        ):
            raise AssertionError("work has started")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need rights there")
def test_a_file_behind_a_symbolic_link_is_written_and_the_link_stays(tmp_path):
    (tmp_path / "there").mkdir()
    file, link = tmp_path / "there" / "data", tmp_path / "link.txt"
    file.write_text("old")
    link.symlink_to(file)
    with io.atomic_path(link) as temporary:
        assert temporary.suffix == ".txt" and temporary.parent == file.parent
        temporary.write_text("new")
    assert link.is_symlink() and file.read_text() == link.read_text() == "new"
    assert names(tmp_path) == ["link.txt", "there"] and names(file.parent) == ["data"]


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need rights there")
def test_a_link_to_a_folder_that_is_not_there_is_refused_before_work(tmp_path):
    (tmp_path / "link.txt").symlink_to(tmp_path / "nowhere" / "data")
    with pytest.raises(InputError, match="nowhere"):
        io.check_output_file(tmp_path / "link.txt")
