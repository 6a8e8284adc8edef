"""One mesh of a USD stage at any time: points, skeleton, blend shapes, transform to the world."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.polygons import Polygons
from deformer.io.usd_modules import usd_library


class UsdMesh:
    """A mesh prim.

    `prim` is the prim, `count` its number of points, `polygons` are its faces without holes, turned
    so that they are counter-clockwise from outside, `stored_corners` (M,) and `stored_faces` (n,)
    say which corner and face of the prim each corner and polygon of theirs is, and `shapes` has for
    each blend shape the weights of its in-betweens.
    """

    def __init__(self, prim: Any, cache: Any, name: str) -> None:
        """Read what does not move.

        Args:
            prim: the mesh's prim.
            cache: UsdSkel.Cache of the root above the prim; None if there is none.
            name: file name for messages.

        Raises:
            InputError: faces that do not fit the points.
        """
        self._pxr = usd_library(name)
        Usd, UsdGeom, UsdSkel = self._pxr.Usd, self._pxr.UsdGeom, self._pxr.UsdSkel
        self._mesh = UsdGeom.Mesh(prim)
        self.prim, self._name = prim, f"{name}, {prim.GetPath()}"
        self._first = Usd.TimeCode.EarliestTime()
        self.count = len(self._mesh.GetPointsAttr().Get(self._first) or ())
        self._skin: Any = None
        self._skeleton: Any = None
        self._blend: Any = None
        self.shapes: dict[str, tuple[float, ...]] = {}
        if cache is not None:
            found = cache.GetSkinningQuery(prim)
            skeleton = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
            if found and skeleton:
                self._skeleton = cache.GetSkelQuery(skeleton) or None
                self._skin = found if found.HasJointInfluences() and self._skeleton else None
            if found and found.HasBlendShapes():
                self._mapper = found.GetBlendShapeMapper()
                self._blend = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
                self._point_indices = self._blend.ComputeBlendShapePointIndices()
                self._offsets = self._blend.ComputeSubShapePointOffsets()
                self._check_blend_shapes()
                for n, shape in enumerate(found.GetBlendShapeOrder()):
                    between = self._blend.GetBlendShape(n).GetInbetweens()
                    self.shapes[str(shape)] = tuple(float(b.GetWeight() or 0) for b in between)
        counts, corners = self.faces(None)
        self.stored_corners, self.stored_faces = np.arange(len(corners)), np.arange(len(counts))
        self.polygons = self._oriented(counts, corners) if self.count else Polygons(corners, counts)

    def _check_blend_shapes(self) -> None:
        if self._blend.GetNumBlendShapes() != len(self._point_indices):
            raise self._broken("blend shapes that do not fit their names")
        for indices, offsets in zip(self._point_indices, self._offsets, strict=False):
            rows = np.asarray(indices)
            if len(rows) and not (rows.min() >= 0 and rows.max() < self.count):
                raise self._broken(f"a blend shape of point {rows.max()} of {self.count}")
            if not np.isfinite(np.asarray(offsets, float)).all():
                raise self._broken("a blend shape with an offset that is not finite")

    @property
    def deforms(self) -> bool:
        """True if a skeleton or blend shapes move the points."""
        return self._skin is not None or self._blend is not None

    def points(self) -> FloatArray:
        """The stored points (n, 3) at the first time, in the prim's own space."""
        return np.array(self._mesh.GetPointsAttr().Get(self._first), dtype=np.float64)

    def faces(self, time: float | None) -> tuple[IntArray, IntArray]:
        """Numbers of corners (F,) of the stored faces, and their vertices (corners,).

        Args:
            time: the time code; None is the first.
        """
        code = self._first if time is None else self._pxr.Usd.TimeCode(time)
        counts = self._mesh.GetFaceVertexCountsAttr().Get(code)
        corners = self._mesh.GetFaceVertexIndicesAttr().Get(code)
        return (
            np.asarray(counts if counts is not None else (), np.int64),
            np.asarray(corners if corners is not None else (), np.int64),
        )

    def _oriented(self, counts: IntArray, corners: IntArray) -> Polygons:
        if (counts < 3).any() or counts.sum() != len(corners):
            raise self._broken(f"{len(corners)} corners of faces for counts of {counts.sum()}")
        if len(corners) and not (corners.min() >= 0 and corners.max() < self.count):
            raise self._broken(f"vertex index {corners.max()} of {self.count} points")
        starts = np.repeat(np.cumsum(counts) - counts, counts)
        step = np.arange(len(corners)) - starts
        mirrored = np.linalg.det(self._world(self._first)[:3, :3]) < 0
        if self.left_handed != mirrored:
            # From the same corner on, in the other direction.
            step = (np.repeat(counts, counts) - step) % np.repeat(counts, counts)
        order, kept = starts + step, np.ones(len(counts), dtype=bool)
        holes = self._mesh.GetHoleIndicesAttr().Get(self._first)
        if holes is not None and len(holes):
            kept = ~np.isin(np.arange(len(counts)), np.asarray(holes))
        self.stored_faces = np.flatnonzero(kept)
        self.stored_corners = order[np.repeat(kept, counts)]
        return Polygons(corners[self.stored_corners], counts[kept])

    @property
    def left_handed(self) -> bool:
        """True if the stored faces are clockwise from outside, in the prim's own space."""
        return self._mesh.GetOrientationAttr().Get(self._first) == "leftHanded"

    def _world(self, time: Any) -> FloatArray:
        """Transform (4, 4) of the mesh, or of its skeleton, to the world; of rows."""
        owner = self.prim if self._skin is None or not self._skeleton else self._skeleton.GetPrim()
        cache = self._pxr.UsdGeom.XformCache(time)
        return np.array(cache.GetLocalToWorldTransform(owner), dtype=np.float64)

    def times(self) -> set[float]:
        """Time codes of the samples that move the points."""
        found = set(self._mesh.GetPointsAttr().GetTimeSamples())
        prim = self.prim
        while prim and not prim.IsPseudoRoot():
            if prim.IsA(self._pxr.UsdGeom.Xformable):
                found |= set(self._pxr.UsdGeom.Xformable(prim).GetTimeSamples())
            prim = prim.GetParent()
        animation = self._skeleton.GetAnimQuery() if self._skeleton else None
        if animation:
            if self._skin is not None:
                found |= set(animation.GetJointTransformTimeSamples())
            if self._blend is not None:
                found |= set(animation.GetBlendShapeWeightTimeSamples())
        return found

    def check_connectivity(self) -> None:
        """Raise InputError if the faces change over time."""
        attributes = (
            self._mesh.GetFaceVertexCountsAttr(),
            self._mesh.GetFaceVertexIndicesAttr(),
        )
        times = {time for attribute in attributes for time in attribute.GetTimeSamples()}
        first = self.faces(None)
        for time in sorted(times):
            if not all(map(np.array_equal, first, self.faces(time))):
                raise self._broken(f"other faces at time code {time:g} than at first")

    def shown_weights(self) -> FloatArray:
        """Weights (shapes,) of the blend shapes at the first time, in the mesh's order."""
        return self._weights(self._first) if self._blend is not None else np.zeros(0)

    def _weights(self, time: Any) -> FloatArray:
        animation = self._skeleton.GetAnimQuery() if self._skeleton else None
        weights = animation.ComputeBlendShapeWeights(time) if animation else None
        if weights is None:
            return np.zeros(len(self.shapes))
        return np.array(self._mapper.Remap(weights), dtype=np.float64)

    def vertices(self, time: float | None, weights: dict[str, float] | None) -> FloatArray:
        """Points (n, 3) in the world, at a time code.

        Args:
            time: the time code; None is the first.
            weights: of the blend shapes, by name; None for the stage's own.

        Raises:
            InputError: another number of points, or points that cannot be computed.
        """
        code = self._first if time is None else self._pxr.Usd.TimeCode(time)
        stored = self._mesh.GetPointsAttr().Get(code)
        if stored is None or len(stored) != self.count:
            raise self._broken(
                f"{len(stored or ())} points at time code {code}, expected {self.count}"
            )
        points = self._pxr.Vt.Vec3fArray(stored)
        if self._blend is not None:
            given = self._weights(code)
            if weights is not None:
                given = np.array([weights.get(name, 0.0) for name in self.shapes])
            if given.any():
                shares = self._blend.ComputeSubShapeWeights(self._pxr.Vt.FloatArray(given.tolist()))
                if not self._blend.ComputeDeformedPoints(
                    *shares, self._point_indices, self._offsets, points
                ):
                    raise self._broken("blend shapes that do not fit its points")
        if self._skin is not None and self._skeleton is not None:
            transforms = self._skeleton.ComputeSkinningTransforms(code)
            if transforms is None or not self._skin.ComputeSkinnedPoints(transforms, points, code):
                raise self._broken("a skeleton that does not fit its points")
        world = self._world(code)
        found = np.array(points, dtype=np.float64)
        if np.array_equal(world, np.eye(4)):
            return found
        return found @ world[:3, :3] + world[3, :3]

    def _broken(self, found: str) -> InputError:
        return InputError(f"{self._name}: has {found}; export it again")
