"""Patches of faces in colours of their own, over the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from deformer_app.rendering.palette import rgb
from deformer_app.viewer.depth_offset import offset_depth


@dataclass(frozen=True)
class Patch:
    """A patch of the surface.

    Args:
        vertices: numbers of its vertices; it has the faces whose corners are all among them.
        colour: of its faces.
    """

    vertices: tuple[int, ...]
    colour: str


class Patches:
    """The patches that a plotter shows on one mesh.

    Args:
        plotter: of any kind.
    """

    def __init__(self, plotter: Any) -> None:
        """Begin with none."""
        self._plotter = plotter
        self._shown: tuple[Patch, ...] = ()
        self._mesh: pv.PolyData | None = None

    @property
    def shown(self) -> tuple[Patch, ...]:
        """What is shown."""
        return self._shown

    def clear(self) -> None:
        """Show none."""
        self._shown, self._mesh = (), None
        self._plotter.remove_actor("patches", reset_camera=False, render=False)

    def show(self, patches: Sequence[Patch], points: NDArray, faces: NDArray) -> None:
        """Show patches; where two overlap, the later one is seen.

        Args:
            patches: to show, in place of those before.
            points: (V, 3) of the surface in single precision, as VTK has them.
            faces: (F, 3) of the surface.
        """
        wanted = tuple(patches)
        self.clear()
        self._shown = wanted
        owner = np.full(len(faces), -1)
        for n, patch in enumerate(wanted):
            inside = np.zeros(len(points), dtype=bool)
            inside[list(patch.vertices)] = True
            owner[inside[faces].all(axis=1)] = n
        covered = owner >= 0
        if not covered.any():
            return
        self._mesh = pv.PolyData(points, np.insert(faces[covered], 0, 3, axis=1).ravel())
        colours = np.array([rgb(patch.colour) for patch in wanted], dtype=np.uint8)
        self._mesh.cell_data["colour"] = colours[owner[covered]]
        actor = self._plotter.add_mesh(
            self._mesh,
            name="patches",
            scalars="colour",
            rgb=True,
            opacity=0.6,
            lighting=False,
            pickable=False,
            copy_mesh=False,
            show_scalar_bar=False,
            render=False,
            reset_camera=False,
        )
        offset_depth(actor.mapper, -2.0, -2.0)  # it has the depth of the surface's

    def move(self, points: NDArray) -> None:
        """Follow the surface to points (V, 3)."""
        if self._mesh is not None:
            self._mesh.points = points
