"""Marks of the live mirror: rings around handles that are posed together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deformer_app.rendering.palette import LINKED
from deformer_app.viewer.edit import Handle

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_RADIUS = 13.0  # pixels


class MirrorMarks:
    """Draws a thin ring around each handle that has a partner while the live mirror is on.

    Args:
        editor: has the handles and the mirror.
    """

    def __init__(self, editor: Editor) -> None:
        """Draw with every frame of the editor."""
        self._editor = editor
        editor.state.drawings.append(self._draw)

    def _draw(self, vertices: NDArray[np.float64], handles: Sequence[Handle]) -> None:
        mirror = self._editor.mirror
        pairs = mirror.live.pairs(handles) if mirror.is_live else []
        rings = [vertices[list(handle.vertices)].mean(axis=0) for handle, _ in pairs]
        self._editor.state.view.overlays.show_rings(rings, _RADIUS, LINKED)
