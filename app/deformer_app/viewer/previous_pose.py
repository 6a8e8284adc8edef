"""The pose before the last step, or before the drag that is under way."""

from __future__ import annotations

from numpy.typing import NDArray

from deformer_app.viewer.edit import Edit


class PreviousPose:
    """Follows the poses that are shown.

    A pose at rest is that of a step; the poses of a drag lead from one to the next. Undoing a step
    is one, too: the pose that was undone is then the previous one.
    """

    def __init__(self) -> None:
        """Start before the first pose."""
        self._before: NDArray | None = None
        self._rest: tuple[Edit, NDArray] | None = None
        self._moving = False

    @property
    def vertices(self) -> NDArray | None:
        """The previous pose (V, 3); None while there has been only one."""
        if self._moving and self._rest is not None:
            return self._rest[1]
        return self._before

    def note(self, edit: Edit, vertices: NDArray, final: bool) -> None:
        """Follow a pose.

        Args:
            edit: what it is the pose of.
            vertices: (V, 3).
            final: true if it is at rest, with nothing under way.
        """
        same = self._rest is not None and self._rest[0] == edit
        self._moving = not same and not final
        if final:
            if not same and self._rest is not None:
                self._before = self._rest[1]
            self._rest = edit, vertices
