"""Locks: one process at a time writes an output, and a dead one does not block it."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import filelock
import pytest

from deformer import io
from deformer.errors import InputError

HOLDER = """
import sys
from deformer import io
with io.locked(sys.argv[1]):
    print("locked", flush=True)
    sys.stdin.read()
"""


def holder(path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"locked\n"
    return process


def refused(path):
    with pytest.raises(InputError, match="another process is writing") as caught, io.locked(path):
        pass
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("ending", ["regular", "killed"])
def test_a_second_process_is_refused_until_the_first_has_ended(tmp_path, ending):
    with holder(tmp_path / "out") as process:
        refused(tmp_path / "out")
        with io.locked(tmp_path / "other"):
            pass
        if ending == "killed":
            process.kill()
            process.wait()
    with io.locked(tmp_path / "out"):
        pass
    assert not any(tmp_path.iterdir())


def test_all_names_of_an_output_are_one(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to("out")
    monkeypatch.chdir(tmp_path)
    with holder("out"):
        refused(tmp_path / "link")
        refused(tmp_path / "out" / ".." / "out")


def test_a_block_within_a_block_has_the_lock_and_another_thread_does_not(tmp_path):
    path, found = tmp_path / "out", []
    with io.locked(path):
        with io.locked(path):
            pass
        thread = threading.Thread(target=lambda: found.append(refused(path)))
        thread.start()
        thread.join()
        assert found == [None]
    assert not any(tmp_path.iterdir())


def test_the_lock_is_free_after_the_block_where_its_file_stays(tmp_path, monkeypatch):
    """As on Windows, which removes no open file; the object lives on, as in a traceback."""
    alive = []

    class Kept(filelock.FileLock):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            alive.append(self)

    def refuse(*_, **__):
        raise PermissionError

    monkeypatch.setattr(filelock, "FileLock", Kept)
    monkeypatch.setattr(Path, "unlink", refuse)
    with io.locked(tmp_path / "out"):
        assert len(alive) == 1
    with holder(tmp_path / "out"):
        refused(tmp_path / "out")


def test_no_two_hold_it_while_its_file_comes_and_goes(tmp_path):
    """Threads that take the lock again and again; each asserts that it is alone."""
    inside, faults = [], []

    def take():
        for _ in range(100):
            with io.locked(tmp_path / "out", wait=60):
                inside.append(1)
                time.sleep(0.001)  # lets the other threads come in
                if len(inside) != 1:
                    faults.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=take) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults
    assert not any(tmp_path.iterdir())


def test_a_missing_parent_is_named(tmp_path):
    with (
        pytest.raises(InputError, match="does not exist; create it"),
        io.locked(tmp_path / "a" / "b"),
    ):
        pass


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_where_only_the_directory_itself_is_writable_the_lock_is_inside(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    tmp_path.chmod(0o500)
    try:
        with holder(out):
            refused(out)
        assert not any(out.iterdir())
    finally:
        tmp_path.chmod(0o700)
