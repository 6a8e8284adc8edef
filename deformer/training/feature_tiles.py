"""Features of the training shapes, as tiles of their deviations from the undeformed shape.

Deviations need single precision alone: what is rounded is the deformation.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureExtractor, FeatureScaler, MirrorMap, extract_each
from deformer.geometry import FloatArray
from deformer.linalg import CORES
from deformer.parallel import Executor, stream
from deformer.training.site_tiles import SiteTiles
from deformer.workspace import Rows, Workspace

# Features of a vertex without rotation and stretch.
UNDEFORMED = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
# Numbers that are extracted, or read, before they are written, or used.
_NUMBERS = 6_000_000


def deviations(q: FloatArray) -> NDArray:
    """Features (..., 9) less those of the undeformed shape, in single precision."""
    return (q - UNDEFORMED).astype(np.float32)


def features(deviation: NDArray) -> FloatArray:
    """Features (..., 9) of `deviations`."""
    return deviation + UNDEFORMED


def parts(tiles: SiteTiles, first: int, last: int, tasks: int = 1) -> list[slice]:
    """Slices that cover the shapes from `first` to before `last`, for some memory each.

    Args:
        tiles: of the shapes.
        first, last: indices of shapes.
        tasks: least number of slices, unless the shapes are fewer.
    """
    step = max(CORES, _NUMBERS // (tiles.shape[1] * tiles.shape[2]))
    step = max(1, min(step, -(-(last - first) // tasks)))
    return [slice(start, min(start + step, last)) for start in range(first, last, step)]


def new_tiles(shapes: int, extractor: FeatureExtractor, workspace: Workspace) -> SiteTiles:
    """Tiles for the features of so many shapes at all sites."""
    reference = extractor.reference
    sites = len(reference.vertices) + len(reference.links)
    return SiteTiles((shapes, sites, len(UNDEFORMED)), np.float32, workspace)


def extract_tiles(
    tiles: SiteTiles,
    start: int,
    extractor: FeatureExtractor,
    vertices: Rows,
    executor: Executor,
    mirror: MirrorMap | None = None,
    on_shape: Callable[[int], None] | None = None,
) -> None:
    """Write the features of shapes into tiles, some shapes at a time.

    Args:
        tiles: of deviations.
        start: row of the first shape's.
        extractor: against the reference.
        vertices: (N, V, 3) the shapes.
        executor: extracts them.
        mirror: maps the shapes to those whose features are meant; None is themselves.
        on_shape: called with the number of shapes done.
    """
    some = parts(tiles, 0, len(vertices), executor.wanted)
    shared = executor.share(extractor), executor.share(mirror)
    calls = ((deviations_of, *shared, vertices[part]) for part in some)
    done = 0

    def told(_: Any) -> None:
        nonlocal done
        done += 1
        if on_shape is not None:
            on_shape(done)

    for n, found in stream(executor, calls, told):
        tiles.write(start + some[n].start, found)


def deviations_of(
    extractor: FeatureExtractor, mirror: MirrorMap | None, vertices: FloatArray
) -> Generator[None, None, NDArray]:
    """A task: `deviations` (n, V+B, 9) of shapes (n, V, 3), or of their mirror images."""
    shapes = vertices if mirror is None else mirror.images(vertices)
    found = []
    for q in extract_each(extractor, shapes, links=True):
        found.append(deviations(q))
        yield None
    return np.stack(found)


def fit_scaler(tiles: SiteTiles) -> FeatureScaler:
    """Scaler for the range of all features."""
    low, high = np.full(len(UNDEFORMED), np.inf), np.full(len(UNDEFORMED), -np.inf)
    for _, tile in tiles.each():
        rows = tile.reshape(-1, len(UNDEFORMED))
        low, high = np.minimum(low, rows.min(axis=0)), np.maximum(high, rows.max(axis=0))
    return FeatureScaler.fit(features(np.stack([low, high]).astype(np.float32)))


def scaled_products(tiles: SiteTiles, scaler: FeatureScaler) -> FloatArray:
    """Inner products (N, N) of the shapes' scaled features."""
    products = np.zeros((tiles.shape[0], tiles.shape[0]))
    for _, tile in tiles.each():
        x = scaler.scale(features(tile.reshape(len(tile), -1, len(UNDEFORMED))))
        rows = x.reshape(len(x), -1)
        products += rows @ rows.T
    return products
