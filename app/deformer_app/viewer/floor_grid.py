"""A grid on a plane whose lines fade away from its middle, as a VTK actor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.palette import rgb

# Lines on each side of the middle, their distance in sizes of the body, and parts of each line, by
# whose ends it fades.
_LINES, _SPACING, _PARTS = 12, 0.1, 48
_OPACITY = 0.55  # of the lines at the middle


class FloorGrid:
    """A grid that a surface hides and that nobody can pick.

    Args:
        plotter: of any kind.
    """

    def __init__(self, plotter: Any) -> None:
        """Draw nothing yet."""
        self._plotter, self._shown = plotter, None
        self._actor: Any = None

    @property
    def visible(self) -> bool:
        """True while the grid is drawn."""
        return self._actor is not None and bool(self._actor.GetVisibility())

    def hide(self) -> None:
        """Draw nothing."""
        if self._actor is not None:
            self._actor.SetVisibility(False)

    def show(self, origin: ArrayLike, normal: ArrayLike, size: float, colour: str) -> None:
        """Draw the grid.

        Args:
            origin: (3,) its middle.
            normal: (3,) of the plane, of length 1.
            size: of the body, by which the distance of lines is measured.
            colour: of the lines.
        """
        wanted = *np.ravel(origin).tolist(), *np.ravel(normal).tolist(), size, colour
        if wanted != self._shown:
            self._shown = wanted
            points, cells, reach = _lines(np.asarray(origin), np.asarray(normal), size * _SPACING)
            mesh = pv.PolyData(points, lines=cells)
            fade = np.clip(1.0 - reach / (_LINES * size * _SPACING), 0.0, 1.0)
            shade = np.empty((len(points), 4), dtype=np.uint8)
            shade[:, :3] = rgb(colour)
            shade[:, 3] = 255 * _OPACITY * fade**1.5
            self._actor = self._plotter.add_mesh(
                mesh, scalars=shade, rgb=True, name="floor", lighting=False, line_width=1.5,
                pickable=False, render=False, reset_camera=False, show_scalar_bar=False,
            )  # fmt: skip
        self._actor.SetVisibility(True)


def _lines(
    origin: NDArray[np.float64], normal: NDArray[np.float64], spacing: float
) -> tuple[NDArray, NDArray, NDArray]:
    """Points (n, 3) of the lines, their parts as cells, and distances (n,) from `origin`."""
    first = np.eye(3)[int(np.abs(normal).argmin())]
    x = np.cross(normal, first)
    y = np.cross(normal, x)
    steps = spacing * np.arange(-_LINES, _LINES + 1)
    along = spacing * np.linspace(-_LINES, _LINES, _PARTS + 1)
    a, b = np.meshgrid(steps, along, indexing="ij")
    flat = np.concatenate(
        [a[..., None] * x + b[..., None] * y, b[..., None] * x + a[..., None] * y]
    )
    numbers = np.arange(flat[..., 0].size).reshape(flat.shape[:2])
    pairs = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)
    cells = np.insert(pairs, 0, 2, axis=1).ravel()
    points = flat.reshape(-1, 3)
    return origin + points, cells, np.sqrt((points**2).sum(axis=1))
