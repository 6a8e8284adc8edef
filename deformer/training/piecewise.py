"""Components in pieces, one a tile of the data: here, or each where an executor keeps it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.parallel import Executor, results, stream
from deformer.training.site_tiles import SiteTiles

# (numbers (N, m·D) of a tile, its piece, an order) → its new piece, and what it tells.
Change = Callable[..., tuple[Any, Any]]
# Sites of a tile → the further arguments of a change.
Order = Callable[[slice], tuple[Any, ...]]
# Takes the number of a tile and what its piece tells.
Take = Callable[[int, Any], None]


class Piecewise:
    """A piece of something for each tile, changed by functions of the tile and the piece.

    A single tile stays in this process: another one would do the same work alone.

    Args:
        data: the tiles.
        executor: keeps tiles and pieces where they are changed; None is this process.
    """

    def __init__(self, data: SiteTiles, executor: Executor | None) -> None:
        """There are no pieces yet."""
        self._data = data
        self._executor = executor if data.count > 1 else None
        self._pieces: list[Any] = []
        self._shared: list[Any] = []

    def change(self, function: Change, order: Order, take: Take) -> None:
        """Replace all pieces.

        Args:
            function: of a module; it changes none of its arguments.
            order: gives its arguments after tile and piece; the first time, the piece is None.
            take: called with what each new piece tells, in the order of the tiles. For many shapes
                that is large, and not to be kept.
        """
        data, last = self._data, self._pieces or [None] * self._data.count
        if self._executor is None:
            self._pieces = last
            for t, X in data.each():
                self._pieces[t], told = function(X, last[t], *order(data.sites(t)))
                take(t, told)
            return
        if not self._shared:
            self._shared = [self._executor.share(X.copy()) for _, X in data.each()]
        tasks = [
            self._executor.keep(_changed, function, X, piece, *order(data.sites(t)))
            for t, (X, piece) in enumerate(zip(self._shared, last, strict=True))
        ]
        changed = results(self._executor, tasks)
        self._take_in_order(changed, take)
        self._pieces = results(
            self._executor, [self._executor.keep(_of_pair, pair, 0) for pair in changed]
        )

    def _take_in_order(self, changed: list[Any], take: Take) -> None:
        """Have what is told sent, a few at a time."""
        assert self._executor is not None
        early: dict[int, Any] = {}
        following = 0
        for t, told in stream(self._executor, ((_of_pair, pair, 1) for pair in changed)):
            early[t] = told
            while following in early:
                take(following, early.pop(following))
                following += 1

    def taken(self, name: str) -> Iterator[tuple[slice, NDArray]]:
        """Sites of each tile, and the attribute `name` (count, m·D) of its piece, which is gone."""
        for t, piece in enumerate(self._pieces):
            self._pieces[t] = None
            [found] = self._told_by([piece], name)
            del piece
            yield self._data.sites(t), found
        self._pieces = []

    def gather(self, name: str, count: int) -> NDArray:
        """The attribute `name` (count, m·D) of all pieces, together (count, M·D); 0 without any."""
        _, M, D = self._data.shape
        if not self._pieces:
            return np.zeros((count, M * D), dtype=self._data.dtype)
        return np.concatenate(self._told_by(self._pieces, name), axis=1)

    def _told_by(self, pieces: list[Any], name: str) -> list[Any]:
        """The attribute `name` of each of some pieces."""
        if self._executor is None:
            return [getattr(piece, name) for piece in pieces]
        tasks = [self._executor.submit(_attribute, piece, name) for piece in pieces]
        return results(self._executor, tasks)


def _changed(
    function: Change, X: NDArray, piece: Any, *order: Any
) -> Generator[None, None, tuple[Any, Any]]:
    """A task that changes a piece.

    Arrays that come from elsewhere start at any address, and sums over them round differently.
    Copies start where numpy's own do, so that every process finds the same.
    """
    yield from ()
    return function(
        X.copy(), piece, *(np.array(o) if isinstance(o, np.ndarray) else o for o in order)
    )


def _of_pair(pair: tuple[Any, Any], which: int) -> Generator[None, None, Any]:
    """A task that gives a piece, or what it tells."""
    yield from ()
    return pair[which]


def _attribute(piece: Any, name: str) -> Generator[None, None, Any]:
    """A task that asks a piece."""
    yield from ()
    return getattr(piece, name)
