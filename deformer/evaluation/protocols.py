"""Protocols: the errors of a trained method on unseen shapes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deformer.acap import FeatureExtractor, extract_all
from deformer.baselines import ComponentMethod, PosingMethod
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, align, e_rms, sted, sted_spatial

Errors = dict[str, float]

# Width, in degrees, of the classes of `errors_by_rotation`.
ROTATION_CLASS = 30


def encoder_pass(method: ComponentMethod, shapes: FloatArray) -> FloatArray:
    """Reconstructions (N, V, 3) of shapes (N, V, 3) by `encode` and `decode`."""
    return _checked(method, method.decode(method.encode(shapes)), shapes)


def best_fit(method: ComponentMethod, shapes: FloatArray) -> FloatArray:
    """The decodable shapes (N, V, 3) closest to shapes (N, V, 3), by `fit_codes`."""
    return _checked(method, method.decode(method.fit_codes(shapes)), shapes)


def reconstruction_errors(
    truth: FloatArray, estimate: FloatArray, faces: IntArray, ordered: bool
) -> Errors:
    """E_rms with centroids and with rigid motions aligned, and STED (Váša and Skala 2011).

    Reconstruction leaves the translation open, so centroids are aligned before STED's temporal
    part, too.

    Args:
        truth: (N, V, 3) true shapes.
        estimate: (N, V, 3) reconstructions.
        faces: (F, 3) int64.
        ordered: true when the shapes are frames in order; otherwise STED has only its spatial part.
    """
    errors = {
        "E_rms": e_rms(truth, estimate),
        "E_rms_rigid": e_rms(truth, estimate, "rigid"),
    }
    centred = estimate + (truth.mean(axis=1) - estimate.mean(axis=1))[:, None]
    return errors | sted_errors(truth, centred, faces, ordered)


def sted_errors(truth: FloatArray, estimate: FloatArray, faces: IntArray, ordered: bool) -> Errors:
    """STED and its two parts if the shapes are frames in order, else its spatial part alone."""
    if not ordered or len(truth) < 2:
        return {"STED_spatial": sted_spatial(truth, estimate, faces)}
    found = sted(truth, estimate, faces)
    return {
        "STED": found.value,
        "STED_spatial": found.spatial,
        "STED_temporal": found.temporal,
    }


def sparse_control(
    method: PosingMethod,
    shapes: FloatArray,
    vertices: IntArray,
    faces: IntArray,
    ordered: bool = False,
    targets: FloatArray | None = None,
    noise: float = 0.0,
) -> Errors:
    """Errors of whole shapes that a method recovers from a few control vertices alone.

    Tan et al. 2018, sparse control. Nothing is aligned: the control vertices fix the frame.

    Args:
        method: trained on other shapes.
        shapes: (N, V, 3) unseen shapes.
        vertices: (H,) int64 control vertices.
        faces: (F, 3) int64, for STED.
        ordered: true when the shapes are frames in order.
        targets: (N, H, 3) positions given to the method; None gives the true ones.
        noise: standard deviation of their coordinates, in the data's units, which the method is
            told.

    Returns:
        E_rms and STED over the shapes on which the method succeeded, the number of "failures", and
        the number of "shapes" in all.

    Raises:
        InputError: the method failed on every shape; the message is that of the first failure.
    """
    goals = shapes[:, vertices] if targets is None else targets
    poses: list[FloatArray] = []
    kept: list[int] = []
    first: Exception | None = None
    for n, target in enumerate(goals):
        try:
            pose = method.fit_handles(vertices, target.copy(), noise)
            poses.append(_checked(method, np.asarray(pose)[None], shapes[n][None])[0])
        # A method may raise anything: the failure is counted, and the run continues.
        except Exception as error:
            first = first or error
            continue
        kept.append(n)
    if first is not None and not kept:
        raise InputError(f"failed on all {len(shapes)} shapes: {one_line(first)}") from first
    truth, estimate = shapes[kept], np.stack(poses)
    return {
        "E_rms": e_rms(truth, estimate, "none"),
        **sted_errors(truth, estimate, faces, ordered),
        "failures": len(shapes) - len(kept),
        "shapes": len(shapes),
    }


def largest_rotations(reference: Mesh, shapes: FloatArray) -> FloatArray:
    """The largest local rotation (N,), in degrees, of shapes (N, V, 3) against the reference.

    A local rotation is that of a vertex's one-ring after the rigid motion of the whole shape is
    removed. It is continuous over the mesh, so that it exceeds 180° where parts turn that far.
    """
    q = extract_all(FeatureExtractor(reference), align(shapes, reference.vertices))
    return np.degrees(np.linalg.norm(q[..., :3], axis=-1).max(axis=1))


def errors_by_rotation(
    angles: FloatArray, truth: FloatArray, estimate: FloatArray
) -> Mapping[int, Errors]:
    """Errors of shapes by class of their largest local rotation; keys are upper bounds in degrees.

    Args:
        angles: (N,) largest local rotations in degrees.
        truth: (N, V, 3) true shapes.
        estimate: (N, V, 3) reconstructions.
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
    """Type and message of an exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _checked(method: PosingMethod, estimate: FloatArray, truth: FloatArray) -> FloatArray:
    if np.shape(estimate) != truth.shape:
        raise InputError(f"{method.name}: gave shapes {np.shape(estimate)}, expected {truth.shape}")
    if not np.isfinite(estimate).all():
        raise InputError(f"{method.name}: gave positions that are not finite")
    return np.asarray(estimate, dtype=np.float64)
