"""Descriptions of the polygon meshes of USD stages."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from deformer.documents.glb_polygons import encoded_colours
from deformer.documents.normals import smooth_groups
from deformer.documents.polygons import Material, Part, PolygonMesh
from deformer.documents.usd_normals import elements_of_corners
from deformer.geometry import FloatArray, IntArray
from deformer.io import UsdMesh, UsdScene, usd_library


def usd_polygons(scene: UsdScene) -> PolygonMesh:
    """What a stage has beside positions, of what other formats know.

    Args:
        scene: the stage.
    """
    pxr = usd_library(scene.name)
    readers = [_Reader(mesh, pxr) for mesh in scene.meshes]
    materials: dict[str, tuple[int, Material]] = {}
    numbers = [reader.materials(materials) for reader in readers]
    uvs = np.concatenate([reader.uvs() for reader in readers])
    normals, largest = [], -1
    for reader in readers:
        own = reader.normals()
        normals.append(np.where(own >= 0, own + largest + 1, -1))
        largest = max(largest, int(normals[-1].max()))
    parts: dict[str, int] = {}
    part = [
        np.full(len(reader.counts), parts.setdefault(reader.label, len(parts)))
        for reader in readers
    ]
    return PolygonMesh(
        scene.polygons.counts,
        scene.polygons.corners,
        None if np.isnan(uvs).all() else uvs,
        np.concatenate(normals) if largest >= 0 else None,
        _joined([reader.colours() for reader in readers]),
        np.concatenate(numbers),
        tuple(material for _, material in materials.values()),
        np.concatenate(part),
        tuple(Part(name) for name in parts),
    )


def _joined(colours: list[FloatArray | None]) -> FloatArray | None:
    """Colours (V, 3 or 4) of all meshes, if all have some."""
    found = [each for each in colours if each is not None]
    if len(found) < len(colours):
        return None
    joined = np.concatenate(found)
    return joined if (joined[:, 3] < 1).any() else joined[:, :3]


class _Reader:
    """Reads what one mesh has; `counts` are the corners of its polygons, and `label` its name."""

    def __init__(self, mesh: UsdMesh, pxr: SimpleNamespace) -> None:
        self._mesh, self._prim, self._pxr = mesh, mesh.prim, pxr
        self.counts = mesh.polygons.counts
        self.label = _name(mesh.prim)
        self._primvars = pxr.UsdGeom.PrimvarsAPI(mesh.prim)

    def uvs(self) -> FloatArray:
        """Texture coordinates (C, 2) of the first set, NaN without one."""
        primvars = self._primvars.GetPrimvarsWithAuthoredValues()
        sets = [p for p in primvars if p.GetTypeName().type.typeName == "VtArray<GfVec2f>"]
        sets = [p for p in sets if p.GetTypeName().role or p.GetPrimvarName() in ("st", "UVMap")]
        # "st" is the one that renderers take.
        sets.sort(key=lambda p: p.GetPrimvarName() != "st")
        for primvar in sets:
            found = self._of_primvar(primvar, 2)
            if found is not None:
                return found
        return np.full((len(self._mesh.polygons.corners), 2), np.nan)

    def normals(self) -> IntArray:
        """Number (C,) of each corner's normal; −1 without one."""
        described = self._pxr.UsdGeom.Mesh(self._prim)
        primvar, attribute = self._primvars.GetPrimvar("normals"), described.GetNormalsAttr()
        found = None
        if primvar and primvar.HasAuthoredValue():
            found = self._of_primvar(primvar, 3)
        elif attribute.HasAuthoredValue():
            stored = attribute.Get(self._pxr.Usd.TimeCode.EarliestTime())
            found = self._of_corners(stored, 3, described.GetNormalsInterpolation())
        elif described.GetSubdivisionSchemeAttr().Get() != "none":
            # Subdivided surfaces are smooth.
            return self._mesh.polygons.corners
        if found is None:
            return np.full(len(self._mesh.polygons.corners), -1)
        return smooth_groups(self._mesh.points()[self._mesh.polygons.corners], found)

    def colours(self) -> FloatArray | None:
        """Colours (V, 4) encoded as sRGB, the mean of the corners' at each vertex."""
        found = np.ones((self._mesh.count, 4))
        for name, columns in (("displayColor", slice(0, 3)), ("displayOpacity", slice(3, 4))):
            primvar = self._primvars.GetPrimvar(name)
            width = columns.stop - columns.start
            values = None
            if primvar and primvar.HasAuthoredValue():
                values = self._of_primvar(primvar, width)
            if values is not None:
                corners = self._mesh.polygons.corners
                share = np.maximum(np.bincount(corners, minlength=self._mesh.count), 1)
                sums = np.zeros((self._mesh.count, width))
                np.add.at(sums, corners, values)
                found[:, columns] = np.clip(sums / share[:, None], 0, 1)
            elif width == 3:
                return None
        found[:, :3] = encoded_colours(found[:, :3])
        return found

    def _of_primvar(self, primvar: Any, width: int) -> FloatArray | None:
        first = self._pxr.Usd.TimeCode.EarliestTime()
        flat = primvar.ComputeFlattened(first) if primvar.IsIndexed() else primvar.Get(first)
        return self._of_corners(flat, width, primvar.GetInterpolation())

    def _of_corners(self, stored: Any, width: int, interpolation: str) -> FloatArray | None:
        """Values (C, width) of the polygons' corners; None if they do not fit the mesh."""
        values = np.array(() if stored is None else stored, dtype=np.float64).reshape(-1, width)
        elements = elements_of_corners(interpolation, *self._mesh.faces(None))
        rows = elements[self._mesh.stored_corners]
        return values[rows] if rows.max(initial=-1) < len(values) else None

    def materials(self, known: dict[str, tuple[int, Material]]) -> IntArray:
        """Number (P,) of each polygon's material, −1 without one.

        Args:
            known: numbers and materials by path, which grow.
        """
        shading = self._pxr.UsdShade
        binding = shading.MaterialBindingAPI(self._prim)
        # Of stored faces, which holes are a part of.
        found = np.full(len(self._mesh.faces(None)[0]), self._number(self._prim, known))
        for subset in binding.GetMaterialBindSubsets():
            rows = np.array(subset.GetIndicesAttr().Get() or (), dtype=np.int64)
            if len(rows) and rows.min() >= 0 and rows.max() < len(found):
                found[rows] = self._number(subset.GetPrim(), known)
        return found[self._mesh.stored_faces]

    def _number(self, prim: Any, known: dict[str, tuple[int, Material]]) -> int:
        material = self._pxr.UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        if not material:
            return -1
        path = str(material.GetPath())
        if path not in known:
            described = Material(_name(material.GetPrim()), _base_colour(material))
            known[path] = (len(known), described)
        return known[path][0]


def _base_colour(material: Any) -> tuple[float, float, float, float] | None:
    """The colour of a preview surface; None for others and for textures."""
    shader = material.ComputeSurfaceSource()[0]
    if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
        return None
    colour, opacity = _constant(shader, "diffuseColor"), _constant(shader, "opacity")
    if colour is None or len(colour) != 3:
        return None
    numbers = [*colour, 1.0 if opacity is None else opacity]
    red, green, blue, alpha = (min(max(float(number), 0.0), 1.0) for number in numbers)
    return red, green, blue, alpha


def _constant(shader: Any, name: str) -> Any:
    """The value of an input; None if it has none, or a texture."""
    entry = shader.GetInput(name)
    sources = entry.GetValueProducingAttributes() if entry else []
    if len(sources) != 1 or not sources[0].GetName().startswith("inputs:"):
        return None
    return sources[0].Get()


def _name(prim: Any) -> str:
    """The name that people gave a prim."""
    return str(prim.GetDisplayName() or prim.GetName())
