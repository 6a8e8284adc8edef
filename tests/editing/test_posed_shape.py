"""The shape of a solution without a solver."""

import numpy as np
import pytest

from deformer import HandleSolver, InputError, posed_shape
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


def test_it_is_the_surface_that_the_solver_restores(model):
    rotation, translation = [0.4, -0.3, 0.2], [0.1, 0.5, -0.2]
    for code in model.codes[:3]:
        pose = HandleSolver(model).restore(code, rotation, translation)
        shape = posed_shape(model, code, rotation, translation)
        size = model.reference.bounding_diagonal
        np.testing.assert_allclose(shape, pose.vertices, rtol=0, atol=1e-5 * size)


@pytest.mark.parametrize(
    ("name", "bad"),
    [("z", [0.0]), ("rotation", [0.0, np.nan, 0.0]), ("translation", [[0.0, 0.0, 0.0]])],
)
def test_arguments_that_are_wrong_are_named(model, name, bad):
    values = {"z": model.codes[0], "rotation": np.zeros(3), "translation": np.zeros(3), name: bad}
    with pytest.raises(InputError, match=name):
        posed_shape(model, **values)
