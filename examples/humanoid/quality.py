"""Quality of a posed skin: stretch of edges, volume, folds, limbs inside the rest of the body."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from numpy.typing import NDArray

from humanoid.body import Body

FOLD = np.cos(np.deg2rad(150))
LIMBS = {
    "arm.L": ("upperarm", "lowerarm", "wrist", "finger", "metacarpal"),
    "leg.L": ("upperleg", "lowerleg", "foot", "toe"),
}


@dataclass(frozen=True)
class Report:
    """Quality of one posed mesh.

    Args:
        shortest: 1st percentile of edge length posed / rest.
        longest: 99th percentile of the same.
        volume: volume posed / rest.
        folds: neighbouring faces whose normals are over 150° apart, and are not so at rest.
        inside: forearm, hand, shank and foot vertices inside the rest of the body.
    """

    shortest: float
    longest: float
    volume: float
    folds: int
    inside: int

    def sound(self) -> bool:
        """Whether the pose may enter the set."""
        stretch = self.shortest > 0.45 and self.longest < 1.8
        return stretch and 0.93 < self.volume < 1.07 and self.folds <= 8 and self.inside <= 12


class Inspector:
    """Compares posed vertices with the reduced mesh at rest."""

    def __init__(self, body: Body, faces: NDArray, kept: NDArray) -> None:
        """Take the reduced mesh: `faces` over the vertices `kept` of `body`."""
        self.faces, self.rest = faces, body.vertices[kept]
        half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        owner = np.tile(np.arange(len(faces)), 3)
        order = np.lexsort(np.sort(half, 1).T[::-1])
        self.edges = np.sort(half, 1)[order][::2]
        self.pairs = owner[order].reshape(-1, 2)
        self.rest_lengths = self._lengths(self.rest)
        self.rest_volume = self._volume(self.rest)
        self.rest_folds = self._folded(self.rest)
        self.parts = []
        weights = body.weights[kept]
        for name, prefixes in LIMBS.items():
            for side in "LR":
                bones = [b.startswith(prefixes) and b.endswith(side) for b in body.labels]
                share = weights[:, bones].sum(1)
                solid = faces[share[faces].max(1) < 0.5]
                far = [b.startswith(prefixes[1:]) and b.endswith(side) for b in body.labels]
                tips = np.flatnonzero(weights[:, far].sum(1) > 0.9)
                self.parts.append((name[:3] + "." + side, solid, tips))

    def _lengths(self, points: NDArray) -> NDArray:
        return np.linalg.norm(points[self.edges[:, 0]] - points[self.edges[:, 1]], axis=1)

    def _volume(self, points: NDArray) -> float:
        a, b, c = points[self.faces].transpose(1, 0, 2)
        return float((a * np.cross(b, c)).sum() / 6)

    def _folded(self, points: NDArray) -> NDArray:
        a, b, c = points[self.faces].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return (normal[self.pairs[:, 0]] * normal[self.pairs[:, 1]]).sum(1) < FOLD

    def inside(self, points: NDArray) -> int:
        """Count forearm, hand, shank and foot vertices inside the body without that limb."""
        total = 0
        for _, solid, tips in self.parts:
            winding = igl.fast_winding_number(points, solid, points[tips])
            total += int((winding > 0.5).sum())
        return total

    def report(self, points: NDArray) -> Report:
        """Measure one posed mesh (V, 3)."""
        low, high = np.percentile(self._lengths(points) / self.rest_lengths, [1, 99])
        folds = int((self._folded(points) & ~self.rest_folds).sum())
        volume = self._volume(points) / self.rest_volume
        return Report(float(low), float(high), volume, folds, self.inside(points))
