"""Truths of handles as values: what they may be made of, and what is refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import Handle, HandleSolver, InputError, SurfacePoint, e_rms, target_noise
from shapes import sequence, small_model


def test_numbers_of_numpy_become_plain_ones():
    given = Handle(np.int64(3), np.arange(3), np.float32(2), "pin")  # pyright: ignore
    assert given == Handle(3, (0.0, 1.0, 2.0), 2.0, "pin")
    assert hash(given) == hash(Handle(3, (0.0, 1.0, 2.0), 2.0, "pin"))
    assert type(given.vertex) is int and type(given.target[0]) is float


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("vertex", value) for value in (None, "3", 3.0, True, -1, [3], 2**70)),
        *(("target", value) for value in (None, 1.0, "abc", (1, 2), (1, 2, "x"), (1, 2, np.nan))),
        *(("target", value) for value in ([[1, 2, 3]], {"x": 1}, (1, [2], 3), (1, 2, 3j))),
        *(("weight", value) for value in (None, "1", 0, -1, np.inf, True, [1.0], 1e30)),
        *(("kind", value) for value in (None, "hard", 1, ["soft"], True)),
    ],
)
def test_wrong_arguments_are_refused_by_name(name, value):
    arguments = {"vertex": 3, "target": (0.0, 0.0, 0.0), name: value}
    with pytest.raises(InputError, match=rf"^{name}(\[\d\])?: expected .*; ") as caught:
        Handle(**arguments)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("vertices", [None, 3, 0.5, "ab", [[1, 2]], (1.0,)])
def test_points_of_other_things_than_vertices_are_refused(vertices):
    with pytest.raises(InputError, match=r"^vertices: expected"):
        SurfacePoint(vertices)


@pytest.mark.parametrize("kinds", [3, True, 0.5, {"soft": 1, 2: 3}, [None], [["soft"]], "hard"])
def test_kinds_that_are_none_are_refused(kinds):
    solver = HandleSolver(small_model())
    with pytest.raises(InputError, match=r"^kinds: expected one of soft, exact, pin, got"):
        solver.set_handles([3], [[0, 0, 0]], kinds=kinds)


def test_variances_of_targets_and_model_add_up():
    model = replace(small_model(), handle_noise=0.003)
    diagonal = model.reference.bounding_diagonal
    assert target_noise(model, 0.004 * diagonal) == pytest.approx(0.005)
    assert target_noise(model, 1e-9 * diagonal) == pytest.approx(0.003)
    assert target_noise(model, 0.024 * diagonal, sequence=True) == pytest.approx(0.025)
    for deviation in (0, -1.0, np.nan, np.inf, "1", None, True, 1e30):
        with pytest.raises(InputError, match=r"^deviation: expected a finite number above 0"):
            target_noise(model, deviation)


def test_handles_that_are_told_their_noise_come_closer_to_the_truth():
    model, shapes = small_model(), sequence().vertices[2:10]
    handles = np.arange(0, 120, 6)
    deviation = 0.03 * model.reference.bounding_diagonal
    targets = shapes[:, handles]
    targets = targets + deviation * np.random.default_rng(0).normal(size=targets.shape)
    errors = {}
    for hard, noise in ((True, None), (False, target_noise(model, deviation))):
        solver, found = HandleSolver(model, noise=noise), []
        for goals in targets:
            solver.set_handles(handles, goals, hard=hard)
            found.append(solver.solve().vertices)
        errors[hard] = e_rms(shapes, np.stack(found), "none")
    assert errors[False] < 0.7 * errors[True]
