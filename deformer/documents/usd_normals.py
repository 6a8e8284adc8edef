"""Normals of USD meshes, of any interpolation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from deformer.documents.normals import renewed_normals, smooth_groups
from deformer.geometry import FloatArray, IntArray
from deformer.io import UsdMesh


class UsdNormals:
    """One array of normals of a mesh; `attribute` holds it."""

    def __init__(self, mesh: UsdMesh, found: tuple[Any, Any, str], pxr: Any) -> None:
        """Note what the mesh has.

        Args:
            mesh: the mesh.
            found: attribute, that of its indices or None, and interpolation.
            pxr: as of `usd_library`.
        """
        self.attribute, self._indices, interpolation = found
        self._sign = -1.0 if mesh.left_handed else 1.0
        self._points = mesh.points()
        self._counts, self._corners = mesh.faces(None)
        first = pxr.Usd.TimeCode.EarliestTime()
        stored = np.array(self.attribute.Get(first), dtype=np.float64).reshape(-1, 3)
        if self._indices is not None:
            stored = stored[np.array(self._indices.Get(first), dtype=np.int64)]
        self._stored = stored
        self._elements = elements_of_corners(interpolation, self._counts, self._corners)
        if interpolation in ("uniform", "constant"):
            self._groups = self._elements
        else:
            places, values = self._points[self._corners], stored[self._elements]
            self._groups = smooth_groups(places, values)
        self._old = np.zeros((int(self._groups.max()) + 1, 3))
        self._old[self._groups] = stored[self._elements]

    @staticmethod
    def found(mesh: UsdMesh, pxr: Any) -> Iterator[tuple[Any, Any, str]]:
        """The arrays of normals that fit a mesh, as the constructor takes them."""
        described = pxr.UsdGeom.Mesh(mesh.prim)
        kinds = []
        if described.GetNormalsAttr().HasAuthoredValue():
            kinds.append((described.GetNormalsAttr(), None, described.GetNormalsInterpolation()))
        primvar = pxr.UsdGeom.PrimvarsAPI(mesh.prim).GetPrimvar("normals")
        if primvar and primvar.HasAuthoredValue():
            indices = primvar.GetIndicesAttr() if primvar.IsIndexed() else None
            kinds.append((primvar.GetAttr(), indices, primvar.GetInterpolation()))
        first = pxr.Usd.TimeCode.EarliestTime()
        counts, corners = mesh.faces(None)
        for attribute, indices, interpolation in kinds:
            elements = elements_of_corners(interpolation, counts, corners)
            size = len(attribute.Get(first) or ())
            if indices is not None:
                rows = np.array(indices.Get(first) or (), dtype=np.int64)
                if not (len(rows) and rows.min() >= 0 and rows.max() < size):
                    continue
                size = len(rows)
            if elements.max() < size:
                yield attribute, indices, interpolation

    def clear(self) -> None:
        """Remove what is stored; `values` have no indices."""
        self.attribute.Clear()
        if self._indices is not None:
            self.attribute.GetPrim().RemoveProperty(self._indices.GetName())

    def values(self, points: FloatArray) -> FloatArray:
        """Normals (n, 3) of points (V, 3), both in the prim's own space."""
        renewed = renewed_normals(
            self._sign * self._old,
            self._groups,
            self._points,
            points,
            self._counts,
            self._corners,
        )
        found = self._stored.copy()
        found[self._elements] = self._sign * renewed[self._groups]
        return found


def elements_of_corners(interpolation: str, counts: IntArray, corners: IntArray) -> IntArray:
    """The element (C,) of a primvar that each corner of a mesh has.

    Args:
        interpolation: of the primvar.
        counts: (P,) corners of each polygon.
        corners: (C,) vertices of all polygons, one polygon after the other.
    """
    match interpolation:
        case "faceVarying":
            return np.arange(len(corners))
        case "uniform":
            return np.repeat(np.arange(len(counts)), counts)
        case "constant":
            return np.zeros(len(corners), dtype=np.int64)
        case _:
            return corners
