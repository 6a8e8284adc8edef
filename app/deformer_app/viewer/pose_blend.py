"""Blends between the present pose and another one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deformer_app.viewer.edit import Edit, Solution
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.pose_path import PosePath
from deformer_app.viewer.pose_worker import PoseWorker
from deformer_app.viewer.poses import SavedPose
from deformer_app.viewer.worker import in_background


class PoseBlend:
    """Moves the pose between the one before the first `move` and a chosen one, on a `PosePath`.

    Handles of the chosen pose come, too; at its end the blend is that pose, and others are gone,
    except in a clip, where they have keys at other frames. A blend goes on from where it was until
    something else changes the pose.

    Args:
        editor: whose pose is blended.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin without a chosen pose."""
        self._editor = editor
        self._chosen: SavedPose | None = None
        self._path: PosePath | None = None
        self._result: Edit | None = None
        self._arrived = Edit(())
        self._shown: NDArray[np.float64] | None = None
        self._known: Solution | None = None
        self._share = 0.0

    @property
    def chosen(self) -> str | None:
        """Name of the chosen pose, or None."""
        return None if self._chosen is None else self._chosen.name

    def choose(self, pose: SavedPose | None) -> None:
        """Choose the pose to blend with; None chooses none."""
        if pose == self._chosen:
            return
        self._chosen, self._result, self._shown = pose, None, None
        if pose is not None and pose.handles:
            self._editor.run(self._solve(pose))

    def _solve(self, pose: SavedPose) -> Iterator[None]:
        """Find the surface of a chosen pose, on which handles of others shall not pull."""
        model = self._editor.model
        found = yield from in_background(
            lambda: PoseWorker(model).final_pose(pose.edit, pose.solution)
        )
        if pose == self._chosen and self._editor.is_open and self._editor.model is model:
            self._shown = found.vertices

    @property
    def share(self) -> float:
        """Share of the chosen pose in the present one: 0 unless the present pose is a blend."""
        editor = self._editor
        same = editor.is_open and self._result is not None and editor.edit == self._result
        return self._share if same else 0.0

    def move(self, share: float) -> None:
        """Show the blend with a share of the chosen pose, 0 to 1, until `commit`."""
        editor = self._editor
        if self._chosen is None or editor.dragging:
            return
        if self._path is None or editor.edit != self._result:
            self._path = self._way(self._chosen)
        self._share = share
        if share == 1.0 and self._chosen.handles and not editor.timeline.clip.tracks:
            self._result, self._known = self._arrived, self._chosen.solution
        else:
            self._result, self._known = self._path.at(share)
        editor.show_edit(self._result)

    def _way(self, chosen: SavedPose) -> PosePath:
        """The path from the present state, with the chosen pose's handles on its surface."""
        editor = self._editor
        edit = editor.edit
        self._arrived = chosen.with_ids(edit.handles, editor.session.next_id())
        present = {handle.id for handle in edit.handles}
        added = [
            editor.handles.on_surface(handle)
            for handle in self._arrived.handles
            if handle.id not in present
        ]
        return PosePath(editor.model, edit, chosen, added, self._shown)

    def commit(self) -> None:
        """Make the blend a step of the history."""
        editor = self._editor
        if self._chosen is not None and editor.session.under_way and editor.edit == self._result:
            editor.commit(f"Blend with {self._chosen.name}", self._known, whole=True)
