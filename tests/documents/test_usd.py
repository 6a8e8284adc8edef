"""USD files, as the library of the format reads them."""

import sys

import numpy as np
import pytest

import tubes
from deformer import (
    InputError,
    MeshSequence,
    check_mesh_output,
    load_document,
    load_mesh,
    load_shapes,
    save_mesh,
    save_shapes,
)

Usd = pytest.importorskip("pxr.Usd", reason="needs usd-core, the extra usd")
UsdGeom = pytest.importorskip("pxr.UsdGeom")
UsdShade = pytest.importorskip("pxr.UsdShade")
UsdValidation = pytest.importorskip("pxr.UsdValidation", reason="needs a newer usd-core")

SUFFIXES = (".usd", ".usda", ".usdc")


@pytest.fixture
def tube(tmp_path):
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    return tmp_path / "tube.obj"


@pytest.fixture
def shapes(tube):
    vertices = np.stack([tubes.positions(bend) for bend in (0.0, 0.5, 1.0)])
    return MeshSequence(vertices, load_mesh(tube).faces)


def opened(path):
    """Stage and mesh of a file in which the validators find nothing wrong."""
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in found] == []
    (mesh,) = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    return stage, UsdGeom.Mesh(mesh)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_sequence_has_time_samples(tmp_path, tube, shapes, suffix):
    path = tmp_path / f"walk{suffix}"
    save_shapes(path, shapes, like=tube, fps=30, up="z")
    stage, mesh = opened(path)
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 2)
    assert stage.GetDefaultPrim().GetName() == "walk"
    assert mesh.GetPointsAttr().GetTimeSamples() == [0, 1, 2]
    for code, shape in enumerate(shapes.vertices):
        points = np.array(mesh.GetPointsAttr().Get(code))
        np.testing.assert_array_equal(points, shape.astype("f4"))
        extent = np.array(mesh.GetExtentAttr().Get(code))
        np.testing.assert_array_equal(extent, [points.min(axis=0), points.max(axis=0)])
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    np.testing.assert_array_equal(load_shapes(path).vertices, shapes.vertices.astype("f4"))
    np.testing.assert_array_equal(load_shapes(path).faces, shapes.faces)


def test_polygons_and_attributes_are_the_documents(tmp_path, tube, shapes):
    save_shapes(tmp_path / "walk.usda", shapes, like=tube)
    _, mesh = opened(tmp_path / "walk.usda")
    document = load_document(tube)
    assert document is not None
    known = document.polygons()
    np.testing.assert_array_equal(mesh.GetFaceVertexCountsAttr().Get(), known.counts)
    np.testing.assert_array_equal(mesh.GetFaceVertexIndicesAttr().Get(), known.corners)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    assert known.uvs is not None and known.colours is not None and known.normals is not None
    uvs = np.array(primvars.GetPrimvar("st").ComputeFlattened())
    np.testing.assert_allclose(uvs, np.nan_to_num(known.uvs), atol=1e-6)
    # sRGB of 0.5 is 0.214 in linear light.
    colours = np.array(primvars.GetPrimvar("displayColor").Get())
    np.testing.assert_allclose(colours[:, 1], 0.2140, atol=1e-4)
    for code in range(3):
        normals = np.array(primvars.GetPrimvar("normals").ComputeFlattened(code))
        goal = known.shading(shapes.vertices[code])[known.normals]
        np.testing.assert_allclose(normals, goal, atol=1e-6)
    subsets = UsdShade.MaterialBindingAPI(mesh).GetMaterialBindSubsets()
    found = {}
    for subset in subsets:
        material = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
        colour = material.ComputeSurfaceSource()[0].GetInput("diffuseColor").Get()
        found[material.GetPrim().GetName()] = (list(subset.GetIndicesAttr().Get()), colour)
    assert found["skin"][0] == list(range(32)) and found["steel"][0] == [32, 33]
    np.testing.assert_allclose(found["skin"][1], document.colours["skin"][:3], atol=1e-6)


def test_one_mesh_has_no_times(tmp_path, tube, shapes):
    save_mesh(tmp_path / "pose.usda", shapes.mesh(1), like=tube, up="z")
    stage, mesh = opened(tmp_path / "pose.usda")
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert not stage.HasAuthoredTimeCodeRange() and not mesh.GetPointsAttr().GetTimeSamples()
    np.testing.assert_array_equal(mesh.GetPointsAttr().Get(), shapes.vertices[1].astype("f4"))


def test_without_a_document_there_are_triangles_alone(tmp_path, shapes):
    save_mesh(tmp_path / "3 poses.usdc", shapes.mesh(0))
    _, mesh = opened(tmp_path / "3 poses.usdc")
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    np.testing.assert_array_equal(corners, shapes.faces)
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    assert not UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").IsDefined()
    # The name is no identifier; programs show the one that people gave.
    assert mesh.GetPrim().GetDisplayName() == "3 poses"


def test_names_that_are_no_unicode_are_written(tmp_path, shapes):
    save_shapes(tmp_path / "walk.usda", shapes, name="a\udcff b")
    stage, mesh = opened(tmp_path / "walk.usda")
    assert stage and mesh.GetPrim().GetDisplayName() == "a? b"


def test_names_do_not_collide(tmp_path, tube, shapes):
    save_mesh(tmp_path / "materials.usda", shapes.mesh(0), like=tube)
    stage, _ = opened(tmp_path / "materials.usda")
    assert sum(prim.IsA(UsdShade.Material) for prim in stage.Traverse()) == 2


def test_without_the_library_one_line_says_what_to_install(tmp_path, shapes, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    for call in (
        lambda: save_mesh(tmp_path / "a.usda", shapes.mesh(0)),
        lambda: save_shapes(tmp_path / "a.usda", shapes),
        lambda: check_mesh_output(tmp_path / "a.usda"),
    ):
        with pytest.raises(InputError, match=r'a.usda: .* pip install "deformer\[usd\]"'):
            call()
    assert not list(tmp_path.glob("*a*.usd*"))


def test_positions_beyond_single_precision_are_refused(tmp_path, shapes):
    far = MeshSequence(shapes.vertices * 1e45, shapes.faces)
    with pytest.raises(InputError, match="single-precision"):
        save_shapes(tmp_path / "walk.usda", far)
    assert not list(tmp_path.glob("*walk*"))


def test_a_mesh_may_be_named_for_any_of_the_formats(tmp_path):
    for suffix in (".obj", ".glb", *SUFFIXES):
        check_mesh_output(tmp_path / f"a{suffix}")
    with pytest.raises(InputError, match=r"got suffix '.fbx', expected one of .obj"):
        check_mesh_output(tmp_path / "a.fbx")
