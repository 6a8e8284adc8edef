"""Truths of handles as values: what they may be made of, and what is refused by name."""

import numpy as np
import pytest

from deformer import Handle, HandleSolver, InputError, SurfacePoint
from shapes import small_model


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
