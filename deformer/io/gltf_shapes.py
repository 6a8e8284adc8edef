"""Shapes of a glTF file: its morph targets, or an animation at times of equal distance."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.geometry import FloatArray, MeshSequence, ShapeSequence, shape_sequence
from deformer.io.gltf import GltfAsset
from deformer.io.gltf_animation import Clip, clip_names, find_clip
from deformer.io.gltf_marks import clip_fps
from deformer.io.gltf_meshes import GltfScene
from deformer.io.polygons import Polygons
from deformer.io.sampling import check_room, frame_times, shows_a_shape
from deformer.workspace import Empty, in_memory

_log = logging.getLogger("deformer")
_DEFAULT_FPS = 24.0
# Numbers that are computed at once.
_CHUNK = 4_000_000


class GltfReader:
    """Reads each file of one sequence as one shape: as the file shows it, before it is animated.

    Node transforms, default weights of morph targets, and skins are applied.
    """

    def __init__(self) -> None:
        """Start a sequence."""
        self._told = False

    def __call__(self, data: bytes, name: str) -> tuple[FloatArray, Polygons]:
        """Vertices (V, 3) and triangles of a GLB or glTF file.

        Args:
            data: contents of the file.
            name: its path; buffers in files of their own are in its folder.

        Raises:
            InputError: as of `GltfScene`.
        """
        scene = GltfScene(GltfAsset(data, name, Path(name).parent))
        if scene.target_names and not self._told:
            self._told = True
            _log.warning(
                f"{name}: read as the file shows it, one shape; its {len(scene.target_names)} "
                "morph targets are shapes only where it is the only file"
            )
        vertices = scene.vertices(_rows(scene.default_weights()), {}, 1)[0]
        return vertices, Polygons.of_triangles(scene.faces)


def read_shapes(
    asset: GltfAsset, fps: float | None, clip: str | int | None, empty: Empty = in_memory
) -> ShapeSequence:
    """Shapes of one file.

    A clip of `deformer.save_shapes` whose morph targets are no shapes: its frames. With other morph
    targets: shape 0, "base", has all weights 0; then comes each target at weight 1; last
    "default", if the file shows other weights than 0. Without them, or with a clip: the animation,
    the first if none is named, at `fps` from its first key to its last. Without either: the mesh.

    Args:
        asset: the file.
        fps: frames a second; None is those of a clip of `deformer.save_shapes`, and 24 of others.
        clip: an animation's name or number; None as above.
        empty: makes the array of an animation's positions.

    Raises:
        InputError: as of `GltfScene`, an unknown clip, or one that moves no mesh.
    """
    scene = GltfScene(asset)
    clips = clip_names(asset)
    if clip is None:
        rates = (clip_fps(asset.item("animations", n, "the file")) for n in range(len(clips)))
        clip = next((n for n, rate in enumerate(rates) if rate is not None), None)
    if clip is not None:
        number = find_clip(asset, clip)
        found = Clip(scene, number)
        if not found.moves:
            raise InputError(
                f"{asset.name}: clip {found.name!r} moves no mesh, expected one that does of "
                f"{shortened(list(clips))}; give another, or export the animation with its meshes"
            )
        own = clip_fps(asset.item("animations", number, "the file"))
        return _sampled(scene, found, fps or own or _DEFAULT_FPS, empty)
    if scene.target_names:
        if clips:
            _log.warning(
                f"{asset.name}: read {len(scene.target_names)} morph targets and not its clips, "
                f"{shortened(list(clips))}; name one to read its frames"
            )
        return _targets(scene)
    for number in range(len(clips)):
        found = Clip(scene, number)
        if found.moves:
            if len(clips) > 1:
                _log.warning(
                    f"{asset.name}: read clip {found.name!r} of {shortened(list(clips))}; name "
                    "another to read that"
                )
            return _sampled(scene, found, fps or _DEFAULT_FPS, empty)
    return MeshSequence(scene.vertices({}, {}, 1), scene.faces)


def _targets(scene: GltfScene) -> MeshSequence:
    defaults = scene.default_weights()
    names = ("base", *scene.target_names, "default")
    N, V = len(names), scene.vertex_count
    check_room(
        N - 1, V, scene.asset.size, scene.asset.name, "morph targets", "export fewer of them"
    )
    vertices = np.empty((N, V, 3))
    vertices[0] = scene.vertices({}, {}, 1)[0]
    step = max(1, _CHUNK // (3 * V))
    for start in range(0, len(scene.target_names), step):
        block = scene.target_names[start : start + step]
        rows = slice(1 + start, 1 + start + len(block))
        vertices[rows] = scene.vertices(scene.weights_of(block), {}, len(block))
    vertices[-1] = scene.vertices(_rows(defaults), {}, 1)[0]
    weights = np.concatenate([np.ravel(w) for w in defaults.values()] or [np.zeros(0)])
    if not shows_a_shape(weights, vertices[-1], vertices[:-1]):
        return MeshSequence(vertices[:-1], scene.faces, names[:-1])
    _log.warning(
        f"{scene.asset.name}: its default weights are not 0; shape 0 has weights 0, and shape "
        f"{N - 1}, 'default', is as the file shows it"
    )
    return MeshSequence(vertices, scene.faces, names)


def _sampled(scene: GltfScene, clip: Clip, fps: float, empty: Empty) -> ShapeSequence:
    name = f"{scene.asset.name}, clip {shortened(clip.name)}"
    times = frame_times(clip.start, clip.end, fps, name)
    F, V = len(times), scene.vertex_count
    check_room(F, V, scene.asset.size, name, f"frames at {fps:g} a second", "give a lower fps")
    vertices = empty((F, V, 3))
    # A joint takes as much as four vertices.
    step = max(1, _CHUNK // (3 * V + 12 * len(scene.mesh_nodes)))
    resting = _rows(scene.default_weights())
    for start in range(0, F, step):
        block = times[start : start + step]
        weights = {node: np.tile(w, (len(block), 1)) for node, w in resting.items()}
        weights |= clip.weights(block)
        rows = slice(start, start + len(block))
        vertices[rows] = scene.vertices(weights, clip.moving(block), len(block))
    names = tuple(f"{clip.name} {time:.4g} s" for time in times)
    return shape_sequence(vertices, scene.faces, names)


def _rows(weights: dict[int, FloatArray]) -> dict[int, FloatArray]:
    return {node: row[None] for node, row in weights.items()}
