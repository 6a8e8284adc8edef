"""Frames of a handles file that are in a temporary file are those in memory, as arrays, too."""

import json
from pathlib import Path

import numpy as np
import pytest

from deformer import InputError, Workspace, io
from deformer.io.stored_frames import StoredFrames
from deformer.workspace import LEAST_MEMORY, StoredArray

FACES = np.array([[0, 1, 2], [0, 2, 3]])


def handle(point, position, **more):
    place = {"vertex": point} if isinstance(point, int) else {"face": 1, "barycentric": point}
    return {**place, "position": position, **more}


FRAMES = [
    [handle(2, [0, 1, 2], weight=2.0, name="é"), handle([0.2, 0.3, 0.5], [1, 1, 1], kind="pin")],
    [],
    [handle(0, [3.5, 1, 2], orientation=[0, 1, 0, 0], orientation_weight=3.0)],
    [handle(2, None), handle(0, [1, 2, 3], gap=[0.5, 0, 0]), handle(1, [0, 0, 0], offset=0.25)],
]


@pytest.fixture
def path(tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "h.json").write_text(json.dumps({"noise": 0.5, "frames": FRAMES * 3}))
    return tmp_path / "h.json"


def test_frames_in_a_file_are_those_in_memory(path):
    folder = path.parent / "files"
    whole = io.load_handles(path, 4, FACES)
    stored = io.load_handles(path, 4, FACES, workspace=Workspace(LEAST_MEMORY, folder))
    assert stored.is_sequence and stored.noise == 0.5
    assert not isinstance(stored.frames, tuple) and len(stored.frames) == 12
    assert tuple(stored.frames) == whole.frames
    assert stored.frames[-2] == whole.frames[-2]
    assert tuple(stored.frames[3:9:2]) == whole.frames[3:9:2]
    with pytest.raises(IndexError):
        stored.frames[12]
    assert not any(folder.iterdir())


def test_arrays_have_what_the_frames_have(path):
    whole = io.load_handles(path, 4, FACES)
    found = io.handle_tracks(whole.frames)
    frames = whole.frames
    points = [2, frames[0][1].vertex, 0, frames[3][1].vertex]
    assert found.points == points
    assert found.orientations is not None and found.gaps is not None
    for f, frame in enumerate(frames):
        seen = {points.index(handle.vertex): handle for handle in frame}
        for h in range(4):
            assert found.weights[f, h] == (seen[h].weight if h in seen else 0.0)
            assert np.isnan(found.seen(slice(f, f + 1))[0, h]).all() == (h not in seen)
            if h in seen:
                assert found.targets[f, h].tolist() == list(seen[h].position)
                assert found.hard[f, h] == (seen[h].kind != "soft")
                assert found.gaps[f, h].tolist() == list(seen[h].gap)
            turned = h in seen and seen[h].orientation is not None
            assert np.isnan(found.orientations[f, h]).all() == (not turned)
    assert found.orientation_weights.tolist() == [1.0, 1.0, 3.0, 1.0]


def test_arrays_in_files_are_those_in_memory(path):
    folder = path.parent / "files"
    frames = io.load_handles(path, 4, FACES).frames
    whole = io.handle_tracks(frames)
    stored = io.handle_tracks(frames, Workspace(LEAST_MEMORY, folder))
    for name in ("targets", "weights", "hard", "orientations", "gaps"):
        rows = getattr(stored, name)
        assert isinstance(rows, StoredArray)
        np.testing.assert_array_equal(rows[:], getattr(whole, name), err_msg=name)
    plain = io.handle_tracks([frame for frame in frames if not frame])
    assert plain.points == [] and plain.orientations is None and plain.gaps is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_folder_is_told_and_not_the_file_that_is_read(tmp_path, monkeypatch):
    with Path("/dev/full").open("r+b", buffering=0) as full:
        monkeypatch.setattr(Workspace, "growing", lambda workspace: full)
        frames = StoredFrames(Workspace(1e9, tmp_path))
        with pytest.raises(InputError, match=r"cannot be written .* for the cache") as told:
            frames.append(())
    assert str(told.value).startswith(str(tmp_path))
