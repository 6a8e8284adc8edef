"""From the last solution of a solver to the pose of its handles at rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from deformer.checks import checked_instance
from deformer.editing.handles import Pose
from deformer.editing.solver import HandleSolver

# The most warm solves; a mesh of a thousand vertices needs some thirty.
_SOLVES = 200


def poses_to_rest(solver: HandleSolver) -> Iterator[Pose]:
    """Poses from a solver's last solution to the one at rest, as a window shows them one by one.

    Each is a warm `HandleSolver.solve`. At rest no refinement lowers the energy, no start of a cold
    solve leads to a lower minimum, and the surface is relaxed: the last pose is a function of its
    code, its rigid motion and the handles alone. A solution restored with the handles for which it
    came to rest remains as it is. Without a last solution, one cold solve is all.

    Args:
        solver: with its handles; what it yields last is its solution then.

    Raises:
        InputError: no solver.
    """
    checked_instance(solver, "solver", HandleSolver, remedy="make one of the model")
    return _poses(solver)


def solve_to_rest(solver: HandleSolver) -> Pose:
    """The last of `poses_to_rest`, with the steps and the time of all of them.

    Args:
        solver: with its handles.

    Raises:
        InputError: no solver.
    """
    poses = list(poses_to_rest(solver))
    steps = sum(pose.iterations for pose in poses)
    milliseconds = sum(pose.milliseconds for pose in poses)
    return replace(poses[-1], iterations=steps, milliseconds=milliseconds)


def _poses(solver: HandleSolver) -> Iterator[Pose]:
    for _ in range(_SOLVES):
        yield solver.solve(warm=True)
        if solver.at_rest:
            return
    yield solver.relax()
