"""USD stages: meshes in their order, with time samples, skeletons and blend shapes (UsdSkel).

The library usd-core is optional, and is imported when a file is opened.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    IntArray,
    MeshSequence,
    ShapeSequence,
    shape_sequence,
)
from deformer.io.atomic import check_file
from deformer.io.parsing import checked_polygons, distinct
from deformer.io.polygons import Polygons
from deformer.io.sampling import check_room, frame_times, shows_a_shape
from deformer.io.usd_meshes import UsdMesh
from deformer.io.usd_modules import usd_library
from deformer.workspace import Empty, in_memory

_log = logging.getLogger("deformer")
# A stage has one time line, which is its only clip.
_CLIP = "animation"
# Instances may repeat each other, so that a small file could ask for any number of prims.
_MOST_PRIMS = 1_000_000


class UsdReader:
    """Reads each file of one sequence as one shape: as the stage is at its first time."""

    def __call__(self, data: bytes, name: str) -> tuple[FloatArray, Polygons]:
        """Vertices (V, 3) and polygons of a USD file.

        Args:
            data: contents of the file, which is opened by its name.
            name: its path.

        Raises:
            InputError: as of `read_usd_shapes`.
        """
        scene = open_usd(Path(name))
        return scene.vertices(None, None), scene.polygons


def read_usd_shapes(
    path: Path, fps: float | None, clip: str | int | None, empty: Empty = in_memory
) -> ShapeSequence:
    """Shapes of one USD file, in the stage's own units and axes.

    With blend shapes: shape 0, "base", has all weights 0; then comes each blend shape at weight 1,
    its in-betweens before it ("smile at 0.5"); last "default", if the stage shows other weights
    than 0 that do not move. Without them, or with a clip: the stage from its first time sample to
    its last. Without either: the meshes.

    Args:
        path: a .usd, .usda, .usdc or .usdz file.
        fps: frames a second; None is the stage's own rate.
        clip: "animation" or 0; None reads blend shapes where there are some.
        empty: makes the array of an animation's positions.

    Raises:
        InputError: usd-core is not installed, the file cannot be opened, has no mesh, names files
            outside of its folder or that are missing, changes its connectivity, or has no such
            clip.
    """
    stage = open_usd(path)
    times = stage.times()
    if clip is not None and (clip not in (_CLIP, 0, "0") or len(times) < 2):
        has = f"expected {_CLIP!r}" if len(times) > 1 else "and nothing in the file moves"
        raise InputError(
            f"{path}: no clip {shortened(clip)}, {has}; give a clip that is there, or none"
        )
    if stage.shape_names and clip is None:
        if len(times) > 1:
            _log.warning(
                f"{path}: read {len(stage.shape_names)} blend shapes and not its animation; name "
                f"the clip {_CLIP!r} to read that"
            )
        return stage.blend_shapes(moving=len(times) > 1)
    if len(times) > 1:
        return stage.frames(times, fps, empty)
    vertices = stage.vertices(None, None)
    faces = stage.polygons.triangles(vertices, str(path))
    return MeshSequence(vertices[None], faces)


class UsdScene:
    """The meshes of one opened stage, in the order in which their vertices are counted.

    `stage` is the stage, `size` its bytes, `meshes` are those with faces, `polygons` the polygons
    of all of them, and `shape_names` the names of their blend shapes.
    """

    def __init__(self, stage: Any, name: str, size: int) -> None:
        """Find the meshes.

        Args:
            stage: a Usd.Stage.
            name: file name for messages.
            size: bytes of the file, which bound what is read from it.

        Raises:
            InputError: no mesh, point instancers, or faces that do not fit the points.
        """
        self.name = name
        self.size = size
        self.stage = stage
        self.meshes = self._found()
        if not self.meshes:
            raise InputError(
                f"{name}: no faces, expected a stage with a mesh; export it with its meshes"
            )
        self.vertex_count = sum(mesh.count for mesh in self.meshes)
        check_room(1, self.vertex_count, self.size, self.name, "meshes", "export fewer instances")
        self.polygons = self._joined()
        self.shape_names = tuple(dict.fromkeys(n for mesh in self.meshes for n in mesh.shapes))

    def _found(self) -> list[UsdMesh]:
        pxr = usd_library(self.name)
        cache = pxr.UsdSkel.Cache()
        populated: set[str] = set()
        found = []
        prims = pxr.Usd.PrimRange.Stage(self.stage, pxr.Usd.TraverseInstanceProxies())
        for number, prim in enumerate(prims):
            if number >= _MOST_PRIMS:
                raise InputError(
                    f"{self.name}: more than {_MOST_PRIMS} prims; export the meshes alone"
                )
            if prim.IsA(pxr.UsdGeom.PointInstancer):
                raise InputError(
                    f"{self.name}: {prim.GetPath()} repeats its meshes as a point instancer, so "
                    "vertices cannot be kept exactly; make each copy a mesh"
                )
            if not prim.IsA(pxr.UsdGeom.Mesh):
                continue
            if pxr.UsdGeom.Imageable(prim).ComputePurpose() in ("guide", "proxy"):
                continue
            root = pxr.UsdSkel.Root.Find(prim)
            if root and str(root.GetPath()) not in populated:
                populated.add(str(root.GetPath()))
                cache.Populate(root, pxr.Usd.TraverseInstanceProxies())
            mesh = UsdMesh(prim, cache if root else None, self.name)
            if mesh.count and len(mesh.polygons.counts):
                found.append(mesh)
        return found

    def _joined(self) -> Polygons:
        starts = np.cumsum([0, *(mesh.count for mesh in self.meshes)])
        corners = [m.polygons.corners + s for m, s in zip(self.meshes, starts[:-1], strict=True)]
        counts = np.concatenate([mesh.polygons.counts for mesh in self.meshes])
        return checked_polygons(
            np.concatenate(corners), counts, self.vertex_count, self.name, lambda i: f"face {i}"
        )

    def faces(self, base: bool) -> IntArray:
        """Triangles (F, 3) of the first shape.

        Args:
            base: true if blend shapes give several shapes, the first of which has weights 0.
        """
        weights = {} if base and self.shape_names else None
        return self.polygons.triangles(self.vertices(None, weights), self.name)

    def times(self) -> list[float]:
        """Times of all samples that move a vertex, in time codes."""
        return sorted({time for mesh in self.meshes for time in mesh.times()})

    def vertices(self, time: float | None, weights: dict[str, float] | None) -> FloatArray:
        """Vertices (V, 3) in the world.

        Args:
            time: time code; None is the first.
            weights: of blend shapes, by name, 0 where one is missing; None for the stage's own.
        """
        return np.concatenate([mesh.vertices(time, weights) for mesh in self.meshes])

    def blend_shapes(self, moving: bool) -> MeshSequence:
        """Shapes of the blend shapes; `moving` is true if the stage has time samples."""
        wanted = [("base", {})]
        for name in self.shape_names:
            between = {w for mesh in self.meshes for w in mesh.shapes.get(name, ())}
            rows = [(f"{name} at {w:.4g}", {name: w}) for w in sorted(between) if w != 1]
            wanted += [*rows, (name, {name: 1.0})]
        names = distinct(name for name, _ in wanted)
        N, V = len(names) + 1, self.vertex_count
        check_room(N, V, self.size, self.name, "blend shapes", "export fewer of them")
        vertices = [self.vertices(None, weights) for _, weights in wanted]
        weights = np.concatenate([mesh.shown_weights() for mesh in self.meshes])
        shown = self.vertices(None, None)
        if not moving and shows_a_shape(weights, shown, np.stack(vertices)):
            vertices.append(shown)
            names = (*names, "default")
            _log.warning(
                f"{self.name}: its weights are not 0; shape 0 has weights 0, and shape "
                f"{len(names) - 1}, 'default', is as the stage shows it"
            )
        faces = self.polygons.triangles(vertices[0], self.name)
        return MeshSequence(np.stack(vertices), faces, names)

    def frames(self, times: list[float], fps: float | None, empty: Empty) -> ShapeSequence:
        """The stage from the first of some time codes to the last."""
        scale = float(self.stage.GetTimeCodesPerSecond())
        rate = float(self.stage.GetFramesPerSecond()) if fps is None else fps
        if not (scale > 0 and rate > 0):
            raise InputError(f"{self.name}: {scale:g} time codes a second; correct the rate")
        seconds = frame_times(times[0] / scale, times[-1] / scale, rate, self.name)
        F, V = len(seconds), self.vertex_count
        check_room(F, V, self.size, self.name, f"frames at {rate:g} a second", "give a lower fps")
        for mesh in self.meshes:
            mesh.check_connectivity()
        vertices = empty((F, V, 3))
        for f, second in enumerate(seconds):
            vertices[f : f + 1] = self.vertices(float(second * scale), None)[None]
        faces = self.polygons.triangles(vertices[0], self.name)
        names = tuple(f"{_CLIP} {s:.4g} s" for s in seconds)
        return shape_sequence(vertices, faces, names)


def open_usd(path: Path) -> UsdScene:
    """The meshes of a USD file.

    Args:
        path: a .usd, .usda, .usdc or .usdz file.

    Raises:
        InputError: as of `read_usd_shapes`.
    """
    check_file(path)
    return UsdScene(_opened(path), str(path), path.stat().st_size)


def _opened(path: Path) -> Any:
    """The stage of a file whose layers all lie in the file's folder."""
    pxr = usd_library(path)
    try:
        stage = pxr.Usd.Stage.Open(str(path))
        # Layers that another stage of this process still holds may be older than their files.
        stage.Reload()
    except pxr.Tf.ErrorException as error:
        lines = str(error).split("\n")
        raise InputError(
            f"{path}: cannot be opened as USD ({shortened(lines[-1].strip())}); export it again"
        ) from None
    folder = path.resolve().parent
    for layer in stage.GetUsedLayers():
        # Layers in a package are written as package.usdz[layer.usdc].
        place = layer.realPath.partition("[")[0]
        if place and not Path(place).resolve().is_relative_to(folder):
            raise InputError(
                f"{path}: is composed of {shortened(layer.realPath)}, which is not in its folder; "
                "export one flattened file"
            )
    for error in stage.GetCompositionErrors():
        raise InputError(
            f"{path}: cannot be composed ({shortened(str(error))}), such as for a file that is "
            "missing; put it beside the file, or export one flattened file"
        )
    return stage
