"""What an editor tells those who listen to it: one class for each kind of change."""

from __future__ import annotations

from dataclasses import dataclass

from deformer import InputError


@dataclass(frozen=True)
class Change:
    """Something is different; the subclass says what."""


class ModelOpened(Change):
    """Another model, or another session of it, is open."""


class HistoryChanged(Change):
    """The history has another entry, or another one is shown; or it has been saved."""


class HandlesChanged(Change):
    """Handles have come or gone, or others are selected."""


class HandlesDragged(Change):
    """Handles follow the mouse."""


class PoseChanged(Change):
    """The solver has given another pose."""


class ComponentsMeasured(Change):
    """Strengths and limits of the components are known."""


class LookChanged(Change):
    """The picture is drawn in another way, or the mouse does something else."""


class CameraMoved(Change):
    """The camera is elsewhere."""


class HoverChanged(Change):
    """Something else is under the mouse."""


class FrameDrawn(Change):
    """A frame has been drawn."""


@dataclass(frozen=True)
class NoticeGiven(Change):
    """Something worth knowing, in words for the user."""

    text: str


@dataclass(frozen=True)
class MistakeMade(Change):
    """Something that could not be done and why, in words for the user."""

    text: str

    @classmethod
    def of(cls, error: Exception) -> MistakeMade:
        """Tell of an error: a mistake of the user by its message, any other by its kind too."""
        return cls(str(error) if isinstance(error, InputError) else repr(error))
