"""Features round trip: a tube twisted twice around, its features, and the tube again.

Features store rotations as angles beyond half a turn. Half of the features is therefore about half
of the twist, whereas half of the displacement of every vertex is a pinched tube.
"""

import sys
from pathlib import Path

import numpy as np
from tube import tube, twisted_and_bent

import deformer
from deformer_app.rendering.sheets import save_rows


def main(picture: Path, quick: bool = False) -> float:
    """Write the picture; returns the largest error over the bounding diagonal."""
    rest = tube(12, 30) if quick else tube(32, 160)
    twisted = twisted_and_bent(rest.vertices, twist=4 * np.pi, bend=0.0)
    shapes = deformer.MeshSequence(np.stack([rest.vertices, twisted]), rest.faces)

    q = deformer.extract_features(shapes)  # (2, V, 9)
    again = deformer.reconstruct(shapes, q)  # (2, V, 3)
    half = deformer.reconstruct(shapes, 0.5 * (q[0] + q[1]))

    straight = shapes.vertices.mean(axis=0)
    titles = ["rest", "two turns", "from its features", "half of the features", "half of the way"]
    row = np.stack([*shapes.vertices, again[1], half, straight])
    save_rows(picture, {"": row}, rest.faces, "x", {"": titles})
    return float(abs(again - shapes.vertices).max() / rest.bounding_diagonal)


if __name__ == "__main__":
    print("largest error, share of the diagonal:", main(Path(sys.argv[1])))
