"""Protocols: a trained method and shapes that it has not seen become errors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deformer.acap import FeatureExtractor, extract_all
from deformer.baselines import Method, Poser
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, align, e_rms, sted, sted_spatial

Errors = dict[str, float]

# Width, in degrees, of the classes of `by_rotation`.
ROTATION_CLASS = 30


def encoder_pass(method: Method, shapes: FloatArray) -> FloatArray:
    """Shapes (N, V, 3) through the method's codes and back, without a search."""
    return _checked(method, method.decode(method.encode(shapes)), shapes)


def best_fit(method: Method, shapes: FloatArray) -> FloatArray:
    """The shapes (N, V, 3) that the method can make which come closest to the given ones."""
    return _checked(method, method.decode(method.fit_codes(shapes)), shapes)


def reconstruction_errors(
    truth: FloatArray, estimate: FloatArray, faces: IntArray, ordered: bool
) -> Errors:
    """E_rms with centroids and with rigid motions aligned, and STED of shapes (N, V, 3).

    A reconstruction leaves the translation open, so each shape's centroid is aligned before STED's
    temporal part, too. Without an order of the shapes there is only STED's spatial part.
    """
    errors = {
        "E_rms": e_rms(truth, estimate),
        "E_rms_rigid": e_rms(truth, estimate, "rigid"),
    }
    centred = estimate + (truth.mean(axis=1) - estimate.mean(axis=1))[:, None]
    return errors | edge_errors(truth, centred, faces, ordered)


def edge_errors(truth: FloatArray, estimate: FloatArray, faces: IntArray, ordered: bool) -> Errors:
    """STED with its parts where the shapes are frames in order; else its spatial part."""
    if not ordered or len(truth) < 2:
        return {"STED_spatial": sted_spatial(truth, estimate, faces)}
    found = sted(truth, estimate, faces)
    return {
        "STED": found.value,
        "STED_spatial": found.spatial,
        "STED_temporal": found.temporal,
    }


def sparse_control(
    method: Poser,
    shapes: FloatArray,
    vertices: IntArray,
    faces: IntArray,
    ordered: bool = False,
    targets: FloatArray | None = None,
) -> Errors:
    """Recover whole shapes from a few control vertices; the method sees nothing else of them.

    Tan et al. 2018, sparse control. Nothing is aligned: the control vertices fix the frame.

    Args:
        method: trained on other shapes.
        shapes: (N, V, 3) unseen shapes.
        vertices: (H,) control vertices.
        faces: (F, 3), for STED.
        ordered: whether the shapes are frames in order.
        targets: (N, H, 3) where the control vertices are said to be, if not where they are.

    Returns:
        E_rms and STED over the shapes that the method gave a mesh for, the number of "failures",
        and of "shapes" in all.

    Raises:
        InputError: the method failed on every shape; the message is that of the first failure.
    """
    goals = shapes[:, vertices] if targets is None else targets
    poses: list[FloatArray] = []
    kept: list[int] = []
    first: Exception | None = None
    for n, target in enumerate(goals):
        try:
            pose = method.fit_handles(vertices, target.copy())
            poses.append(_checked(method, np.asarray(pose)[None], shapes[n][None])[0])
        # What a method may raise is its own affair: a failure is counted, and the run goes on.
        except Exception as error:
            first = first or error
            continue
        kept.append(n)
    if first is not None and not kept:
        raise InputError(f"failed on all {len(shapes)} shapes: {one_line(first)}") from first
    truth, estimate = shapes[kept], np.stack(poses)
    return {
        "E_rms": e_rms(truth, estimate, "none"),
        **edge_errors(truth, estimate, faces, ordered),
        "failures": len(shapes) - len(kept),
        "shapes": len(shapes),
    }


def largest_rotations(reference: Mesh, shapes: FloatArray) -> FloatArray:
    """The largest local rotation (N,) of shapes (N, V, 3) against the reference, in degrees.

    The rotation of a vertex's neighbourhood, continuous over the mesh and hence above 180° where
    it turns that far, once the rigid motion of the whole shape is taken out.
    """
    q = extract_all(FeatureExtractor(reference), align(shapes, reference.vertices))
    return np.degrees(np.linalg.norm(q[..., :3], axis=-1).max(axis=1))


def by_rotation(
    angles: FloatArray, truth: FloatArray, estimate: FloatArray
) -> Mapping[int, Errors]:
    """Errors of shapes in classes of their largest local rotation, by the upper bound in degrees.

    Args:
        angles: (N,) degrees.
        truth: (N, V, 3).
        estimate: (N, V, 3).
    """
    bounds = (np.maximum(np.ceil(angles / ROTATION_CLASS), 1) * ROTATION_CLASS).astype(int)
    classes = {}
    for bound in np.unique(bounds):
        chosen = bounds == bound
        classes[int(bound)] = {
            "E_rms": e_rms(truth[chosen], estimate[chosen]),
            "shapes": int(chosen.sum()),
        }
    return classes


def one_line(error: BaseException) -> str:
    """The kind and message of an exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _checked(method: Poser, estimate: FloatArray, truth: FloatArray) -> FloatArray:
    if np.shape(estimate) != truth.shape:
        raise InputError(f"{method.name}: gave shapes {np.shape(estimate)}, expected {truth.shape}")
    if not np.isfinite(estimate).all():
        raise InputError(f"{method.name}: gave positions that are not finite")
    return np.asarray(estimate, dtype=np.float64)
