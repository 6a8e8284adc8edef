"""Animations of glTF at given times: transforms of nodes and weights of morph targets."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.gltf import FLOAT, INTEGERS, GltfAsset
from deformer.io.gltf_meshes import GltfScene
from deformer.io.gltf_nodes import composed, translation_rotation_scale
from deformer.io.parsing import distinct

_SHAPES = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")


def clip_names(asset: GltfAsset) -> tuple[str, ...]:
    """Names of the animations of an asset; those without a name have a number."""
    found = []
    for n in range(len(asset.part(asset.json, "animations", [], "the file"))):
        name = asset.item("animations", n, "the file").get("name")
        found.append(name if isinstance(name, str) and name.strip() else f"clip {n}")
    return distinct(found)


def find_clip(asset: GltfAsset, clip: str | int) -> int:
    """Number of an animation, given by name, by number, or by its number as text.

    Raises:
        InputError: there is none of that name.
    """
    names = clip_names(asset)
    if isinstance(clip, str) and clip in names:
        return names.index(clip)
    number = int(clip) if isinstance(clip, int) or (clip.isdecimal() and len(clip) < 9) else -1
    if 0 <= number < len(names):
        return number
    has = f"expected one of {shortened(list(names))}" if names else "and the file has none"
    raise InputError(f"{asset.name}: no clip {shortened(clip)}, {has}; give a clip that is there")


class Clip:
    """One animation: what it moves, and how.

    `start` and `end` are the times of its first and last key, in seconds.
    """

    def __init__(self, scene: GltfScene, index: int) -> None:
        """Read the channels that move the scene's meshes; others are left out.

        Raises:
            InputError: broken channels or samplers.
        """
        asset = self._asset = scene.asset
        self.name = clip_names(asset)[index]
        animation = asset.item("animations", index, "the file")
        label = f"animation {index}"
        matter = {i for node in scene.mesh_nodes for i in scene.tree.path(node)}
        weighted = scene.target_counts()
        samplers = asset.part(animation, "samplers", [], label)
        self._samplers: dict[tuple[int, str], _Sampler] = {}
        for c, channel in enumerate(asset.part(animation, "channels", [], label)):
            name = f"{label} channel {c}"
            if not isinstance(channel, dict):
                raise asset.broken(f"{name} is no object")
            target = asset.part(channel, "target", {}, name)
            node, path = target.get("node"), target.get("path")
            if path not in _SHAPES or node is None:
                continue  # an extension's, such as of materials
            asset.item("nodes", node, name)
            if node not in (weighted if path == "weights" else matter):
                continue
            number = channel.get("sampler")
            if (
                type(number) is not int
                or not 0 <= number < len(samplers)
                or not isinstance(samplers[number], dict)
            ):
                raise asset.broken(f"{name} has sampler {number!r} of {len(samplers)}"[:120])
            if path != "weights" and "matrix" in asset.item("nodes", node, name):
                raise asset.broken(f"{name} moves node {node}, which has a matrix")
            if (node, path) in self._samplers:
                raise asset.broken(f"{name} moves the {path} of node {node} a second time")
            width = weighted[node] if path == "weights" else 1
            self._samplers[node, path] = _Sampler(asset, samplers[number], path, width, name)
        self.start = min((s.times[0] for s in self._samplers.values()), default=0.0)
        self.end = max((s.times[-1] for s in self._samplers.values()), default=0.0)

    @property
    def moves(self) -> bool:
        """True if the animation moves a mesh."""
        return bool(self._samplers)

    def weights(self, times: FloatArray) -> dict[int, FloatArray]:
        """Weights (F, T) of morph targets at times (F,), by node."""
        return {
            node: sampler.at(times)
            for (node, path), sampler in self._samplers.items()
            if path == "weights"
        }

    def moving(self, times: FloatArray) -> dict[int, FloatArray]:
        """Local transforms (F, 4, 4) at times (F,) of the nodes that move."""
        found = {}
        for node in dict.fromkeys(node for node, path in self._samplers if path != "weights"):
            parts = [
                self._samplers[node, path].at(times)
                if (node, path) in self._samplers
                else np.broadcast_to(rest, (len(times), len(rest)))
                for path, rest in zip(
                    ("translation", "rotation", "scale"),
                    translation_rotation_scale(self._asset, node),
                    strict=True,
                )
            ]
            found[node] = composed(*parts)
        return found


class _Sampler:
    """Keys of one channel."""

    def __init__(self, asset: GltfAsset, sampler: dict, path: str, width: int, label: str) -> None:
        """Read the keys.

        Args:
            asset: the file.
            sampler: the JSON's object.
            path: "translation", "rotation", "scale" or "weights".
            width: rows of the accessor for one key.
            label: the channel, for messages.
        """
        self._turns = path == "rotation"
        self.interpolation: Any = sampler.get("interpolation", "LINEAR")
        if self.interpolation not in _INTERPOLATIONS:
            raise asset.broken(f"{label} has interpolation {self.interpolation!r}"[:120])
        self.times = asset.floats(sampler.get("input"), "SCALAR", FLOAT, label).ravel()
        if self.times[0] < 0 or (np.diff(self.times) <= 0).any():
            raise asset.broken(f"{label} has times that do not grow from 0 on")
        values = asset.floats(sampler.get("output"), _SHAPES[path], FLOAT | INTEGERS, label)
        keys = 3 if self.interpolation == "CUBICSPLINE" else 1
        if len(values) != len(self.times) * keys * width:
            raise asset.broken(
                f"{label} has {len(values)} values for {len(self.times)} times, expected "
                f"{len(self.times) * keys * width}"
            )
        # (keys, 3, n) for splines: tangent before, value, tangent after; else (keys, 1, n).
        self._values = values.reshape(len(self.times), keys, -1)
        if self._turns:
            lengths = np.linalg.norm(self._values[:, keys // 2], axis=1)
            if (abs(lengths - 1) > 0.05).any():
                raise asset.broken(f"{label} has a rotation that is no unit quaternion")

    def at(self, times: FloatArray) -> FloatArray:
        """Values (F, n) at times (F,); before the first key and after the last they stay."""
        keys, values = self.times, self._values
        middle = values.shape[1] // 2
        after: IntArray = np.clip(np.searchsorted(keys, times, side="right"), 1, len(keys) - 1)
        if len(keys) == 1:
            return np.broadcast_to(values[0, middle], (len(times), values.shape[2]))
        before = after - 1
        span = keys[after] - keys[before]
        t = np.clip((times - keys[before]) / span, 0.0, 1.0)[:, None]
        a, b = values[before, middle], values[after, middle]
        if self.interpolation == "STEP":
            found = np.where(t < 1, a, b)
        elif self.interpolation == "LINEAR":
            found = _slerp(a, b, t) if self._turns else (1 - t) * a + t * b
        else:
            # glTF 2.0, appendix C.5, with tangents scaled by the time between the keys.
            out, into = span[:, None] * values[before, 2], span[:, None] * values[after, 0]
            found = (2 * t**3 - 3 * t**2 + 1) * a + (t**3 - 2 * t**2 + t) * out
            found += (3 * t**2 - 2 * t**3) * b + (t**3 - t**2) * into
        if self._turns:
            found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)
        return found


def _slerp(a: FloatArray, b: FloatArray, t: FloatArray) -> FloatArray:
    """Spherical interpolation (F, 4) of quaternions by t (F, 1), the shorter way around."""
    cosine = np.sum(a * b, axis=1, keepdims=True)
    b, cosine = np.where(cosine < 0, -b, b), np.minimum(abs(cosine), 1.0)
    angle = np.arccos(cosine)
    small = angle < 1e-6
    sine = np.where(small, 1.0, np.sin(angle))
    weights = np.where(small, 1 - t, np.sin((1 - t) * angle) / sine)
    return weights * a + np.where(small, t, np.sin(t * angle) / sine) * b
