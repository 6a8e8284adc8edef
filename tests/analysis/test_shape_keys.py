"""Components as shape keys: on the path at each key, near it between keys, and in a GLB file."""

import numpy as np
import pytest

from deformer import InputError, Synthesis, component_keys, load_mesh, load_shapes
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model().with_component_names({1: "nod"})


def test_keys_are_shapes_of_the_component(model):
    keys = component_keys(model, [1, 2], 1e-2)
    synthesis = Synthesis(model)
    rest = model.decode(synthesis.start)
    assert set(keys.components) == {1, 2}
    for name, target, k, w in zip(
        keys.names, keys.targets, keys.components, keys.weights, strict=True
    ):
        np.testing.assert_allclose(rest + target, synthesis.shape({k: w}), atol=1e-5)
        assert name == f"{model.label(k)} {w:+.3g}"
    for k in (1, 2):
        own = sorted(w for c, w in zip(keys.components, keys.weights, strict=True) if c == k)
        assert own[0] == -1 and own[-1] == 1


def test_a_smaller_tolerance_has_more_keys_and_keeps_it(model):
    loose, tight = component_keys(model, ["nod"], 1.0), component_keys(model, ["nod"], 2e-4)
    assert len(loose.names) == 2 < len(tight.names) <= 24
    assert tight.errors[1] < loose.errors[1]
    assert tight.errors[1] <= 2e-4 or len(tight.names) == 24


def test_the_error_is_that_between_keys(model):
    keys = component_keys(model, [0], 1e-3)
    synthesis = Synthesis(model)
    rest = model.decode(synthesis.start)
    knots = np.array([0.0, *keys.weights])
    shapes = np.concatenate([rest[None], rest + keys.targets])
    order = np.argsort(knots)
    worst = 0.0
    for w in np.linspace(-1, 1, 49):
        n = int(np.clip(np.searchsorted(knots[order], w), 1, len(knots) - 1))
        a, b = order[n - 1], order[n]
        t = (w - knots[a]) / (knots[b] - knots[a])
        straight = (1 - t) * shapes[a] + t * shapes[b]
        worst = max(worst, np.linalg.norm(straight - synthesis.shape({0: w}), axis=1).max())
    assert abs(worst / model.reference.bounding_diagonal - keys.errors[0]) < 1e-5


def test_the_file_has_named_keys_and_a_clip_for_each_component(model, tmp_path):
    keys = component_keys(model, [1, 2], 1e-2)
    keys.save(tmp_path / "keys.glb")
    found = load_shapes(tmp_path / "keys.glb")
    assert found.names == ("base", *keys.names)
    synthesis = Synthesis(model)
    rest = model.decode(synthesis.start)
    np.testing.assert_allclose(found.vertices[0], rest, atol=1e-5)
    for shape, k, w in zip(found.vertices[1:], keys.components, keys.weights, strict=True):
        np.testing.assert_allclose(shape, synthesis.shape({k: w}), atol=1e-5)
    size = model.reference.bounding_diagonal
    # From 0 to 1, to −1 and to 0 in four seconds.
    clip = load_shapes(tmp_path / "keys.glb", clip="nod", fps=8).vertices
    assert len(clip) == 33
    for n, w in ((0, 0.0), (4, 0.5), (8, 1.0), (16, 0.0), (21, -0.625), (24, -1.0), (32, 0.0)):
        far = np.linalg.norm(clip[n] - synthesis.shape({1: w}), axis=1).max()
        assert far <= (keys.errors[1] + 1e-4) * size, (n, w)
    assert load_shapes(tmp_path / "keys.glb", clip="component 2").names[0] == "component 2 0 s"
    np.testing.assert_array_equal(load_mesh(tmp_path / "keys.glb").faces, model.reference.faces)


def test_wrong_components_are_refused(model):
    with pytest.raises(InputError, match="components"):
        component_keys(model, 3)  # pyright: ignore
    with pytest.raises(InputError, match="99"):
        component_keys(model, [99])
