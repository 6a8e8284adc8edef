"""Meshes and sequences as files of Universal Scene Description (USD)."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from deformer.documents.document import Document
from deformer.documents.glb_polygons import linear_colours
from deformer.documents.polygons import Material, PolygonMesh
from deformer.documents.text_files import single_precision
from deformer.geometry import FloatArray, IntArray
from deformer.io import usd_library


def write_usd(
    path: Path,
    shapes: FloatArray,
    faces: IntArray,
    document: Document | None = None,
    *,
    name: str = "mesh",
    up: str = "y",
    fps: float = 24.0,
) -> None:
    """Write a mesh whose points have a time sample for each of several shapes.

    It has the polygons, texture coordinates (`primvars:st`), normals, vertex colours
    (`primvars:displayColor`) and materials with their base colours of the document. Points are
    counted as in the shapes, in their own units, which are said to be metres. With a document that
    is USD itself it is that stage, which decides names, units and the axis that points up.

    Args:
        path: the file, named .usda for text, .usdc for binary, or .usd, which is binary, too.
        shapes: (F, V, 3) positions, rounded to single precision; time code f is shape f. One alone
            has no time samples.
        faces: (F, 3) triangles, where there is no document.
        document: what the mesh has beside positions and triangles.
        name: name of the mesh.
        up: "y" or "z", the axis that points up.
        fps: frames a second.

    Raises:
        InputError: usd-core is missing, or a position is too large for single precision.
    """
    pxr = usd_library(path)
    if document is not None and document.suffix == ".usdc":
        rate = fps if len(shapes) > 1 else None
        path.write_bytes(document.rewritten_usd(shapes, path.suffix.lower(), rate))
        return
    mesh = document.polygons() if document is not None else None
    stage = pxr.Usd.Stage.CreateNew(str(path))
    writer = _Writer(pxr, stage, name, up)
    writer.write_polygons(faces if mesh is None else mesh)
    if len(shapes) > 1:
        writer.write_times(len(shapes), fps)
        for code, shape in enumerate(shapes):
            writer.write_shape(single_precision(shape, "USD"), shape, code)
    else:
        writer.write_shape(single_precision(shapes[0], "USD"), shapes[0], None)
    stage.GetRootLayer().Save()


class _Writer:
    """Writes one mesh below a root of its name."""

    def __init__(self, pxr: SimpleNamespace, stage: Any, name: str, up: str) -> None:
        self._pxr, self._stage = pxr, stage
        geometry, tokens = pxr.UsdGeom, pxr.UsdGeom.Tokens
        geometry.SetStageUpAxis(stage, tokens.z if up == "z" else tokens.y)
        geometry.SetStageMetersPerUnit(stage, 1.0)
        self._root = self._pxr.Sdf.Path.absoluteRootPath.AppendChild(self._identifier(name))
        root = geometry.Xform.Define(stage, self._root)
        stage.SetDefaultPrim(root.GetPrim())
        self._mesh = geometry.Mesh.Define(stage, self._root.AppendChild(self._identifier(name)))
        _show(self._mesh, name)
        self._mesh.CreateSubdivisionSchemeAttr(tokens.none)
        self._mesh.CreateDoubleSidedAttr(True)
        self._primvars = geometry.PrimvarsAPI(self._mesh)
        self._polygons: PolygonMesh | None = None
        self._normals: Any = None

    def write_polygons(self, polygons: PolygonMesh | IntArray) -> None:
        """Write all that does not change in time."""
        if isinstance(polygons, np.ndarray):
            self._write_corners(np.full(len(polygons), 3), polygons.ravel())
            return
        mesh = self._polygons = polygons.with_all_normals()
        self._write_corners(mesh.counts, mesh.corners)
        if mesh.uvs is not None:
            values, index = np.unique(np.nan_to_num(mesh.uvs), axis=0, return_inverse=True)
            self._corner_primvar("st", "TexCoord2fArray", "Vec2fArray", values, index.ravel())
        if mesh.normals is not None:
            values = mesh.shading(np.zeros((int(mesh.corners.max()) + 1, 3)))
            self._normals = self._corner_primvar(
                "normals", "Normal3fArray", "Vec3fArray", values, mesh.normals
            )
        if mesh.colours is not None:
            colours = linear_colours(mesh.colours[:, :3])
            self._vertex_primvar("displayColor", "Color3fArray", "Vec3fArray", colours)
            if mesh.colours.shape[1] == 4:
                opacity = mesh.colours[:, 3]
                self._vertex_primvar("displayOpacity", "FloatArray", "FloatArray", opacity)
        self._write_materials(mesh)

    def write_times(self, count: int, fps: float) -> None:
        """Write the range and the rate of the time samples."""
        self._stage.SetStartTimeCode(0)
        self._stage.SetEndTimeCode(count - 1)
        self._stage.SetTimeCodesPerSecond(fps)
        self._stage.SetFramesPerSecond(fps)

    def write_shape(self, points: np.ndarray, shape: FloatArray, code: int | None) -> None:
        """Write the points of one shape, at a time code or, with the first, for all times."""
        values = {self._mesh.GetPointsAttr(): self._array("Vec3fArray", points)}
        values[self._mesh.GetExtentAttr()] = self._array(
            "Vec3fArray", np.stack([points.min(axis=0), points.max(axis=0)])
        )
        if self._polygons is not None and self._normals is not None:
            values[self._normals.GetAttr()] = self._array(
                "Vec3fArray", self._polygons.shading(shape)
            )
        for attribute, value in values.items():
            if not code:
                attribute.Set(value)
            if code is not None:
                attribute.Set(value, code)

    def _write_corners(self, counts: IntArray, corners: IntArray) -> None:
        self._mesh.CreateFaceVertexCountsAttr(self._array("IntArray", counts))
        self._mesh.CreateFaceVertexIndicesAttr(self._array("IntArray", corners))
        self._mesh.CreatePointsAttr()
        self._mesh.CreateExtentAttr()

    def _corner_primvar(
        self, name: str, kind: str, array: str, values: FloatArray, index: IntArray
    ) -> Any:
        """A primvar with a value at each corner, by its number."""
        types, tokens = self._pxr.Sdf.ValueTypeNames, self._pxr.UsdGeom.Tokens
        found = self._primvars.CreatePrimvar(name, getattr(types, kind), tokens.faceVarying)
        found.Set(self._array(array, values))
        found.SetIndices(self._array("IntArray", index))
        return found

    def _vertex_primvar(self, name: str, kind: str, array: str, values: FloatArray) -> None:
        types, tokens = self._pxr.Sdf.ValueTypeNames, self._pxr.UsdGeom.Tokens
        found = self._primvars.CreatePrimvar(name, getattr(types, kind), tokens.vertex)
        found.Set(self._array(array, values))

    def _write_materials(self, mesh: PolygonMesh) -> None:
        shading = self._pxr.UsdShade
        used = [n for n in range(len(mesh.materials)) if (mesh.material == n).any()]
        binding = shading.MaterialBindingAPI
        taken: set[str] = set()
        for n in used:
            label = self._identifier(mesh.materials[n].name)
            while label in taken:
                label += "_"
            taken.add(label)
            material = self._material(label, mesh.materials[n])
            chosen = np.flatnonzero(mesh.material == n)
            if len(chosen) == len(mesh.counts):
                binding.Apply(self._mesh.GetPrim()).Bind(material)
                return
            owner = binding.Apply(self._mesh.GetPrim())
            subset = owner.CreateMaterialBindSubset(label, self._array("IntArray", chosen))
            binding.Apply(subset.GetPrim()).Bind(material)

    def _material(self, label: str, described: Material) -> Any:
        """A material with a surface of its base colour."""
        shading, types = self._pxr.UsdShade, self._pxr.Sdf.ValueTypeNames
        scope = self._root.AppendChild("materials")
        if scope == self._mesh.GetPath():
            scope = self._root.AppendChild("materials_")
        self._pxr.UsdGeom.Scope.Define(self._stage, scope)
        material = shading.Material.Define(self._stage, scope.AppendChild(label))
        _show(material, described.name)
        shader = shading.Shader.Define(self._stage, material.GetPath().AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        if described.colour is not None:
            colour = self._pxr.Gf.Vec3f(*described.colour[:3])
            shader.CreateInput("diffuseColor", types.Color3f).Set(colour)
            shader.CreateInput("opacity", types.Float).Set(described.colour[3])
        surface = shader.CreateOutput("surface", types.Token)
        material.CreateSurfaceOutput().ConnectToSource(surface)
        return material

    def _identifier(self, name: str) -> str:
        return self._pxr.Tf.MakeValidIdentifier(_unicode(name))

    def _array(self, kind: str, values: np.ndarray) -> Any:
        """An array of USD; numbers are rounded to single precision."""
        number = np.int32 if kind == "IntArray" else np.float32
        found = np.ascontiguousarray(values.astype(number))
        return getattr(self._pxr.Vt, kind).FromNumpy(found)


def _show(schema: Any, name: str) -> None:
    """Give a prim whose name is an identifier the name that people gave it."""
    if schema.GetPrim().GetName() != name:
        schema.GetPrim().SetDisplayName(_unicode(name))


def _unicode(name: str) -> str:
    """A name without the halves of characters that names of files may have in Python."""
    return name.encode("utf-8", "replace").decode()
