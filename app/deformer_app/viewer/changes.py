"""Changes that an editor announces to its listeners; one class for each kind."""

from __future__ import annotations

from dataclasses import dataclass

from deformer import InputError
from deformer_app.mistakes import mistake
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.stage import Hover


@dataclass(frozen=True)
class Change:
    """Base class of changes."""


class ModelOpened(Change):
    """Another model, or another session of it, is open."""


class ModelClosed(Change):
    """No model is open any more."""


class HistoryChanged(Change):
    """The history has a new entry, shows another entry, or has been saved."""


class StepShown(Change):
    """Undo or redo shows another step of the history."""


class HandlesChanged(Change):
    """Handles were added or removed, or the selection has changed."""


class HandlesDragged(Change):
    """Handles follow the mouse."""


class PlaybackBegun(Change):
    """The clip begins to play."""


class PoseChanged(Change):
    """The solver has computed another pose."""


class ComponentsMeasured(Change):
    """Strengths and limits of the components are known."""


class ComponentsNamed(Change):
    """A component has another name."""


class PosesChanged(Change):
    """The saved poses of the session have changed."""


class LookChanged(Change):
    """The look of the picture or the tool of the mouse has changed."""


class CameraMoved(Change):
    """The camera has moved."""


class HoverChanged(Change):
    """The vertex, handle or part under the mouse has changed."""


@dataclass(frozen=True)
class MenuAsked(Change):
    """The user has clicked the right button at `pixel`, where `hover` is under the mouse."""

    pixel: Pixel
    hover: Hover


class FrameDrawn(Change):
    """A frame has been drawn."""


@dataclass(frozen=True)
class NoticeGiven(Change):
    """A message to the user that is no error."""

    text: str


@dataclass(frozen=True)
class WaitBegun(Change):
    """The user waits for something in the background; `text` says for what."""

    text: str


class WaitEnded(Change):
    """What `WaitBegun` has told of is there."""


@dataclass(frozen=True)
class MistakeMade(Change):
    """A message to the user about a command that failed, with the reason."""

    text: str

    @classmethod
    def of(cls, error: Exception) -> MistakeMade:
        """Make the message of an error; errors of the program name their type, too."""
        return cls(mistake(error) if isinstance(error, InputError | OSError) else repr(error))
