"""Parts of the unknowns are views: what is written to them is written to the vector."""

import numpy as np

from deformer.editing.unknowns import Unknowns


def test_join_is_the_inverse_of_the_parts():
    rng = np.random.default_rng(0)
    code, rotation, translation = (rng.normal(size=(4, n)) for n in (7, 3, 3))
    x = Unknowns.join(code, rotation, translation)
    assert x.shape == (4, 13)
    for parts, expected in ((Unknowns(x), slice(None)), (Unknowns(x[2]), 2)):
        np.testing.assert_array_equal(parts.code, code[expected])
        np.testing.assert_array_equal(parts.rotation, rotation[expected])
        np.testing.assert_array_equal(parts.translation, translation[expected])
    np.testing.assert_array_equal(Unknowns(x).motion, np.hstack([rotation, translation]))


def test_parts_write_to_the_vector():
    x = np.zeros(8)
    parts = Unknowns(x)
    parts.code, parts.rotation, parts.translation = np.ones(2), 2.0, np.array([3.0, 4.0, 5.0])
    parts.translation += 1.0
    parts.motion[0] = 9.0
    np.testing.assert_array_equal(x, [1, 1, 9, 2, 2, 4, 5, 6])
