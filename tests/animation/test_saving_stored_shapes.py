"""Sequences whose positions are in a file are written as those in memory."""

import numpy as np
import pytest

import deformer
from deformer import StoredShapes, Workspace, load_shapes, save_shapes
from deformer.workspace import LEAST_MEMORY
from shapes import small_model


@pytest.mark.parametrize("name", ["w.npz", "w.mdd", "w.pc2", "w", "w.glb"])
def test_shapes_in_a_file_are_written_as_those_in_memory(tmp_path, name):
    model = small_model()
    vertices = model.decode(model.codes[:7])
    rows = Workspace(LEAST_MEMORY, tmp_path).doubles(vertices.shape)
    rows[:7] = vertices
    stored = StoredShapes(rows, model.reference.faces)
    written = []
    for folder, shapes in (("a", stored), ("b", deformer.MeshSequence(vertices, stored.faces))):
        (tmp_path / folder).mkdir()
        save_shapes(tmp_path / folder / name, shapes)
        written.append(load_shapes(tmp_path / folder / name).vertices)
    np.testing.assert_array_equal(*written)
