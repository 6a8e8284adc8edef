"""Changes that an editor announces to its listeners; one class for each kind."""

from __future__ import annotations

from dataclasses import dataclass

from deformer import InputError


@dataclass(frozen=True)
class Change:
    """Base class of changes."""


class ModelOpened(Change):
    """Another model, or another session of it, is open."""


class HistoryChanged(Change):
    """The history has a new entry, shows another entry, or has been saved."""


class HandlesChanged(Change):
    """Handles were added or removed, or the selection has changed."""


class HandlesDragged(Change):
    """Handles follow the mouse."""


class PoseChanged(Change):
    """The solver has computed another pose."""


class ComponentsMeasured(Change):
    """Strengths and limits of the components are known."""


class LookChanged(Change):
    """The look of the picture or the tool of the mouse has changed."""


class CameraMoved(Change):
    """The camera has moved."""


class HoverChanged(Change):
    """The vertex, handle or part under the mouse has changed."""


class FrameDrawn(Change):
    """A frame has been drawn."""


@dataclass(frozen=True)
class NoticeGiven(Change):
    """A message to the user that is no error."""

    text: str


@dataclass(frozen=True)
class MistakeMade(Change):
    """A message to the user about a command that failed, with the reason."""

    text: str

    @classmethod
    def of(cls, error: Exception) -> MistakeMade:
        """Make the message of an error; errors of the program name their type, too."""
        return cls(str(error) if isinstance(error, InputError) else repr(error))
