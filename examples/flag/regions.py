"""Regions of the flag that its components are named after: thirds of its width and height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_COLUMNS = ("Pole side", "Middle", "Free side")
_ROWS = ("bottom", "middle", "top")


def flag_regions(rest: NDArray) -> dict[str, NDArray]:
    """Name of a region → (V,) 1 within it and 0 beyond, from the flat flag (V, 3)."""
    low, size = rest.min(axis=0), np.ptp(rest, axis=0)
    column, row = (np.minimum((3 * (rest[:, n] - low[n]) / size[n]).astype(int), 2) for n in (0, 2))
    regions = {"Whole flag": np.ones(len(rest))}
    for c, across in enumerate(_COLUMNS):
        regions[across] = (column == c).astype(float)
        for r, up in enumerate(_ROWS):
            name = "Centre" if (across, up) == ("Middle", "middle") else f"{across} {up}"
            regions[name] = ((column == c) & (row == r)).astype(float)
    for r, up in ((0, "Bottom"), (2, "Top")):
        regions[up] = (row == r).astype(float)
    return regions
