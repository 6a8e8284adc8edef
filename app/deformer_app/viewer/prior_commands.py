"""Commands on an editor's prior: the code to start from, its components, noise and body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from deformer_app.viewer.component_names import component_title
from deformer_app.viewer.component_scale import ComponentScale
from deformer_app.viewer.edit import Body, Edit
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.pose_path import PosePath
from deformer_app.viewer.poses import SavedPose
from deformer_app.viewer.target import load_alike
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_SEEN = 0.005  # a difference of two weights that their numbers show


class PriorCommands:
    """Changes the prior of an editor's state.

    Args:
        editor: has the state and its history.
    """

    def __init__(self, editor: Editor) -> None:
        """Store the editor."""
        self._editor = editor
        self._code_before_slide = np.zeros(0)

    def start_from(self, name: str, code: ArrayLike) -> None:
        """Make a latent code (K,) the prior's mean; see `start_at`."""
        self.start_at(f"Start from {name}", code)

    def start_at(self, label: str, code: ArrayLike) -> None:
        """Show the shape of a latent code (K,), the prior's mean from now on, as a step.

        Handles go along to their places on the shape, so that none of them pulls, and pins hold
        (`PosePath`); while the timeline keys by itself, the step is their key at the playhead.

        Args:
            label: of the step.
            code: the code.
        """
        editor = self._editor
        base = tuple(float(value) for value in np.asarray(code))
        edit, solution = PosePath(editor.model, editor.edit, SavedPose.of_code(label, base)).at(1.0)
        editor.change(label, edit, both_sides=False, solution=solution, whole=True)
        if any(handle.kind == "pin" for handle in edit.handles):
            editor.note("Pins hold; delete them or make them soft for the whole pose")

    def start_from_mesh(self, path: str | Path) -> None:
        """Start from the code whose shape is closest to a mesh; a background job finds it.

        Raises:
            InputError: the mesh has another number of vertices.
        """
        editor, model = self._editor, self._editor.model
        mesh = load_alike(path, model.reference)

        def fit() -> Iterator[None]:
            editor.note(f"Looking for the code of {path} …")
            code = yield from in_background(lambda: model.fit(mesh.vertices))
            if editor.is_open and editor.model is model:
                self.start_from(Path(path).name, code)

        editor.run(fit())

    def reset(self) -> None:
        """Go back to the reference, with no handles."""
        editor = self._editor
        code = start_codes(editor.model)["Reference"]
        base = tuple(float(value) for value in code)
        editor.change("Start from reference", replace(editor.edit, base=base, handles=()))

    def use_as_base(self) -> None:
        """Make the shown pose the prior's mean; handles are unchanged."""
        editor, answer = self._editor, self._editor.answer
        if answer is not None:
            editor.change("Start from this pose", replace(editor.edit, base=answer.solution.z))

    def slide(self, component: int, value: float) -> None:
        """Set a component of the prior's mean until `commit`; not during a drag."""
        editor = self._editor
        if editor.dragging:
            return
        if editor.before_drag is None:
            self._code_before_slide = editor.code
        start = editor.begin_drag()
        base = list(start.base)
        base[component] += value - float(self._code_before_slide[component])
        editor.show_edit(replace(start, base=tuple(base)))

    def tell_of_pull(self, component: int, scale: ComponentScale, asked: float) -> None:
        """Say how far a component has come once the pose rests, where handles pull it elsewhere.

        Args:
            component: index k.
            scale: of the component.
            asked: the weight that it was to have.
        """
        edit = self._editor.edit
        if edit.handles:
            self._editor.run(self._tell_at_rest(edit, component, scale, asked))

    def _tell_at_rest(
        self, edit: Edit, component: int, scale: ComponentScale, asked: float
    ) -> Iterator[None]:
        editor = self._editor
        while editor.is_open and editor.edit == edit and not editor.at_rest:
            yield
        if editor.is_open and editor.edit == edit and editor.resting_solution is not None:
            found = scale.weight(float(editor.code[component]))
            if abs(found - asked) >= _SEEN:
                title = component_title(editor.model, component)
                editor.note(
                    f"{title}: {asked:.2f} asked for, {found:.2f} reached; handles hold the shape"
                )

    def set_noise(self, noise: float) -> None:
        """Set the expected distance of handles from their targets until `commit`."""
        self._editor.show_edit(replace(self._editor.edit, noise=noise))

    def set_body(self, body: Body) -> None:
        """Set whether the body may turn and travel as a whole."""
        self._editor.change("Body " + body, replace(self._editor.edit, body=body))
