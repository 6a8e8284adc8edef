"""How well shapes come back from their codes, measured some shapes at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformer.geometry import FloatArray, ShapeSequence, align, vertex_errors
from deformer.model import DeformationModel
from deformer.workspace import blocks


def rebuilding(
    shapes: ShapeSequence, model: DeformationModel, indices: list[int]
) -> dict[str, Any]:
    """Entries of a model's summary about how its training shapes come back.

    Args:
        shapes: N training shapes, without seams.
        model: with their codes, and without seams; the connected components of its reference are
            the pieces.
        indices: (N,) indices of the training shapes.

    Returns:
        E_rms of all shapes; the shape whose centroid is farthest off, the shape that differs most
        besides, and where there are several pieces the first vertex of the piece that does; each
        with its distance (root mean square of the vertices') in bounding diagonals.
    """
    reference = model.reference
    diagonal = reference.bounding_diagonal
    of_vertices = np.zeros(len(reference.vertices))
    places, of_shapes = np.empty(len(shapes)), np.empty(len(shapes))
    for part in blocks(shapes.vertices):
        truth, rebuilt = shapes.vertices[part], model.decode(model.codes[part])
        places[part] = np.linalg.norm(truth.mean(axis=1) - rebuilt.mean(axis=1), axis=1)
        squares = vertex_errors(truth, rebuilt, "centroid") ** 2
        of_shapes[part] = squares.mean(axis=1)
        of_vertices += squares.sum(axis=0)
    place, worst = int(places.argmax()), int(of_shapes.argmax())
    entries = {
        "train_e_rms": _e_rms(of_shapes),
        "worst_place": indices[place],
        "worst_place_distance": float(places[place]) / diagonal,
        "worst_shape": indices[worst],
        "worst_shape_rms": float(np.sqrt(of_shapes[worst])) / diagonal,
    }
    if len(reference.links) == 0:
        return entries
    sums = np.bincount(reference.labels, weights=of_vertices / len(shapes))
    of_pieces = np.sqrt(sums / np.bincount(reference.labels)) / diagonal
    piece = int(of_pieces.argmax())
    return entries | {
        "worst_piece_vertex": int((reference.labels == piece).argmax()),
        "worst_piece_rms": float(of_pieces[piece]),
    }


def held_out_error(shapes: ShapeSequence, model: DeformationModel) -> float:
    """E_rms of test shapes, without seams, that `model` encodes and decodes."""
    squares = np.empty(len(shapes))
    for part in blocks(shapes.vertices):
        truth: FloatArray = shapes.vertices[part]
        if model.config.align:
            truth = align(truth, model.reference.vertices)
        rebuilt = model.decode(model.encode(truth))
        squares[part] = (vertex_errors(truth, rebuilt, "centroid") ** 2).mean(axis=1)
    return _e_rms(squares)


def _e_rms(squares: FloatArray) -> float:
    """E_rms from mean squared distances (N,), as of `geometry.e_rms`."""
    return 1000.0 * float(np.sqrt(squares.mean() / 3.0))
