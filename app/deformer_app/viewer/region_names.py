"""Names of the places that regions of components have on a shape."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import upright_axes

# A region beyond this share of the shape's size from the middle of its bounding box is on a side.
_OFF = 1 / 6
_SIDES = (("left", "right"), ("top", "bottom"), ("front", "back"))  # in order of `upright_axes`
_ORDER = (1, 2, 0)  # "top front left"
_FLAT = 0.4  # a shape thinner than this share of its size has no front and back parts


def region_names(centres: ArrayLike, vertices: NDArray[np.float64], up: str) -> list[str]:
    """Name regions by their place on a shape: "Top", "Bottom left", "Middle"; no name twice.

    Args:
        centres: (n, 3) of the regions.
        vertices: (V, 3) of the shape.
        up: the shape's up axis. Left is the shape's own, as of somebody who faces the viewer.
    """
    axes = upright_axes(up)
    points = vertices @ axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-9 * float((high - low).max()) + 1e-300)
    told = [n for n in _ORDER if n != 2 or size[n] > _FLAT * size.max()]
    found = []
    for place in (np.asarray(centres) @ axes.T - (low + high) / 2) / size:
        words = [_SIDES[n][int(place[n] < 0)] for n in told if abs(place[n]) > _OFF]
        found.append(" ".join(words).capitalize() or "Middle")
    seen: Counter[str] = Counter()
    names = []
    for name in found:
        seen[name] += 1
        names.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return names
