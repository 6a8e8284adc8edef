"""Numbers of many shapes at many sites, in tiles: all shapes at a few sites each.

A factorisation goes through the data several times a round, and needs all shapes at a site
together. How the sites are divided depends on the numbers of shapes and sites alone, and every sum
is made tile by tile: results do not depend on whether the tiles are in memory or in a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from deformer.geometry import IntArray
from deformer.workspace import Rows, StoredArray, Workspace

# Size of a tile in numbers, and its least number of sites.
_TILE, _LEAST_SITES = 4_000_000, 16


def sites_of_a_tile(shapes: int, sites: int, dimensions: int) -> int:
    """Number of sites of a tile: all, or as many as a few megabytes hold."""
    width = max(_LEAST_SITES, _TILE // max(shapes * dimensions, 1))
    return math.ceil(sites / math.ceil(sites / width))


class SiteTiles:
    """Numbers (N, M, D) of N shapes at M sites, in tiles of all shapes.

    Args:
        shape: (N, M, D).
        dtype: of the numbers.
        workspace: where the tiles are.
        width: sites of a tile; None is `sites_of_a_tile`.
        tiles: (T, N, width · D) the tiles, the last one filled up; None makes new ones.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        dtype: DTypeLike,
        workspace: Workspace,
        *,
        width: int | None = None,
        tiles: Rows | None = None,
    ) -> None:
        """Make room; the numbers are any."""
        self.shape, self._workspace = shape, workspace
        N, M, D = shape
        self.width = sites_of_a_tile(*shape) if width is None else width
        self.count = math.ceil(M / self.width)
        if tiles is None:
            tiles = workspace.empty((self.count, N, self.width * D), dtype)
        self.tiles = tiles
        self.dtype: np.dtype[Any] = tiles.dtype

    @classmethod
    def of(cls, values: NDArray) -> SiteTiles:
        """Tiles, in memory, of an array (N, M, D)."""
        N, M, D = values.shape
        width = sites_of_a_tile(N, M, D)
        if width >= M:
            tiles = values.reshape(1, N, M * D)
        else:
            tiles = np.zeros((math.ceil(M / width), N, width * D), values.dtype)
            flat = values.reshape(N, -1)
            for t in range(len(tiles)):
                part = flat[:, t * width * D : (t + 1) * width * D]
                tiles[t, :, : part.shape[1]] = part
        return cls((N, M, D), values.dtype, Workspace(), width=width, tiles=tiles)

    def sites(self, tile: int) -> slice:
        """The sites of a tile."""
        return slice(tile * self.width, min((tile + 1) * self.width, self.shape[1]))

    def columns(self, tile: int) -> slice:
        """The columns of a tile in arrays (·, M·D)."""
        sites, D = self.sites(tile), self.shape[2]
        return slice(sites.start * D, sites.stop * D)

    def each(self) -> Iterator[tuple[int, NDArray]]:
        """Go through the tiles: number, and numbers (N, m·D) that are valid until the next one.

        The next tile of a file is read while the last one is used.
        """
        if not isinstance(self.tiles, StoredArray):
            for t in range(self.count):
                yield t, self._used(t, self.tiles[t])
            return
        stored = self.tiles
        buffers = [np.empty((1, *stored.shape[1:]), self.dtype) for _ in range(2)]
        with ThreadPoolExecutor(1, "deformer-reader") as reader:
            pending = reader.submit(stored.read_into, 0, buffers[0])
            for t in range(self.count):
                pending.result()
                if t + 1 < self.count:
                    pending = reader.submit(stored.read_into, t + 1, buffers[(t + 1) % 2])
                yield t, self._used(t, buffers[t % 2][0])

    def _used(self, tile: int, numbers: NDArray) -> NDArray:
        """What a tile holds without the columns that fill it up."""
        columns = self.columns(tile)
        return numbers[:, : columns.stop - columns.start]

    def site(self, site: int) -> NDArray:
        """Numbers (N, D) at a site."""
        tile, D = site // self.width, self.shape[2]
        first = (site - tile * self.width) * D
        return self.tiles[tile][:, first : first + D].copy()

    def read(self, shapes: slice) -> NDArray:
        """Numbers (n, M, D) of shapes that follow each other."""
        start, stop, _ = shapes.indices(self.shape[0])
        out = np.empty((stop - start, self.shape[1] * self.shape[2]), self.dtype)
        for t in range(self.count):
            out[:, self.columns(t)] = self._used(t, self.tiles[t, start:stop])
        return out.reshape(stop - start, *self.shape[1:])

    def write(self, start: int, values: NDArray) -> None:
        """Write numbers (n, M, D) of the shapes from `start` on."""
        flat = values.reshape(len(values), -1)
        for t in range(self.count):
            columns = self.columns(t)
            part = np.zeros((len(flat), self.width * self.shape[2]), self.dtype)
            part[:, : columns.stop - columns.start] = flat[:, columns]
            self.tiles[t, start : start + len(flat)] = part

    def map(self, change: Callable[[NDArray], NDArray], dtype: DTypeLike) -> SiteTiles:
        """Tiles of changed numbers.

        Args:
            change: gives numbers (N, m, D) for those of a tile, which it leaves as they are.
            dtype: of the result.
        """
        N, _, D = self.shape
        found = SiteTiles(self.shape, dtype, self._workspace, width=self.width)
        for t, tile in self.each():
            found._fill(t, change(tile.reshape(N, -1, D)).reshape(N, -1))
        return found

    def divide(self, unit: float) -> None:
        """Divide all numbers by one."""
        for t in range(self.count):
            self.tiles[t : t + 1] = self.tiles[t : t + 1] / self.dtype.type(unit)

    def subset(self, shapes: IntArray) -> SiteTiles:
        """Tiles of the shapes at indices (n,)."""
        shape = len(shapes), *self.shape[1:]
        found = SiteTiles(shape, self.dtype, self._workspace, width=self.width)
        for t, tile in self.each():
            found._fill(t, tile[shapes])
        return found

    def _fill(self, tile: int, numbers: NDArray) -> None:
        """Write a whole tile, filled up with zeros."""
        full = np.zeros((1, self.shape[0], self.width * self.shape[2]), self.dtype)
        full[0, :, : numbers.shape[1]] = numbers
        self.tiles[tile : tile + 1] = full
