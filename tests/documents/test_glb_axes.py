"""Truths of GLB files of data whose z axis points up."""

import numpy as np
import pytest

import deformer
import tubes
from deformer import Mesh, MeshSequence, load_shapes
from deformer.documents import upright_glb
from foreign import as_other_programs_read

# z to y, and y to −z.
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@pytest.fixture
def document(tmp_path):
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    return deformer.load_document(tmp_path / "tube.obj")


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("like", [False, True])
def test_meshes_stand_upright(document, like, up, tmp_path):
    p = tubes.positions(0.7)
    mesh = Mesh(p, document.faces)
    deformer.save_mesh(tmp_path / "a.glb", mesh, document if like else None, up=up)
    found = as_other_programs_read(tmp_path / "a.glb")[0]
    expected = p @ UPRIGHT if up == "z" else p
    apart = np.linalg.norm(found[:, None] - expected, axis=2)
    assert apart.min(axis=1).max() < 1e-6 and apart.min(axis=0).max() < 1e-6


def test_documents_that_are_glb_files_are_upright_already(document, tmp_path):
    (tmp_path / "a.glb").write_bytes(document.write(tubes.positions(), ".glb"))
    own = deformer.load_document(tmp_path / "a.glb")
    assert own is not None
    data = own.write(load_shapes(tmp_path / "a.glb").vertices[0])
    assert upright_glb(data, "z", own) == data
    assert upright_glb(data, "z") != data


def test_clips_stand_upright(document, tmp_path):
    shapes = MeshSequence([tubes.positions(bend) for bend in (0.0, 0.4, 0.8)], document.faces)
    deformer.save_shapes(tmp_path / "a.glb", shapes, fps=10, tolerance=1e-5, up="z")
    found = as_other_programs_read(tmp_path / "a.glb", fps=10, clip=0)
    np.testing.assert_allclose(found, shapes.vertices @ UPRIGHT, atol=1e-4)
