"""USD stages in memory, whose meshes take other positions."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from deformer.documents.text_files import single_precision
from deformer.documents.usd_normals import UsdNormals
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.io import UsdMesh, UsdScene, read_bytes, usd_library

# Of a mesh: they would blur its former motion.
_MOTION = ("velocities", "accelerations")
_OF_SHAPE = ("points", "normals", "primvars:normals", "primvars:normals:indices", "extent")
_SKELETON = ("skel:", "primvars:skel:")
_INHERITED = ("primvars:skel:", "skel:joints")


def flattened_usd(scene: UsdScene, folder: Path) -> bytes:
    """A stage as one binary file, without instances, its meshes as they are at their first time.

    Skeletons, blend shapes and animations of transforms stay. Textures stay outside, by paths
    relative to the stage's folder, unless their paths are absolute.

    Args:
        scene: the stage; its session layer is changed.
        folder: folder of its file.
    """
    pxr, stage = usd_library(scene.name), scene.stage
    stage.SetEditTarget(stage.GetSessionLayer())
    # Instances within instances can be edited once those around them are none.
    while instances := [prim for prim in stage.Traverse() if prim.IsInstance()]:
        for prim in instances:
            prim.SetInstanceable(False)
    absolute: set[str] = set()
    for layer in stage.GetUsedLayers():
        pxr.UsdUtils.ModifyAssetPaths(layer, lambda path: _noted(path, absolute))
    layer = stage.Flatten(addSourceFileComment=False)
    root = folder.resolve()
    pxr.UsdUtils.ModifyAssetPaths(layer, lambda path: _relative(path, root, absolute))
    flat = UsdScene(pxr.Usd.Stage.Open(layer), scene.name, scene.size)
    for mesh in flat.meshes:
        _remove(mesh.prim, _MOTION)
        for name in _OF_SHAPE:
            _hold(mesh.prim.GetAttribute(name), pxr)
    return _exported(layer, ".usdc")


def _noted(path: str, absolute: set[str]) -> str:
    if Path(path).is_absolute():
        absolute.add(path)
    return path


def _relative(path: str, folder: Path, kept: set[str]) -> str:
    """A path as seen from a folder; flattening has made it absolute, unless it is to be kept."""
    if not Path(path).is_absolute() or path in kept:
        return path
    try:
        found = Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path
    return found if found.startswith("../") else f"./{found}"


def opened_usd(data: bytes, name: str) -> UsdScene:
    """The stage of a file's contents, which no other stage shares.

    Args:
        data: contents of a .usdc file.
        name: file name for messages.

    Raises:
        InputError: usd-core is missing, the stage has no mesh, or refers to other files.
    """
    pxr = usd_library(name)
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "document.usdc"
        file.write_bytes(data)
        layer = pxr.Sdf.Layer.OpenAsAnonymous(str(file))
        if layer.GetCompositionAssetDependencies():
            raise InputError(f"{name}: refers to other stages, expected one flattened file")
        return UsdScene(pxr.Usd.Stage.Open(layer), name, len(data))


def up_axis(scene: UsdScene) -> str:
    """The axis of a stage that points up, "y" or "z"."""
    geometry = usd_library(scene.name).UsdGeom
    return "z" if geometry.GetStageUpAxis(scene.stage) == geometry.Tokens.z else "y"


def rewritten_usd(
    data: bytes, shapes: FloatArray, suffix: str, name: str, fps: float | None = None
) -> bytes:
    """A stage with other positions of its meshes.

    Points, normals (as many as there were, split as they were) and extents change. Transforms of
    the meshes stop at their first time, and skeletons and blend shapes move them no more.

    Args:
        data: contents of a .usdc file.
        shapes: (F, V, 3) positions in the world.
        suffix: ".usd", ".usda" or ".usdc".
        name: file name for messages.
        fps: frames a second: every shape is a time sample, from time code 0 on; None for one shape
            without a time.

    Raises:
        InputError: usd-core is missing, a position is too large for single precision, or a
            transform has no inverse.
    """
    scene = opened_usd(data, name)
    pxr, stage = usd_library(name), scene.stage
    ends = np.cumsum([mesh.count for mesh in scene.meshes])
    writers = [
        _MeshWriter(mesh, slice(end - mesh.count, end), pxr, name)
        for mesh, end in zip(scene.meshes, ends.tolist(), strict=True)
    ]
    # Without an extent of its own, that of a root is guessed from the joints below it.
    roots = [prim for prim in stage.Traverse() if prim.IsA(pxr.UsdSkel.Root)]
    bounds = [_RootBounds(root, writers, pxr) for root in roots]
    for writer in writers:
        writer.release()
    codes: list[float | None] = [None]
    if fps is not None:
        codes = list(_timed(stage, len(shapes), fps))
    for shape, code in zip(shapes, codes, strict=True):
        for writer in (*writers, *bounds):
            writer.write(shape, code)
    return _exported(stage.GetRootLayer(), suffix)


def _timed(stage: Any, count: int, fps: float) -> Iterator[float]:
    """Time codes of frames, after the stage's rate and range are set.

    What else moves in the stage, such as a camera, keeps its pace.
    """
    moves = stage.GetRootLayer().ListAllTimeSamples()
    rate = stage.GetTimeCodesPerSecond() if moves else fps
    last = (count - 1) * rate / fps
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(min([0.0, *moves]))
    stage.SetEndTimeCode(max([last, *moves]))
    return (frame * rate / fps for frame in range(count))


class _MeshWriter:
    """Writes positions in the world into one mesh."""

    def __init__(self, mesh: UsdMesh, rows: slice, pxr: Any, name: str) -> None:
        """Note what the stage has, before anything in it changes."""
        self.prim, self.rows = mesh.prim, rows
        self._pxr = pxr
        self._mesh = pxr.UsdGeom.Mesh(mesh.prim)
        self._stored = mesh.points()
        self._shown = None if mesh.deforms else mesh.vertices(None, None)
        self._space = _Space(mesh.prim, pxr, name)
        self._normals = [UsdNormals(mesh, found, pxr) for found in UsdNormals.found(mesh, pxr)]

    def release(self) -> None:
        """Remove what would move the mesh."""
        prim, pxr = self.prim, self._pxr
        targets = prim.GetRelationship("skel:blendShapeTargets")
        for path in targets.GetTargets() if targets else ():
            if path.HasPrefix(prim.GetPath()):
                prim.GetStage().RemovePrim(path)
        prim.RemoveAPI(pxr.UsdSkel.BindingAPI)
        _remove(prim, [name for name in prim.GetPropertyNames() if name.startswith(_SKELETON)])
        self._mesh.GetPointsAttr().Clear()
        self._mesh.GetExtentAttr().Clear()
        for normals in self._normals:
            normals.clear()
        while not prim.IsPseudoRoot():
            for attribute in prim.GetAttributes():
                if attribute.GetName().startswith("xformOp:"):
                    _hold(attribute, pxr)
            # Bounds of what is below, and joints for all meshes below.
            names = [n for n in prim.GetPropertyNames() if n.startswith(_INHERITED)]
            _remove(prim, ["extentsHint", *names])
            prim = prim.GetParent()

    def write(self, shape: FloatArray, code: float | None) -> None:
        """Write one of the shapes, at a time code or, with the first, for all times."""
        vertices = shape[self.rows]
        local = self._space.local(vertices)
        if self._shown is not None:
            still = (vertices == self._shown).all(axis=1, keepdims=True)
            local = np.where(still, self._stored, local)
        points = single_precision(local, "USD")
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        _set(self._mesh.GetPointsAttr(), points, code, self._pxr)
        _set(self._mesh.GetExtentAttr(), box, code, self._pxr)
        for normals in self._normals:
            _set(normals.attribute, normals.values(points.astype(np.float64)), code, self._pxr)


class _RootBounds:
    """Writes the extent of a root of skeletons, which is that of the meshes below it."""

    def __init__(self, root: Any, writers: list[_MeshWriter], pxr: Any) -> None:
        self._pxr, self._extent = pxr, pxr.UsdSkel.Root(root).GetExtentAttr()
        path = root.GetPath()
        self._rows = [each.rows for each in writers if each.prim.GetPath().HasPrefix(path)]
        self._space = _Space(root, pxr, str(path)) if self._rows else None

    def write(self, shape: FloatArray, code: float | None) -> None:
        """Write the extent of one of the shapes, as `_MeshWriter` writes points."""
        if self._space is None:
            return
        if not code:
            self._extent.Clear()
        points = self._space.local(np.concatenate([shape[rows] for rows in self._rows]))
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        _set(self._extent, box, code, self._pxr)


class _Space:
    """The space of a prim at the first time."""

    def __init__(self, prim: Any, pxr: Any, name: str) -> None:
        cache = pxr.UsdGeom.XformCache(pxr.Usd.TimeCode.EarliestTime())
        world = np.array(cache.GetLocalToWorldTransform(prim), dtype=np.float64)
        self._origin = world[3, :3]
        try:
            self._inverse = np.linalg.inv(world[:3, :3])
        except np.linalg.LinAlgError:
            raise InputError(
                f"{name}, {prim.GetPath()}: has a scale of 0, so that positions cannot go back; "
                "apply its transform and export it again"
            ) from None

    def local(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) of the world in this space."""
        return (points - self._origin) @ self._inverse


def _set(attribute: Any, values: np.ndarray, code: float | None, pxr: Any) -> None:
    array = pxr.Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))
    if not code:
        attribute.Set(array)
    if code is not None:
        attribute.Set(array, code)


def _hold(attribute: Any, pxr: Any) -> None:
    """Keep an attribute's value of the first time for all times."""
    if attribute and (attribute.GetNumTimeSamples() or attribute.ValueMightBeTimeVarying()):
        value = attribute.Get(pxr.Usd.TimeCode.EarliestTime())
        attribute.Clear()
        attribute.Set(value)


def _remove(prim: Any, names: Any) -> None:
    for name in names:
        if prim.HasProperty(name):
            prim.RemoveProperty(name)


def _exported(layer: Any, suffix: str) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"document{suffix}"
        layer.Export(str(file))
        return read_bytes(file)
