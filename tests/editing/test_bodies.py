"""How far the whole body goes along with a handle."""

import numpy as np
import pytest

from deformer import HandleSolver, load_model

STILLEST = 0.25  # share of the vertices that move least in the examples


def example_motion(model):
    """RMS distances (V,) of the examples' vertices from their means, in diagonals."""
    shapes = model.decode(model.codes)
    squares = np.square(shapes - shapes.mean(axis=0)).sum(axis=2)
    return np.sqrt(squares.mean(axis=0)) / model.reference.bounding_diagonal


def mean_travel(model, motion, body, pull):
    """How far the stillest vertices go, in diagonals, when the one that moves most is pulled."""
    start = model.decode(model.prior.mean)
    at = int(motion.argmax())
    solver = HandleSolver(model, noise=0.007, freedom=body)
    solver.set_handles([at], [start[at] + np.array(pull) * model.reference.bounding_diagonal])
    still = motion <= np.quantile(motion, STILLEST)
    moved = np.linalg.norm(solver.solve().vertices - start, axis=1)[still]
    return float(moved.mean()) / model.reference.bounding_diagonal


@pytest.mark.parametrize("body", ["auto", "stays"])
def test_a_pull_at_a_face_leaves_its_neck_where_all_examples_have_it(body):
    model = load_model("face")
    motion = example_motion(model)
    assert np.quantile(motion, STILLEST) < 1e-3
    for pull in ((0.0, -0.05, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, 0.05)):
        assert mean_travel(model, motion, body, pull) < 3e-3
    assert mean_travel(model, motion, "moves", (0.05, 0.0, 0.0)) > 0.03


@pytest.mark.parametrize(("name", "stays"), [("humanoid", False), ("hand", False), ("face", True)])
def test_the_examples_say_whether_the_body_travels(name, stays):
    """The body of "auto" and "stays" is as free as without examples, where they travel."""
    model = load_model(name)
    assert model.travel == pytest.approx(np.median(example_motion(model)), rel=0.9, abs=1e-3)
    free = HandleSolver(model, freedom="stays").energy.freedom
    assert free == (pytest.approx(model.travel) if stays else 0.01)
    weights, constant = HandleSolver(model, freedom="auto").energy.freedom.stiffness(np.zeros(6))
    assert constant == 0
    expected = min(model.travel, 0.01)
    np.testing.assert_allclose(weights, [(2 * expected) ** -2] * 3 + [expected**-2] * 3)
