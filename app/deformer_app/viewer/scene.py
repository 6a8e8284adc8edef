"""The picture: surface, ghost, handles, manipulator and colours as actors on any pyvista plotter.

It draws what it is told and says what lies under a pixel; it decides nothing. Pixels count from the
top left corner and are those that a person aims at: of a dense screen, each is several of VTK's.
Everything here runs on the thread of the window.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkRenderingCore import (
    vtkCellPicker,
    vtkRenderer,
    vtkTextActor,
    vtkWindowToImageFilter,
)

from deformer import Mesh
from deformer_app.rendering.camera import Camera
from deformer_app.rendering.offscreen import LIGHTS, Picture
from deformer_app.rendering.palette import (
    AXES,
    DIVERGING,
    HEAT,
    HOVERED,
    LIGHT,
    REGION,
    SELECTED,
    TARGET,
    Theme,
    rgb,
)
from deformer_app.viewer.colouring import Paint
from deformer_app.viewer.controller import Pixel
from deformer_app.viewer.gizmo import Gizmo
from deformer_app.viewer.overlays import Dots, Strokes

_SUPERSAMPLING = 2.0  # pixels of VTK's pass along each side of one of the picture
_APART = 4.0  # pixels from handle to target from which a line joins them


@dataclass(frozen=True, eq=False)
class Marks:
    """Handles to draw.

    Args:
        positions: (n, 3) where the handles' vertices are.
        targets: (n, 3) where they should be.
        colours: n names of colours.
        sizes: n diameters in pixels.
    """

    positions: NDArray[np.float64]
    targets: NDArray[np.float64]
    colours: Sequence[str]
    sizes: Sequence[int]


class MeshView:
    """Actors of one mesh on a plotter.

    Args:
        plotter: of any kind; its lights and its interactor's style are replaced.
        theme: colours.
        density: tells how many of VTK's pixels lie along each side of one that a person aims at;
            asked again with every use, as a window may be moved to another screen.
    """

    def __init__(
        self, plotter: Any, theme: Theme = LIGHT, density: Callable[[], float] = lambda: 1.0
    ) -> None:
        """Set up lights, layers and picking; there is no mesh yet."""
        self.plotter = plotter
        self.theme = theme
        self.frame_milliseconds = 0.0
        self._surface: pv.PolyData | None = None
        self._faces = np.empty((0, 3), dtype=np.int64)
        self._vertices = np.empty((0, 3))
        self._actors: dict[str, Any] = {}
        self._paint: Paint | None = None
        self._smooth = True
        self._edges = False
        self._sharp = False
        self._screen, self._density = density, 1.0
        self._picker = vtkCellPicker()
        self._picker.SetTolerance(0.0)
        self._picker.PickFromListOn()
        self.camera: Camera | None = None
        plotter.remove_all_lights()
        for position, color, strength in LIGHTS:
            light = pv.Light(color=color, intensity=strength, light_type="camera light")
            light.position = position
            plotter.add_light(light)
        self._overlay = self._add_overlay()
        self._balls: dict[int, Dots] = {}
        self._hover = Dots(plotter.renderer, 12)
        self._residuals, self._targets = Strokes(self._overlay, 2.5), Dots(self._overlay, 9)
        self._gizmo, self._gizmo_lit = Strokes(self._overlay, 3.5), Strokes(self._overlay, 5.5)
        self._tips, self._box = Dots(self._overlay, 11), Strokes(self._overlay, 1.5)
        self._above = (self._residuals, self._targets, self._gizmo, self._gizmo_lit, self._tips,
                       self._box)  # fmt: skip
        self._texts = self._add_texts()
        self.set_theme(theme)

    def _add_overlay(self) -> vtkRenderer:
        """A layer that nothing hides: manipulator, targets, outlines."""
        overlay = vtkRenderer()
        overlay.SetLayer(1)
        overlay.InteractiveOff()
        overlay.SetActiveCamera(self.plotter.renderer.GetActiveCamera())
        window = self.plotter.render_window
        window.SetMultiSamples(0)
        window.SetNumberOfLayers(2)
        window.AddRenderer(overlay)
        return overlay

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        width, height = self.plotter.render_window.GetSize()
        return max(round(width / self.density), 1), max(round(height / self.density), 1)

    @property
    def density(self) -> float:
        """VTK's pixels along each side of one of the picture."""
        return self._screen()

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        self.theme = theme
        self.plotter.set_background(theme.background, top=theme.horizon)
        for text in self._texts.values():
            text.GetTextProperty().SetColor(*(c / 255 for c in rgb(theme.ink)))
            text.GetTextProperty().SetBackgroundColor(*(c / 255 for c in rgb(theme.background)))
        if "mesh" in self._actors:
            self._dress()
        if "ghost" in self._actors:
            self._actors["ghost"].prop.color = theme.ghost

    # The surface.

    def set_mesh(self, vertices: NDArray[np.float64], faces: NDArray, normals: NDArray) -> None:
        """Show another mesh; `normals` (V, 3) are of its vertices."""
        self._faces, self._vertices = faces, vertices
        cells = np.insert(faces, 0, 3, axis=1).ravel()
        self._surface = pv.PolyData(np.array(vertices, dtype=np.float32), cells)
        self._surface.point_data["Normals"] = normals.astype(np.float32)
        self._surface.point_data.active_normals_name = "Normals"
        self._paint = None
        for name in list(self._actors):
            self._remove(name)
        self._dress()

    def move_mesh(self, vertices: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
        """Move the vertices of the mesh that is shown."""
        assert self._surface is not None
        self._vertices = vertices
        points = self._surface.GetPoints().GetData()
        np.asarray(self._surface.points)[:] = vertices
        points.Modified()
        np.asarray(self._surface.point_data["Normals"])[:] = normals
        self._surface.GetPointData().GetNormals().Modified()
        self._surface.Modified()
        if "patch" in self._actors:
            self._actors["patch"].mapper.dataset.points = self._surface.points

    def paint(self, paint: Paint | None) -> None:
        """Colour the surface by values, or not."""
        before, self._paint = self._paint, paint
        if (
            before is not None
            and paint is not None
            and (before.title, before.limits) == (paint.title, paint.limits)
        ):
            self._values(paint)
        elif before is not paint:
            self._dress()

    def show_as(self, smooth: bool, edges: bool) -> None:
        """Shade smoothly or by face; draw the faces' edges or not."""
        self._smooth, self._edges = smooth, edges
        self._dress()

    def _values(self, paint: Paint) -> None:
        assert self._surface is not None
        data = self._surface.point_data if paint.on == "vertices" else self._surface.cell_data
        data["value"] = paint.values.astype(np.float32)

    def _dress(self) -> None:
        """Make the surface's actor anew."""
        surface = self._surface
        if surface is None:
            return
        self._remove("mesh")
        for data in (surface.point_data, surface.cell_data):
            if "value" in data:
                del data["value"]
        look: dict[str, Any] = {
            "ambient": 0.16,
            "diffuse": 1.0,
            "specular": 0.1,
            "specular_power": 12,
            "show_edges": self._edges,
            "edge_color": self.theme.edge,
            "render": False,
            "reset_camera": False,
            "name": "mesh",
            "copy_mesh": False,
        }
        paint = self._paint
        if paint is not None:
            # Shade must not be mistaken for a dark colour.
            look["ambient"], look["diffuse"], look["specular"] = 0.32, 0.72, 0.0
        if paint is None:
            actor = self.plotter.add_mesh(surface, color=self.theme.clay, **look)
        else:
            self._values(paint)
            actor = self.plotter.add_mesh(
                surface,
                scalars="value",
                preference="point" if paint.on == "vertices" else "cell",
                clim=paint.limits,
                cmap=DIVERGING if paint.diverging else HEAT,
                show_scalar_bar=False,
                **look,
            )
        if self._smooth:
            actor.prop.interpolation = "Phong"
        else:
            actor.prop.interpolation = "Flat"
        self._actors["mesh"] = actor
        self._picker.InitializePickList()
        self._picker.AddPickList(actor)
        self._caption()

    def _caption(self) -> None:
        """A colour bar for what the surface is coloured by."""
        for title in list(self.plotter.scalar_bars.keys()):
            self.plotter.remove_scalar_bar(title, render=False)
        if self._paint is None:
            return
        bar = self.plotter.add_scalar_bar(
            self._paint.title,
            mapper=self._actors["mesh"].mapper,
            vertical=True,
            width=0.04,
            height=0.36,
            position_x=0.84,
            position_y=0.3,
            n_labels=3,
            fmt="%.2g",
            title_font_size=14,
            label_font_size=13,
            color=self.theme.ink,
            render=False,
        )
        bar.SetVerticalTitleSeparation(10)

    def show_ghost(self, mesh: Mesh | None) -> None:
        """Show another mesh translucently, or none."""
        self._remove("ghost")
        if mesh is None:
            return
        cells = np.insert(mesh.faces, 0, 3, axis=1).ravel()
        ghost = pv.PolyData(np.array(mesh.vertices, dtype=np.float32), cells)
        actor = self.plotter.add_mesh(
            ghost,
            color=self.theme.ghost,
            opacity=0.28,
            smooth_shading=True,
            pickable=False,
            render=False,
            reset_camera=False,
            name="ghost",
        )
        self._actors["ghost"] = actor

    def show_patch(self, vertices: Sequence[int]) -> None:
        """Colour the faces within a set of vertices."""
        self._remove("patch")
        if not len(vertices) or self._surface is None:
            return
        inside = np.zeros(len(self._vertices), dtype=bool)
        inside[list(vertices)] = True
        faces = self._faces[inside[self._faces].all(axis=1)]
        if not len(faces):
            return
        patch = pv.PolyData(self._surface.points, np.insert(faces, 0, 3, axis=1).ravel())
        actor = self.plotter.add_mesh(
            patch,
            color=REGION,
            opacity=0.75,
            lighting=False,
            pickable=False,
            render=False,
            reset_camera=False,
            name="patch",
            copy_mesh=False,
        )
        mapper = actor.mapper
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(-2, -2)
        self._actors["patch"] = actor

    # What lies upon it.

    def show_handles(self, marks: Marks) -> None:
        """Draw handles as balls, and lines to targets that are visibly elsewhere."""
        for size in set(self._balls) | set(marks.sizes):
            rows = [n for n, s in enumerate(marks.sizes) if s == size]
            if size not in self._balls:
                self._balls[size] = Dots(self.plotter.renderer, size)
                self._balls[size].magnify(self._density * self._magnification)
            self._balls[size].show(marks.positions[rows], [marks.colours[n] for n in rows])
        self._targets.clear()
        self._residuals.clear()
        if not len(marks.positions) or self.camera is None:
            return
        pixels = self.camera.project(np.vstack([marks.positions, marks.targets]), self.size)
        here, there = pixels.reshape(2, -1, 2)
        apart = np.sqrt(((here - there) ** 2).sum(axis=1)) > _APART
        lines = np.stack([marks.positions[apart], marks.targets[apart]], axis=1)
        self._targets.show(marks.targets[apart], [TARGET] * len(lines))
        self._residuals.show(list(lines), [TARGET] * len(lines))

    def show_hover(self, points: ArrayLike) -> None:
        """Light up points (n, 3)."""
        spots = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        self._hover.show(spots, [HOVERED] * len(spots))

    def show_gizmo(self, gizmo: Gizmo | None, lit: str | None) -> None:
        """Draw the manipulator; one part of it lit up."""
        drawn: dict[bool, list[tuple[NDArray, str]]] = {False: [], True: []}
        if gizmo is not None and self.camera is not None:
            for part in gizmo.parts:
                outline = gizmo.outline(part, self.camera, self.size)
                colour = SELECTED if part == lit else self._colour_of(part)
                drawn[part == lit].append((outline, colour))
        for is_lit, strokes in ((False, self._gizmo), (True, self._gizmo_lit)):
            strokes.show([line for line, _ in drawn[is_lit]], [c for _, c in drawn[is_lit]])
        tips = [item for items in drawn.values() for item in items if len(item[0]) == 2]
        self._tips.show(np.array([line[-1] for line, _ in tips]), [c for _, c in tips])

    def _colour_of(self, part: str) -> str:
        if part == "s":
            return self.theme.ink
        across = set("xyz") - set(part) if len(part) == 2 and part[0] != "r" else {part[-1]}
        return AXES[across.pop()]

    def show_box(self, low: Pixel | None, high: Pixel | None) -> None:
        """Draw a rectangle of the picture, or none."""
        if low is None or high is None or self.camera is None:
            self._box.clear()
            return
        depth = float(self.camera.depths([self.camera.focal])[0])
        corners = [low, (high[0], low[1]), high, (low[0], high[1]), low]
        places = np.array([self.camera.unproject(p, depth, self.size) for p in corners])
        self._box.show([places], [self.theme.ink])

    def _remove(self, name: str) -> None:
        if self._actors.pop(name, None) is not None:
            self.plotter.remove_actor(name, reset_camera=False, render=False)

    # Looking.

    def look(self, camera: Camera) -> None:
        """Look through a camera."""
        self.camera = camera
        lens = self.plotter.renderer.GetActiveCamera()
        lens.SetPosition(*camera.position)
        lens.SetFocalPoint(*camera.focal)
        lens.SetViewUp(*camera.up)
        lens.SetViewAngle(camera.view_angle)
        # So wide that no actor is cut off, whatever moves between two frames.
        reach = np.sqrt(((self._vertices - camera.position) ** 2).sum(axis=1))
        far = 2.0 * float(reach.max(initial=1e-3)) + float(camera.depths([camera.focal])[0])
        lens.SetClippingRange(1e-3 * far, far)
        self._overlay.SetActiveCamera(lens)

    def vertex_at(self, pixel: Pixel) -> int | None:
        """The corner nearest to a pixel of the face that is seen there."""
        if self._surface is None or self.camera is None:
            return None
        self._pick(pixel)
        face = self._picker.GetCellId()
        if face < 0:
            return None
        corners = self._faces[face]
        apart = self.camera.project(self._vertices[corners], self.size) - pixel
        return int(corners[(apart**2).sum(axis=1).argmin()])

    def sees(self, point: ArrayLike) -> bool:
        """Whether the surface leaves a point (3,) in sight."""
        if self._surface is None or self.camera is None:
            return False
        self._pick(self.camera.project(np.array([point]), self.size)[0])
        if self._picker.GetCellId() < 0:
            return True
        there, here = self.camera.depths(np.array([self._picker.GetPickPosition(), point]))
        return bool(here < there + 8 * self.camera.pixel_size(point, self.size))

    def _pick(self, pixel: Any) -> None:
        x, y = np.asarray(pixel) * self.density
        _, height = self.plotter.render_window.GetSize()
        self._picker.Pick(x, height - y, 0.0, self.plotter.renderer)

    @property
    def _magnification(self) -> float:
        return _SUPERSAMPLING if self._sharp else 1.0

    def render(self) -> None:
        """Draw a frame."""
        begun = time.perf_counter()
        if self._density != self.density:
            self._density = self.density
            self._size_marks()
        self.plotter.render()
        self.frame_milliseconds = 1000.0 * (time.perf_counter() - begun)

    def sharpen(self, sharp: bool) -> bool:
        """Switch anti-aliasing, which costs more than all else; false if nothing changes."""
        if sharp == self._sharp:
            return False
        self._sharp = sharp
        if sharp:
            self.plotter.enable_anti_aliasing("ssaa")
        else:
            self.plotter.disable_anti_aliasing()
        self._size_marks()
        self._overlay.SetUseFXAA(sharp)
        return True

    def _size_marks(self) -> None:
        for dots in (*self._balls.values(), self._hover):
            dots.magnify(self._density * self._magnification)
        for mark in self._above:
            mark.magnify(self._density)

    @property
    def is_sharp(self) -> bool:
        """Whether anti-aliasing is on."""
        return self._sharp

    def grab(self) -> Picture:
        """The frame that was drawn last, (height, width, 3)."""
        reader = vtkWindowToImageFilter()
        reader.SetInput(self.plotter.render_window)
        reader.SetInputBufferTypeToRGB()
        reader.ReadFrontBufferOff()
        reader.ShouldRerenderOff()
        reader.Update()
        image = reader.GetOutput()
        width, height, _ = image.GetDimensions()
        pixels = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3)
        return np.ascontiguousarray(pixels[::-1])

    def picture(self) -> Picture:
        """A sharp frame, (height, width, 3)."""
        self.sharpen(True)
        self.render()
        return self.grab()

    def write(self, place: str, text: str) -> None:
        """Write lines into the "bottom" left corner, the "top" right one, or the "middle"."""
        self._texts[place].SetInput(text)
        self._texts[place].SetVisibility(bool(text))

    def _add_texts(self) -> dict[str, vtkTextActor]:
        texts = {}
        for place, x, y in (("bottom", 0.015, 0.02), ("top", 0.985, 0.98), ("middle", 0.5, 0.5)):
            text = vtkTextActor()
            text.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
            text.SetPosition(x, y)
            style = text.GetTextProperty()
            style.SetFontSize(14)
            if place == "top":
                style.SetJustificationToRight()
                style.SetVerticalJustificationToTop()
            elif place == "middle":
                style.SetFontFamilyToCourier()
                style.SetJustificationToCentered()
                style.SetVerticalJustificationToCentered()
                style.SetBackgroundOpacity(0.9)
            text.VisibilityOff()
            self._overlay.AddViewProp(text)
            texts[place] = text
        return texts
