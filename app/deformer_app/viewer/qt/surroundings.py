"""What a window gives to the panels of its docks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.timeline_view import TimelineView
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.shape_thumbnails import Thumbnails


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Parts of a window that panels use.

    Args:
        editor: what the user works with.
        thumbnails: small pictures of shapes.
        settings: what is remembered between two starts.
        time: the scale of the timeline, for all docks that show it.
        attempt: runs a function; on a mistake shows its message and returns False.
    """

    editor: Editor
    thumbnails: Thumbnails
    settings: Settings
    time: TimelineView
    attempt: Callable[[Callable[[], Any]], bool]
