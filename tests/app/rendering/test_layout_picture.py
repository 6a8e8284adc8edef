"""Every handle of a layout has its number in a picture."""

import numpy as np

from deformer_app.rendering.layout_picture import numbered


def test_every_handle_is_numbered_where_it_is_seen_best():
    eyes = np.array([[0.0, 0, 9], [0, 0, -9]])
    normals = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [0.99, 0, -0.14]])
    shown = numbered(eyes, 0.1 * normals, normals)
    assert shown[:, 0].tolist() == [True, False] and shown[:, 1].tolist() == [False, True]
    assert shown[:, 2].any() and shown[:, 3].tolist() == [False, True]
