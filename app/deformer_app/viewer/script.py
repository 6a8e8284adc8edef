"""The present state of an editor as a Python script that makes the same pose."""

from __future__ import annotations

import textwrap
from typing import Any

from deformer import InputError
from deformer_app.viewer.editor import Editor

_WIDTH = 100
# Arguments of HandleSolver.set_handles that a script leaves out where no handle needs them.
_DEFAULTS: dict[str, Any] = {
    "weights": 1.0,
    "kinds": "soft",
    "orientations": None,
    "orientation_weights": 1.0,
    "gaps": (0.0, 0.0, 0.0),
}


def python_script(editor: Editor, output: str = "pose.ply") -> str:
    """Return a script that loads the model, sets prior, floor and handles, and saves the mesh.

    It needs the library alone. The solver restores the solution that is shown: another start may
    lead to another minimum, and going on from one at rest moves it by rounding and tolerances.

    Args:
        editor: what is shown there.
        output: name of the mesh file that the script writes.

    Raises:
        InputError: the solver is still being prepared.
    """
    if editor.preparing:
        raise InputError("The solver is still being prepared; try again in a moment")
    editor.wait_for_pose()
    edit, solution = editor.edit, editor.shown_solution
    assert solution is not None
    lines = [
        '"""A pose made in the viewer of Deformer."""',
        "",
        "import deformer",
        "",
        f"model = deformer.load_model({editor.session.model.path!r})",
        "solver = deformer.HandleSolver(model)",
        *_call("solver.set_prior", mean=edit.base, noise=edit.noise, freedom=edit.body),
    ]
    if edit.floor is not None:
        lines += [f"solver.set_floor(deformer.Floor.at(model, {edit.floor!r}))"]
    arguments = edit.arrays()
    needed = {
        name: values
        for name, values in arguments.items()
        if name not in _DEFAULTS or any(value != _DEFAULTS[name] for value in values)
    }
    start = {"z": solution.z, "rotation": solution.rotation, "translation": solution.translation}
    if solution.contacts:
        start["contacts"] = solution.contacts
    if edit.handles:
        lines += ["", *_call("solver.set_handles", **needed)]
        lines += ["", "# What was shown. After a change of handles, solve_to_rest goes on from it."]
    else:
        lines += [""]
    lines += _call("pose = solver.restore", **start)
    if not solution.final:
        lines += ["pose = deformer.solve_to_rest(solver)"]
    lines += [
        "",
        "mesh = deformer.Mesh(pose.vertices, model.reference.faces)",
        f"deformer.save_mesh({output!r}, mesh, like=model)",
    ]
    return "\n".join(lines) + "\n"


def _call(name: str, **arguments: Any) -> list[str]:
    """Return the lines of a call with an argument a line."""
    lines = [f"{name}("]
    for key, value in arguments.items():
        text = repr(list(value) if isinstance(value, tuple) else value)
        lines += textwrap.wrap(
            f"{key}={text},",
            _WIDTH,
            initial_indent="    ",
            subsequent_indent="        ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    return [*lines, ")"]
