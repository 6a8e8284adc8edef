"""Smooth skinning decomposition with rigid bones of a model's shapes (Le and Deng 2012)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from deformer.analysis import draw_codes
from deformer.checks import check_memory, checked_instance, checked_integer
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, farthest_rows
from deformer.model import DeformationModel
from deformer.rigging.clusters import RIGID, one_hot, rigid_parts, worst_patch
from deformer.rigging.matrices import Frame, translations, world_matrices
from deformer.rigging.neighbourhoods import (
    averaging,
    gathered,
    main_parts,
    surface_graph,
    within_reach,
)
from deformer.rigging.rigs import Rig
from deformer.rigging.skeleton import skeleton_of
from deformer.rigging.transforms import (
    fitted_transforms,
    moments,
    separate_transforms,
    skinned,
    skinning_errors,
)
from deformer.rigging.weights import fitted_weights

# Most training shapes and samples of the prior that a rig is fitted to; fewer for large meshes.
_EXAMPLES, _SAMPLES, _MOST_POSITIONS = 100, 50, 8_000_000
# The parts to begin with are those of fewer shapes.
_PART_SHAPES = 40
MOST_BONES, MOST_INFLUENCES = 1000, 16
# Alternations of weights and transforms; the last ones keep the bones where they are.
_ALTERNATIONS, _CLOSING = 80, 3
# Up to which alternation, and how often, bones take the place of those that were left out.
_LAST_NEW, _NEW_EVERY = 50, 5
# Passes over the bones in each alternation.
_SWEEPS = 5
# Relative decrease of the error below which alternations end.
_ENOUGH = 3e-4
# How far a bone's weights reach beyond its own vertices, in mean distances of bones.
_REACH = 2.0
# μ of the weights' smoothness, in mean squares of the distance between bones.
_SMOOTHNESS = 0.001
# Shapes of a clip that are decoded and fitted at once.
_BATCH = 32

Progress = Callable[[int, int], None]


def rig(
    model: DeformationModel,
    bones: int = 30,
    influences: int = 4,
    on_progress: Progress | None = None,
) -> Rig:
    """Bones and smooth weights that reproduce a model's shapes.

    The rig is fitted to decoded training codes and to samples of the prior, so that it follows the
    model and not the noise of its data: Le and Deng, "Smooth Skinning Decomposition with Rigid
    Bones", SIGGRAPH Asia 2012. Rigid parts of the surface (`rigid_parts`) are the first bones;
    weights (`fitted_weights`) and transforms (`fitted_transforms`) are then fitted in turn. A bone
    moves vertices near its own only, and its weights are connected over the surface.

    Args:
        model: the prior.
        bones: most bones, from 1 to 1000. There are fewer where fewer reproduce all shapes, or
            where one would move hardly a vertex.
        influences: most bones that move a vertex, from 1 to 16.
        on_progress: called with the steps done and their number.

    Returns:
        The rig, in the reference's pose; its clip are the decoded training shapes. The same model
        and numbers give the same rig.

    Raises:
        InputError: a number out of its range, or a model without faces that move.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    bones = checked_integer(bones, "bones", least=1, most=MOST_BONES)
    influences = checked_integer(influences, "influences", least=1, most=MOST_INFLUENCES)
    if on_progress is not None and not callable(on_progress):
        raise InputError("on_progress: expected a function of two numbers; give one, or None")
    mesh = model.closed.reference
    V, N = len(mesh.vertices), len(model.codes)
    check_memory(
        8 * (V * (8 * bones + 3 * 3 * _shape_count(V)) + N * bones * 32),
        f"bones: {bones} of {V} vertices and {N} training shapes",
    )
    total = bones + _ALTERNATIONS + _CLOSING + -(-N // _BATCH)
    steps = _Steps(on_progress, total)
    frame = Frame.of(mesh)
    shapes = frame.inward(model.closed.decode(_codes(model))).transpose(1, 0, 2).copy()
    found = _decompose(mesh, frame, shapes, bones, influences, steps)
    return _finished(model, frame, found, shapes, steps)


@dataclass
class _Steps:
    """Counts the steps of a run and reports them."""

    on_progress: Progress | None
    total: int
    done: int = 0

    def to(self, done: int) -> None:
        self.done = min(done, self.total)
        if self.on_progress is not None:
            self.on_progress(self.done, self.total)


def _shape_count(vertices: int) -> int:
    """Most shapes that a rig of so many vertices is fitted to."""
    return min(_EXAMPLES + _SAMPLES, max(24, _MOST_POSITIONS // vertices))


def _codes(model: DeformationModel) -> FloatArray:
    """Codes (n, K) to fit to: training codes far from each other, and samples of the prior."""
    count = _shape_count(len(model.reference.vertices))
    samples = count // 3
    whitened = np.linalg.solve(model.prior.factor, (model.codes - model.prior.mean).T).T
    spread, _ = farthest_rows(whitened, min(count - samples, len(whitened)))
    return np.concatenate([model.codes[np.sort(spread)], draw_codes(model, samples)])


def _decompose(
    mesh: Mesh,
    frame: Frame,
    shapes: FloatArray,
    bones: int,
    influences: int,
    steps: _Steps,
) -> FloatArray:
    """Weights (V, B) of a rig for shapes (V, N, 3) in the frame's units."""
    graph = surface_graph(mesh, frame.size)
    rest = frame.inward(mesh.vertices)
    smallest = max(4, len(rest) // (50 * bones))
    apart, _ = farthest_rows(
        shapes.transpose(1, 0, 2).reshape(shapes.shape[1], -1),
        min(_PART_SHAPES, shapes.shape[1]),
    )
    labels = rigid_parts(graph, rest, shapes[:, np.sort(apart)], bones, smallest, steps.to)
    spacing = np.sqrt(_area(mesh) / frame.size**2 / bones)
    reach = _REACH * max(float(spacing), float(graph.data.mean()))
    smoothness = _SMOOTHNESS * shapes.shape[1] * float(spacing) ** 2 + np.finfo(float).eps
    mean = averaging(graph)
    weights = one_hot(labels)
    T = fitted_transforms(moments(weights, rest, shapes))
    before, still = np.inf, 0
    for n in range(_ALTERNATIONS):
        steps.to(bones + n)
        near = within_reach(graph, _leading(graph, weights), weights.shape[1], reach)
        near[np.arange(len(near)), weights.argmax(axis=1)] = True
        weights = _weights(rest, shapes, T, near, influences, mean, weights, smoothness)
        weights, T = _without_small(graph, weights, T, smallest)
        T = fitted_transforms(moments(weights, rest, shapes), T, _SWEEPS)
        errors = skinning_errors(weights, rest, T, shapes)
        error = float(errors.mean())
        if weights.shape[1] < bones and n < _LAST_NEW and n % _NEW_EVERY == 0:
            new = _missing(graph, mean @ errors, smallest, bones, weights.shape[1])
            for patch in new:
                weights, T = _with_bone(weights, T, patch, rest, shapes)
            if new:
                before, still = np.inf, -_NEW_EVERY
                continue
        still = still + 1 if error > (1.0 - _ENOUGH) * before else 0
        before = min(before, error)
        if still >= 2 or error <= RIGID**2:
            break
    for n in range(_CLOSING):
        steps.to(bones + _ALTERNATIONS + n)
        weights, T = _without_small(graph, gathered(graph, weights), T, smallest)
        near = weights > 0
        weights = _weights(rest, shapes, T, near, influences, mean, weights, smoothness)
        T = fitted_transforms(moments(weights, rest, shapes), T, _SWEEPS)
    return gathered(graph, _without_small(graph, weights, T, smallest)[0])


def _area(mesh: Mesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].swapaxes(0, 1)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _leading(graph: sparse.csr_array, weights: FloatArray) -> IntArray:
    """The bone (V,) that moves each vertex most; −1 where that lies outside of its main part."""
    labels = weights.argmax(axis=1)
    own = one_hot(np.append(labels, weights.shape[1] - 1))[:-1]
    inside = main_parts(graph, own)[np.arange(len(labels)), labels]
    return np.where(inside, labels, -1)


def _weights(rest, shapes, T, near, influences, mean, weights, smoothness) -> FloatArray:
    smooth = mean @ (mean @ weights)
    return fitted_weights(rest, shapes, T, near, influences, smooth, smoothness)


def _without_small(
    graph: sparse.csr_array, weights: FloatArray, T: FloatArray, smallest: int
) -> tuple[FloatArray, FloatArray]:
    """Weights and transforms without the bones whose weights sum to less than `smallest`."""
    kept = weights.sum(axis=0) >= smallest
    if kept.all():
        return weights, T
    kept[weights.sum(axis=0).argmax()] = True
    weights = gathered(graph, weights[:, kept])
    return weights, T[:, kept]


def _missing(
    graph: sparse.csr_array, errors: FloatArray, smallest: int, bones: int, there: int
) -> list[IntArray]:
    """Patches of vertices where errors (V,) are largest, for the bones that are missing."""
    errors, found = errors.copy(), []
    for _ in range(bones - there):
        patch = worst_patch(graph, errors, smallest, bones)
        if patch is None:
            break
        found.append(patch)
        errors[patch] = 0.0
    return found


def _with_bone(
    weights: FloatArray, T: FloatArray, patch: IntArray, rest: FloatArray, shapes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weights and transforms with one more bone, which moves the vertices of a patch (n,) alone."""
    own = np.zeros((len(weights), 1))
    own[patch] = 1.0
    new = separate_transforms(moments(own, rest, shapes))
    return np.hstack([np.where(own > 0, 0.0, weights), own]), np.concatenate([T, new], axis=1)


def _finished(
    model: DeformationModel, frame: Frame, weights: FloatArray, shapes: FloatArray, steps: _Steps
) -> Rig:
    """The rig of weights (V, B): its skeleton, and its clip of all training shapes."""
    surface = model.closed
    rest = frame.inward(surface.reference.vertices)
    skeleton = skeleton_of(weights, rest, fitted_transforms(moments(weights, rest, shapes)))
    weights = np.ascontiguousarray(weights[:, skeleton.order])
    clip, square = [], 0.0
    for start in range(0, len(model.codes), _BATCH):
        steps.to(steps.total - -(-(len(model.codes) - start) // _BATCH))
        truth = frame.inward(surface.decode(surface.codes[start : start + _BATCH]))
        T = fitted_transforms(moments(weights, rest, truth.transpose(1, 0, 2)))
        away = (skinned(weights, rest, T) - truth) ** 2
        square += float(model.seams.open(away).sum())
        clip.append(frame.outward(T))
    steps.to(steps.total)
    V, N = len(model.reference.vertices), len(model.codes)
    rest_matrices = translations(frame.size * skeleton.joints + frame.centre)
    digits = len(str(len(rest_matrices) - 1))
    gaps = skeleton.gaps[1:]
    return Rig(
        reference=model.reference,
        weights=model.seams.open(weights),
        names=tuple(f"bone_{b:0{digits}}" for b in range(len(rest_matrices))),
        parents=skeleton.parents,
        rest=rest_matrices,
        clip=world_matrices(np.concatenate(clip), rest_matrices),
        error=1000.0 * frame.size * float(np.sqrt(square / (3 * V * N))),
        joint_gap=frame.size * float(np.sqrt((gaps**2).mean())) if len(gaps) else 0.0,
        seams=model.seams,
    )
