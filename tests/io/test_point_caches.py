"""MDD and PC2 caches give the frames of the mesh beside them."""

import struct

import numpy as np
import pytest

from deformer import io
from deformer.errors import InputError
from deformer.geometry import Mesh

FACES = np.array([[0, 1, 2], [0, 2, 3]])
FRAMES = np.random.default_rng(0).normal(size=(3, 4, 3)).astype("f4")


def mdd(frames=FRAMES, counts=None):
    head = struct.pack(">ii", *(counts or frames.shape[:2]))
    return head + np.arange(len(frames), dtype=">f4").tobytes() + frames.astype(">f4").tobytes()


def pc2(frames=FRAMES, name=b"POINTCACHE2\0", version=1, counts=None):
    samples, points = counts or frames.shape[:2]
    head = struct.pack("<12siiffi", name, version, points, 10.0, 0.5, samples)
    return head + frames.astype("<f4").tobytes()


CACHES = {"walk.mdd": mdd(), "walk.pc2": pc2()}


def folder_of(folder, name="walk.mdd", content=None, base="walk.obj"):
    (folder / name).write_bytes(CACHES[name] if content is None else content)
    if base:
        io.save_mesh(folder / base, Mesh(np.eye(4, 3), FACES))
    return folder / name


def refusal(path, **options):
    with pytest.raises(InputError) as caught:
        io.load_shapes(path, **options)
    message = str(caught.value)
    assert "\n" not in message and path.name in message
    return message


@pytest.mark.parametrize("name", CACHES)
def test_caches_are_read_exactly_with_the_faces_beside_them(tmp_path, name):
    path = folder_of(tmp_path, name)
    for source in (path, tmp_path):
        shapes = io.load_shapes(source)
        np.testing.assert_array_equal(shapes.vertices, FRAMES.astype(float))
        np.testing.assert_array_equal(shapes.faces, FACES)
    assert (
        shapes.names
        == {
            "walk.mdd": ("walk 0 s", "walk 1 s", "walk 2 s"),
            "walk.pc2": ("walk frame 10", "walk frame 10.5", "walk frame 11"),
        }[name]
    )


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"abc", "3 bytes"),
        (mdd()[:-1], "155 bytes after the header, expected 156 of 3 frames of 4 points"),
        (mdd() + b"x", "157 bytes"),
        (mdd(counts=(2**31 - 1, 2**31 - 1)), "2147483647 frames"),
        (mdd(counts=(-3, 4)), "-3 frames"),
        (mdd(counts=(0, 0)), "0 frames"),
        (mdd(FRAMES * np.nan), "nan"),
        (mdd(FRAMES[:, :3]), "3 points, expected 4 as the vertices of walk.obj"),
    ],
)
def test_mdd_that_is_damaged_is_refused(tmp_path, content, part):
    assert part in refusal(folder_of(tmp_path, content=content))


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"POINTCACHE2\0", "header"),
        (pc2(name=b"POINTCACHE3\0"), "POINTCACHE2"),
        (pc2(version=2), "version 2"),
        (pc2()[:-4], "140 bytes after the header, expected 144 of 3 frames of 4 points"),
        (pc2(counts=(2**31 - 1, 2**31 - 1)), "2147483647 frames"),
        (pc2(counts=(3, -4)), "-4 points"),
    ],
)
def test_pc2_that_is_damaged_is_refused(tmp_path, content, part):
    assert part in refusal(folder_of(tmp_path, "walk.pc2", content))


def test_a_cache_needs_one_mesh_of_its_name(tmp_path):
    path = folder_of(tmp_path, base="run.obj")
    assert "no mesh beside it" in refusal(path)
    for name in ("walk.obj", "walk.ply"):
        io.save_mesh(tmp_path / name, Mesh(np.eye(4, 3), FACES))
    assert "walk.obj and walk.ply" in refusal(path)
    (tmp_path / "walk.ply").unlink()
    assert "no animation" in refusal(path, clip=0)
    folder_of(tmp_path, "walk.pc2")
    assert "walk.mdd and walk.pc2" in refusal(tmp_path)
    with pytest.raises(InputError, match="is a point cache"):
        io.load_mesh(path)
