"""Which axis of example shapes seems to point up."""

import numpy as np
import pytest

import deformer
from deformer_app.viewer.up_axis import first_shape, likely_up, up_axis_of
from shapes import sequence


def box(x, y, z):
    """Corners (8, 3) of a box by its ranges."""
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)


@pytest.mark.parametrize(
    ("vertices", "up"),
    [
        (box((-1, 1), (-2, 2), (-0.5, 0.5)), "y"),  # a figure about the origin
        (box((-1, 1), (-0.5, 0.5), (-2, 2)), "z"),
        (box((-1, 1), (-1, 1), (0, 1.5)), "z"),  # both figures stand on the origin's plane
        (box((-1, 1), (0, 1.5), (-3, 3)), "y"),  # a long animal
        (box((-1, 1), (-3, 3), (0.01, 1.5)), "z"),
        (box((-1, 1), (-1, 1), (-1, 1)), "y"),
    ],
)
def test_a_shape_stands_on_the_origin_or_along_its_longer_side(vertices, up):
    assert likely_up(vertices) == up
    assert likely_up(vertices[:, [0, 2, 1]]) == {"y": "z", "z": "y"}[up] or np.ptp(vertices) == 2


@pytest.mark.parametrize("name", ["shapes.npz", "shapes", "shapes.glb"])
def test_the_first_shape_of_any_source_and_what_its_file_says(tmp_path, name):
    shapes = sequence(3)  # along x
    deformer.save_shapes(tmp_path / name, shapes, up="z")
    mesh = first_shape(tmp_path / name)
    np.testing.assert_allclose(mesh.vertices, shapes.vertices[0], atol=1e-6)
    document = deformer.load_document(tmp_path / name)
    assert up_axis_of(mesh, document) == ("z" if name.endswith("glb") else "y")


@pytest.mark.parametrize("name", ["humanoid", "face", "hand"])
def test_the_shipped_models_stand_as_they_were_trained(name):
    model = deformer.load_model(name)
    assert likely_up(model.reference.vertices) == model.up
