"""Commands on an editor's picture: framing, looks, the mesh to compare with, previews."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deformer_app.viewer import handle_changes
from deformer_app.viewer.colouring import component_paint
from deformer_app.viewer.target import Target

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_AROUND = 0.06  # bounding diagonals around a handle that are framed with it


class PictureCommands:
    """Changes how an editor's pose is seen: no steps of the history.

    Args:
        editor: has the pose and the picture's state.
    """

    def __init__(self, editor: Editor) -> None:
        """Store the editor."""
        self._editor = editor

    def frame(self, azimuth: float = 25.0, elevation: float = 8.0) -> None:
        """Aim the camera at the whole shape from a direction in degrees; see `aim`."""
        viewpoint = self._editor.state.viewpoint
        self._frame(lambda: viewpoint.frame(self._editor.vertices, azimuth, elevation))

    def frame_selected(self) -> None:
        """Frame the selected handles and what is around them, or all; the direction stays."""
        self._frame(self._frame_selected)

    def _frame_selected(self) -> None:
        editor = self._editor
        chosen = editor.state.selection(editor.edit.handles)
        reach = _AROUND * editor.model.reference.bounding_diagonal
        near = handle_changes.surroundings(chosen, editor.vertices, reach)
        editor.state.viewpoint.frame_on(near if len(near) else editor.vertices)

    def frame_all(self) -> None:
        """Frame the whole shape from the present direction."""
        self._frame(lambda: self._editor.state.viewpoint.frame_on(self._editor.vertices))

    def _frame(self, aim: Callable[[], None]) -> None:
        """Aim the camera at what is seen and, if a step's pose is on its way, at that, too.

        An undo, a reset or a pasted pose may bring the body to another place.
        """
        editor = self._editor
        on_its_way = editor.busy and not (editor.dragging or editor.session.under_way)
        aim()
        if on_its_way and not editor.timeline.playing:
            editor.run(self._aim_at_rest(aim))

    def _aim_at_rest(self, aim: Callable[[], None]) -> Iterator[None]:
        """Aim once more when the pose rests, unless the user goes on with view or pose."""
        editor = self._editor
        edit, camera = editor.edit, editor.state.camera

        def goes_on() -> bool:
            return not editor.is_open or editor.edit != edit or editor.state.camera != camera

        while not (goes_on() or editor.at_rest):
            yield
        if not goes_on():
            aim()

    def change_look(self, **changes: Any) -> None:
        """Change how the picture is drawn; see `Look`."""
        state = self._editor.state
        before = state.look.colour
        state.change_look(**changes)
        if state.look.colour != before:
            self._editor.ask_for_colours()

    def load_target(self, path: str | Path) -> None:
        """Compare with a mesh of the same connectivity.

        Raises:
            InputError: the mesh has another number of vertices.
        """
        self._editor.state.target = Target.load(path, self._editor.model.reference)
        self.change_look(ghost="target", colour="error")
        self._editor.touch()

    def open_reference(self, path: str | Path) -> None:
        """Show a picture, a folder of pictures or a video to pose by; the session keeps its path.

        It is shown at the time of the playhead.

        Raises:
            InputError: see `ReferencePicture.open`.
        """
        reference, timeline = self._editor.state.reference_picture, self._editor.timeline
        reference.open(path)
        reference.set_frame(timeline.frame / timeline.clip.fps)
        self._editor.touch()

    def preview(self, component: int | None) -> None:
        """Colour the surface by the support of a component, or as before."""
        editor = self._editor
        if editor.activations is None:
            return
        if component is None:
            editor.state.preview_paint(None)
        else:
            label = editor.model.label(component)
            editor.state.preview_paint(component_paint(editor.activations, component, label))
