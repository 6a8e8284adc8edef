"""Sequences as Blender and three.js play them: clips, point caches, time samples, shape keys."""

import numpy as np
import pytest

import deformer
import tubes
from deformer import MeshSequence
from shapes import small_model
from upright import upright

FRAMES = 13
TOLERANCE = 1e-3  # of clips


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """A tube that bends, and the document of its OBJ file."""
    folder = tmp_path_factory.mktemp("tube")
    (folder / "tube.obj").write_bytes(tubes.obj())
    (folder / "tube.mtl").write_text(tubes.LIBRARY)
    document = deformer.load_document(folder / "tube.obj")
    assert document is not None
    bends = np.linspace(0, 1.2, FRAMES)
    return MeshSequence([tubes.positions(bend) for bend in bends], document.faces), document


def assert_same_places(found, expected, tolerance):
    """Vertices that a format has split lie at those of the mesh, and none is missing."""
    assert len(found) == len(expected)
    for shape, other in zip(found, expected, strict=True):
        apart = np.linalg.norm(shape[:, None] - other, axis=2)
        reach = tolerance * np.linalg.norm(np.ptp(expected[0], axis=0))
        assert apart.min(axis=1).max() < reach and apart.min(axis=0).max() < reach


@pytest.mark.parametrize("fps", [24.0, 30.0])
def test_a_clip(sequence, fps, tmp_path, blender, three, validated):
    shapes, document = sequence
    path = tmp_path / "bend.glb"
    saved = deformer.save_shapes(path, shapes, like=document, fps=fps, tolerance=TOLERANCE)
    assert saved.targets is not None and saved.targets < FRAMES - 1
    validated(path)
    chosen = [0, 5, FRAMES - 1]
    expected = shapes.vertices[chosen]
    assert_same_places(three(path, [n / fps for n in chosen]), expected, 1.1 * TOLERANCE)
    # Blender imports at the frame rate of the scene, 24.
    found = blender(path, [24 * n / fps for n in chosen])
    assert_same_places(found.vertices, upright(expected), 1.1 * TOLERANCE)
    assert found.mesh["materials"] == ["skin", "steel"] and len(found.mesh["uv"]) == 1
    assert len(found.mesh["shape_keys"]) == saved.targets + 1


@pytest.mark.parametrize("suffix", [".mdd", ".pc2"])
def test_a_point_cache_on_its_mesh(sequence, suffix, tmp_path, blender):
    shapes, document = sequence
    path = tmp_path / f"bend{suffix}"
    deformer.save_shapes(path, shapes, like=document, fps=24)
    base = tmp_path / "bend.obj"
    assert base.is_file()
    chosen = [0, 5, FRAMES - 1]
    found = blender(path, chosen, base)
    # The mesh is imported upright, and the cache plays in the mesh's own coordinates.
    scale = np.linalg.norm(np.ptp(shapes.vertices[0], axis=0))
    assert np.abs(found.vertices - upright(shapes.vertices[chosen])).max() < 1e-5 * scale


def test_time_samples(sequence, tmp_path, blender):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    shapes, document = sequence
    path = tmp_path / "bend.usdc"
    deformer.save_shapes(path, shapes, like=document, fps=24)
    chosen = [0, 5, FRAMES - 1]
    found = blender(path, chosen)
    scale = np.linalg.norm(np.ptp(shapes.vertices[0], axis=0))
    assert np.abs(found.vertices - upright(shapes.vertices[chosen])).max() < 1e-5 * scale
    assert sorted(found.mesh["faces"]) == [4] * 32 + [8] * 2
    assert set(found.mesh["materials"]) == {"skin", "steel"} and len(found.mesh["uv"]) == 1


def test_components_as_shape_keys(tmp_path, blender, validated):
    """Key by key: each is the component's shape at its weight."""
    model = small_model()
    keys = deformer.component_keys(model, [2, 0], tolerance=2e-3)
    keys.save(tmp_path / "keys.glb")
    validated(tmp_path / "keys.glb")
    found = blender(tmp_path / "keys.glb").mesh
    assert found["shape_keys"][1:] == list(keys.names)
    synthesis = deformer.Synthesis(model)
    scale = model.reference.bounding_diagonal
    rest = upright(synthesis.shape({}))
    for name, k, weight in zip(keys.names, keys.components, keys.weights, strict=True):
        offset = np.array(found["key_shapes"][name]) - np.array(found["base_shape"])
        expected = upright(synthesis.shape({k: weight})) - rest
        assert np.abs(offset - expected).max() < 1e-5 * scale
