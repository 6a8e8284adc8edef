"""Blends between the present pose and another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer_app.viewer.edit import Edit, Solution
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.handle_changes import carried


class PoseBlend:
    """Moves the pose between the one before the first `move` and a chosen one.

    The latent codes are interpolated, and handles go along to their places on the shape, as when
    starting from a pose. A blend goes on from where it was until something else changes the pose.

    Args:
        editor: whose pose is blended.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin without a chosen pose."""
        self._editor = editor
        self._name = ""
        self._chosen: tuple[float, ...] | None = None
        self._start: NDArray[np.float64] = np.zeros(0)
        self._result: Edit | None = None
        self._share = 0.0

    @property
    def chosen(self) -> str | None:
        """Name of the chosen pose, or None."""
        return None if self._chosen is None else self._name

    def choose(self, name: str, code: tuple[float, ...] | None) -> None:
        """Choose the pose to blend with; None chooses none."""
        if (name, code) != (self._name, self._chosen):
            self._name, self._chosen = name, code
            self._result = None

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
        if self._result is None or editor.edit != self._result:
            self._start = editor.code
        between = np.array([self._start, self._chosen])
        code = deformer.interpolate_codes(between, share)
        self._share = share
        handles = carried(editor.edit.handles, editor.model, editor.model.decode(code))
        self._result = replace(editor.edit, base=tuple(code.tolist()), handles=tuple(handles))
        editor.show_edit(self._result)

    def commit(self) -> None:
        """Make the blend a step of the history."""
        if self._result is not None and self._editor.session.under_way:
            self._editor.commit(f"Blend with {self._name}", Solution.of_code(self._result.base))
