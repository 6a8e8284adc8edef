"""Off-screen pictures: renderings of meshes with handles, and contact sheets.

Nothing here needs a display or a window system. On Linux VTK draws through EGL (Mesa's software
renderer is enough: Debian's `libegl1` and `libgl1-mesa-dri`). Colours are 8-bit RGB, images are
(height, width, 3) uint8 arrays with the first row on top.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

import deformer
from deformer import Mesh
from deformer_app.rendering.camera import Camera
from deformer_app.rendering.palette import BACKGROUND, CLAY, HANDLE, INK, PINNED, SCALARS, TARGET

Picture = NDArray[np.uint8]

FEATURE_ANGLE = 60.0  # degrees between faces from which an edge is drawn sharp
_SURFACELESS = 0x31DD  # EGL_PLATFORM_SURFACELESS_MESA

# Camera lights (position in units of the view, x right, y up, z towards the eye): colour, strength.
LIGHTS = (
    ((-0.7, 0.9, 1.1), "#fff6ea", 0.82),  # key, warm, from the upper left
    ((1.4, 0.1, 0.9), "#e1ebff", 0.42),  # fill, cool, from the right
    ((0.5, 1.2, -1.2), "#ffffff", 0.50),  # rim, from behind
)


@dataclass(frozen=True, eq=False)
class Layer:
    """One mesh of a picture and how to draw it.

    Args:
        mesh: the mesh.
        color: colour of the mesh, unless `scalars` are given.
        opacity: from 0, invisible, to 1, solid.
        scalars: (V,) values that colour the vertices.
        title: caption of the colour bar.
        limits: values at the ends of the colour bar; None is the range of `scalars`.
        bar: true to draw the colour bar.
        colormap: matplotlib's name of the colour map.
    """

    mesh: Mesh
    color: str = CLAY
    opacity: float = 1.0
    scalars: ArrayLike | None = None
    title: str = ""
    limits: tuple[float, float] | None = None
    bar: bool = True
    colormap: str = SCALARS


@dataclass(frozen=True, eq=False)
class HandleGlyphs:
    """Handles of a picture: a ball on the surface, and a line to a second ball at the target.

    Args:
        positions: (H, 3) positions of the handle vertices.
        targets: (H, 3) targets; drawn where they are visibly apart from the positions.
        pinned: (H,) true for pinned handles, which have a colour of their own.
        radius: radius of a ball, in the data's units; None is 1.3 % of the bounding diagonal.
    """

    positions: ArrayLike
    targets: ArrayLike | None = None
    pinned: Sequence[bool] | None = None
    radius: float | None = None


def render(
    layers: Mesh | Layer | Sequence[Mesh | Layer],
    camera: Camera,
    size: tuple[int, int] = (800, 800),
    handles: HandleGlyphs | None = None,
    background: str = BACKGROUND,
) -> Picture:
    """Draw meshes and handles.

    Args:
        layers: one mesh or several in the same coordinates.
        camera: see `camera.aim`; the frames of an animation share one camera.
        size: width and height in pixels.
        handles: handles to draw.
        background: colour of the background.

    Returns:
        The picture (height, width, 3) uint8.

    Raises:
        InputError: the machine cannot render off-screen.
    """
    drawn = [item if isinstance(item, Layer) else Layer(item) for item in _listed(layers)]
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    try:
        plotter.set_background(background)  # pyright: ignore[reportArgumentType]
        for position, color, strength in LIGHTS:
            light = pv.Light(color=color, intensity=strength, light_type="camera light")
            light.position = position
            plotter.add_light(light)
        for layer in drawn:
            _add_layer(plotter, layer)
        if handles is not None:
            _add_handles(plotter, handles, max(item.mesh.bounding_diagonal for item in drawn))
        plotter.camera.position = camera.position
        plotter.camera.focal_point = camera.focal
        plotter.camera.up = camera.up
        plotter.camera.view_angle = camera.view_angle
        plotter.enable_anti_aliasing("ssaa")
        plotter.renderer.ResetCameraClippingRange()
        image = plotter.screenshot(return_img=True)
    finally:
        plotter.close()
    picture = np.ascontiguousarray(np.asarray(image)[..., :3], dtype=np.uint8)
    for layer in drawn:
        if layer.scalars is not None and layer.bar:
            picture = draw_bar(picture, layer)
    return picture


def contact_sheet(
    images: Sequence[Picture],
    columns: int,
    titles: Sequence[str] | None = None,
    gap: int = 12,
    background: str = BACKGROUND,
) -> Picture:
    """Arrange pictures in rows of `columns`, each above its title.

    A title that is wider than the pictures makes room for itself.

    Args:
        images: pictures in reading order; those of a row have one height, those of a column one
            width.
        columns: pictures a row.
        titles: a line for each picture, or None.
        gap: pixels between and around the pictures.
        background: colour between the pictures.

    Raises:
        InputError: no pictures, pictures that make no rows and columns, or another number of
            titles.
    """
    if not images:
        raise deformer.InputError("contact sheet: got no pictures, expected at least one")
    if titles is not None and len(titles) != len(images):
        raise deformer.InputError(
            f"contact sheet: got {len(titles)} titles for {len(images)} pictures"
        )
    columns = min(max(columns, 1), len(images))
    rows = math.ceil(len(images) / columns)
    heights = [images[row * columns].shape[0] for row in range(rows)]
    widths = [images[column].shape[1] for column in range(columns)]
    for index, image in enumerate(images):
        expected = heights[index // columns], widths[index % columns]
        if image.shape[:2] != expected:
            raise deformer.InputError(
                f"contact sheet: picture {index} has {image.shape[:2]} pixels, expected "
                f"{expected}, as in its row and column"
            )
    line = max(14, max(heights) // 22)
    strip = 2 * line if titles is not None else 0
    font = ImageFont.load_default(line)
    for index, title in enumerate(titles or ()):
        column = index % columns
        widths[column] = max(widths[column], math.ceil(font.getlength(title)))
    size = (sum(widths) + (columns + 1) * gap, sum(heights) + rows * (strip + gap) + gap)
    sheet = Image.new("RGB", size, background)
    pen = ImageDraw.Draw(sheet)
    for index, image in enumerate(images):
        row, column = divmod(index, columns)
        left = gap + sum(widths[:column]) + column * gap
        top = gap + sum(heights[:row]) + row * (strip + gap)
        sheet.paste(Image.fromarray(image), (left + (widths[column] - image.shape[1]) // 2, top))
        if titles is not None:
            middle = (left + widths[column] / 2, top + heights[row] + strip / 2)
            pen.text(middle, titles[index], fill=INK, font=font, anchor="mm")
    return np.asarray(sheet)


def save_picture(path: str | os.PathLike[str], image: Picture) -> None:
    """Write a picture; the suffix of `path` chooses the format."""
    Image.fromarray(image).save(Path(path))


def _listed(layers: Mesh | Layer | Sequence[Mesh | Layer]) -> Sequence[Mesh | Layer]:
    return [layers] if isinstance(layers, (Mesh, Layer)) else layers


def _add_layer(plotter: pv.Plotter, layer: Layer) -> None:
    faces = np.insert(layer.mesh.faces, 0, 3, axis=1)
    surface = pv.PolyData(np.array(layer.mesh.vertices, dtype=np.float32), faces.ravel())
    coloured = layer.scalars is not None
    if coloured:
        surface.point_data["value"] = np.asarray(layer.scalars, dtype=np.float64)
    shaded = surface.compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=FEATURE_ANGLE,
        consistent_normals=False,
        auto_orient_normals=False,
    )
    surface = cast(pv.PolyData, shaded)
    look = {
        "smooth_shading": True,
        "opacity": layer.opacity,
        "ambient": 0.16,
        "diffuse": 1.0,
        "specular": 0.1,
        "specular_power": 12,
    }
    if not coloured:
        plotter.add_mesh(surface, color=layer.color, **look)
        return
    plotter.add_mesh(
        surface,
        scalars="value",
        clim=_limits(layer),
        cmap=layer.colormap,
        show_scalar_bar=False,
        **look,
    )


def bar_width(layer: Layer, line: int) -> int:
    """Width in pixels of a layer's colour bar with its title, for text of a height."""
    title = ImageFont.load_default(line).getlength(layer.title)
    return math.ceil(max(title, 5.5 * line)) + 2 * line


def draw_bar(image: Picture, layer: Layer, line: int | None = None) -> Picture:
    """Draw the colour bar of a layer's scalars along the right border.

    Args:
        image: the picture.
        layer: with `scalars`, `limits` and `title`.
        line: height of the text in pixels; by default 1/40 of the picture's, at least 11.
    """
    height, width = image.shape[:2]
    low, high = _limits(layer)
    line = line or max(11, height // 40)
    font = ImageFont.load_default(line)
    top, bottom = round(0.25 * height), round(0.75 * height)
    left = width - round(6.5 * line)
    ramp = np.asarray(pv.LookupTable(layer.colormap, n_values=256).values)[::-1, :3]
    bar = Image.fromarray(ramp.astype(np.uint8)[:, None]).resize((line, bottom - top))
    canvas = Image.fromarray(image)
    canvas.paste(bar, (left, top))
    pen = ImageDraw.Draw(canvas)
    for value, y in ((high, top), ((low + high) / 2, (top + bottom) / 2), (low, bottom)):
        pen.text((left + 1.5 * line, y), f"{value:.3g}", fill=INK, font=font, anchor="lm")
    pen.text((width - line, top - line), layer.title, fill=INK, font=font, anchor="rs")
    return np.asarray(canvas)


def _limits(layer: Layer) -> tuple[float, float]:
    if layer.limits is not None:
        return layer.limits
    values = np.asarray(layer.scalars, dtype=np.float64)
    return float(values.min()), float(values.max())


def _add_handles(plotter: pv.Plotter, handles: HandleGlyphs, diagonal: float) -> None:
    positions = np.asarray(handles.positions, dtype=np.float64).reshape(-1, 3)
    pinned = np.zeros(len(positions), bool) if handles.pinned is None else np.array(handles.pinned)
    radius = handles.radius if handles.radius is not None else 0.013 * diagonal
    _add_balls(plotter, positions[~pinned], radius, HANDLE)
    _add_balls(plotter, positions[pinned], radius, PINNED)
    if handles.targets is None:
        return
    targets = np.asarray(handles.targets, dtype=np.float64).reshape(-1, 3)
    apart = np.sqrt(((targets - positions) ** 2).sum(axis=1)) > 0.5 * radius
    _add_balls(plotter, targets[apart], 0.8 * radius, TARGET)
    for start, end in zip(positions[apart], targets[apart], strict=True):
        rod = pv.Tube(pointa=start, pointb=end, radius=0.22 * radius, n_sides=16)
        plotter.add_mesh(rod, color=TARGET, ambient=0.6, diffuse=0.4)


def _add_balls(plotter: pv.Plotter, centres: NDArray, radius: float, color: str) -> None:
    for centre in centres:
        ball = pv.Sphere(radius=radius, center=centre, theta_resolution=24, phi_resolution=24)
        plotter.add_mesh(ball, color=color, ambient=0.5, diffuse=0.5, smooth_shading=True)


@contextmanager
def off_screen() -> Iterator[None]:
    """Make VTK's next render window use EGL on Linux, whatever DISPLAY says."""
    if not sys.platform.startswith("linux"):
        yield
        return
    _check_egl()
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    before = os.environ.get(name)
    os.environ[name] = "vtkEGLRenderWindow"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


@cache
def _check_egl() -> None:
    """Raise InputError unless EGL starts: VTK would crash the process with a segmentation fault."""
    remedy = "install its libraries (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)"
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        raise deformer.InputError(f"pictures: off-screen rendering needs EGL; {remedy}") from error
    if not hasattr(egl, "eglGetPlatformDisplay"):
        return  # before EGL 1.5 there is no function to test with
    egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
    egl.eglGetPlatformDisplay.argtypes = [ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    display = egl.eglGetPlatformDisplay(_SURFACELESS, None, None)
    if not display or not egl.eglInitialize(display, None, None):
        raise deformer.InputError(
            f"pictures: EGL is installed but has no driver to render with; {remedy}"
        )
