"""USD files as documents: what stays, what changes, and what other formats get."""

import subprocess
import sys

import numpy as np
import pytest

import deformer
from deformer import InputError, Mesh, MeshSequence, load_document, load_shapes, save_mesh
from deformer.documents.obj import ObjFile
from deformer.documents.ply import ply_polygons
from deformer.io import GltfAsset
from foreign import as_other_programs_read

pytest.importorskip("pxr.Usd", reason="needs usd-core, the extra usd")
Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, Vt = (
    pytest.importorskip(f"pxr.{name}")
    for name in ("Gf", "Sdf", "Usd", "UsdGeom", "UsdShade", "UsdSkel", "Vt")
)

# A box of quads, an edge of which is 2 long; the last face is hard, the others are smooth.
BOX = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
QUADS = [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]]


def material(stage, path, name, colour):
    made = UsdShade.Material.Define(stage, f"{path}/{name}")
    shader = UsdShade.Shader.Define(stage, f"{path}/{name}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*colour))
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    made.CreateSurfaceOutput().ConnectToSource(output)
    return made


def corner_normals(points):
    """Normals (24, 3): at the last face its own, elsewhere the mean of the other faces'."""
    mesh = deformer.Mesh(points, np.array(QUADS)[:, :3])
    a, b, c = (points[mesh.faces[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    own /= np.linalg.norm(own, axis=1)[:, None]
    sums = np.zeros((8, 3))
    for face, normal in zip(QUADS[:5], own, strict=False):
        sums[face] += normal
    smooth = sums / np.linalg.norm(sums, axis=1)[:, None]
    return np.concatenate([*(smooth[face] for face in QUADS[:5]), np.repeat(own[5:], 4, axis=0)])


def box(stage, path, normals="primvar"):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(np.ravel(QUADS).tolist())
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(BOX.astype("f4")))
    mesh.CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
    mesh.CreateSubdivisionSchemeAttr("none")
    values = Vt.Vec3fArray.FromNumpy(corner_normals(BOX).astype("f4"))
    if normals == "primvar":
        kinds = Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", *kinds)
        primvar.Set(values)
        primvar.SetIndices(list(range(24)))
    else:
        mesh.CreateNormalsAttr(values)
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    st.SetIndices([0, 1, 2, 3] * 6)
    return mesh


@pytest.fixture
def scene(tmp_path):
    """A stage in centimetres, z up: a turned and scaled box that moves, and a mirrored one."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(24)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    world.AddTranslateOp().Set((10, 20, 30))
    crate = UsdGeom.Xform.Define(stage, "/World/Crate")
    crate.AddRotateXYZOp().Set((30, 40, 50))
    scale = crate.AddScaleOp()
    scale.Set((1, 2, 3), 1)
    scale.Set((2, 2, 3), 5)
    mesh = box(stage, "/World/Crate/Shape")
    moved = BOX + np.array([[0, 0, 0.5]])
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(BOX.astype("f4")), 1)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(moved.astype("f4")), 5)
    mesh.CreateVelocitiesAttr([(1, 0, 0)] * 8)
    red = material(stage, "/World/Looks", "red", (1, 0, 0))
    blue = material(stage, "/World/Looks", "blue", (0, 0, 0.5))
    owner = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    for made, faces in ((red, [0, 1, 2, 3]), (blue, [4, 5])):
        subset = owner.CreateMaterialBindSubset(made.GetPrim().GetName(), faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(made)
    other = box(stage, "/World/Mirrored", "attribute")
    other.AddScaleOp().Set((-1, 1, 1))
    UsdShade.MaterialBindingAPI.Apply(other.GetPrim()).Bind(blue)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    turn = camera.AddRotateZOp()
    turn.Set(0, 0)
    turn.Set(90, 48)
    stage.Save()
    return tmp_path / "scene.usda"


def document_of(path):
    found = load_document(path)
    assert found is not None and found.suffix == ".usdc"
    return found


def bent(vertices):
    """A pose: a shear that grows with the height."""
    centre = vertices.mean(axis=0)
    local = vertices - centre
    return vertices + np.stack([0.02 * local[:, 2] ** 2, 0.3 * local[:, 2], 0 * local[:, 2]], 1)


def opened(path):
    return Usd.Stage.Open(str(path))


def get(stage, path):
    return UsdGeom.Mesh(stage.GetPrimAtPath(path))


def uvs(mesh):
    return np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").ComputeFlattened())


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc"])
def test_a_pose_is_the_same_stage(tmp_path, scene, suffix):
    shapes, document = load_shapes(scene), document_of(scene)
    assert (document.name, document.vertex_count) == ("scene", 16)
    np.testing.assert_array_equal(document.faces, shapes.faces)
    goal = bent(shapes.vertices[0])
    path = tmp_path / f"pose{suffix}"
    save_mesh(path, Mesh(goal, shapes.faces), like=document)
    assert path.read_bytes()[:5] == (b"#usda" if suffix == ".usda" else b"PXR-U")
    found = load_shapes(path)
    assert len(found) == 1
    np.testing.assert_allclose(found.vertices[0], goal, atol=1e-4)
    np.testing.assert_array_equal(found.faces, shapes.faces)
    old, new = opened(scene), opened(path)
    assert UsdGeom.GetStageUpAxis(new) == "Z" and UsdGeom.GetStageMetersPerUnit(new) == 0.01
    assert [str(p.GetPath()) for p in new.Traverse()] == [str(p.GetPath()) for p in old.Traverse()]
    assert new.GetDefaultPrim().GetName() == "World"
    for name in ("/World/Crate/Shape", "/World/Mirrored"):
        before, after = get(old, name), get(new, name)
        for attribute in ("GetFaceVertexCountsAttr", "GetFaceVertexIndicesAttr"):
            assert getattr(after, attribute)().Get() == getattr(before, attribute)().Get()
        np.testing.assert_array_equal(uvs(after), uvs(before))
        points = np.array(after.GetPointsAttr().Get())
        box = np.array(after.GetExtentAttr().Get())
        np.testing.assert_array_equal(box, [points.min(axis=0), points.max(axis=0)])
        assert not after.GetPointsAttr().GetTimeSamples()
        assert not after.GetVelocitiesAttr().HasAuthoredValue()
    subsets = UsdShade.MaterialBindingAPI(get(new, "/World/Crate/Shape")).GetMaterialBindSubsets()
    assert [list(subset.GetIndicesAttr().Get()) for subset in subsets] == [[0, 1, 2, 3], [4, 5]]
    # The crate stays at its first size, and the camera goes on turning.
    assert not UsdGeom.Xformable(new.GetPrimAtPath("/World/Crate")).GetTimeSamples()
    assert UsdGeom.Xformable(new.GetPrimAtPath("/World/Camera")).GetTimeSamples() == [0, 48]


def test_a_document_holds_the_first_frame_alone(tmp_path, scene):
    (tmp_path / "held.usdc").write_bytes(document_of(scene).data)
    stage = opened(tmp_path / "held.usdc")
    mesh = get(stage, "/World/Crate/Shape")
    assert not mesh.GetPointsAttr().GetTimeSamples()
    np.testing.assert_array_equal(mesh.GetPointsAttr().Get(), BOX)


def test_a_package_is_a_document(tmp_path, scene):
    utilities = pytest.importorskip("pxr.UsdUtils")
    assert utilities.CreateNewUsdzPackage(str(scene), str(tmp_path / "scene.usdz"))
    document = document_of(tmp_path / "scene.usdz")
    pose = bent(load_shapes(scene).vertices[0])
    (tmp_path / "pose.usdc").write_bytes(document.write(pose))
    np.testing.assert_allclose(load_shapes(tmp_path / "pose.usdc").vertices[0], pose, atol=1e-4)
    assert UsdGeom.GetStageMetersPerUnit(opened(tmp_path / "pose.usdc")) == 0.01


def test_the_library_is_quiet(tmp_path):
    """In a process of its own, for the library says some things once."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usdc"))
    box(stage, "/Box")
    stage.Save()
    code = "import deformer, sys; found = deformer.load_document(sys.argv[1]); "
    code += "found.write(deformer.load_mesh(sys.argv[1]).vertices + 1)"
    command = [sys.executable, "-c", code, str(tmp_path / "a.usdc")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def shown_normals(stage, name, code=0):
    mesh = get(stage, name)
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        assert primvar.GetInterpolation() == "faceVarying"
        return np.array(primvar.ComputeFlattened(code))
    assert mesh.GetNormalsInterpolation() == "faceVarying"
    return np.array(mesh.GetNormalsAttr().Get(code))


@pytest.mark.parametrize("name", ["/World/Crate/Shape", "/World/Mirrored"])
def test_normals_are_recomputed_and_split_as_they_were(tmp_path, scene, name):
    document = document_of(scene)
    pose = bent(load_shapes(scene).vertices[0])
    (tmp_path / "pose.usdc").write_bytes(document.write(pose))
    stage = opened(tmp_path / "pose.usdc")
    points = np.array(get(stage, name).GetPointsAttr().Get(), dtype=float)
    found = shown_normals(stage, name)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
    a, b, c = (points[np.array(QUADS)[5, k]] for k in range(3))
    hard = np.cross(b - a, c - a)
    np.testing.assert_allclose(found[20:], [hard / np.linalg.norm(hard)] * 4, atol=0.05)
    # The five others are smooth: each vertex has one normal there, that of no face alone.
    corners = np.ravel(QUADS[:5])
    for vertex in range(8):
        own = found[:20][corners == vertex]
        np.testing.assert_allclose(own, own[:1].repeat(len(own), axis=0), atol=1e-6)
        assert (own @ points[vertex] > 0).all()
    assert np.abs(found - corner_normals(BOX)).max() > 0.05


def test_its_own_positions_give_the_same_digits(tmp_path, scene):
    stage = opened(scene)
    # So far off that positions on the way to the world and back lose digits.
    stage.GetPrimAtPath("/World").GetAttribute("xformOp:translate").Set((1e10, 0, 0))
    stage.Save()
    document = document_of(scene)
    (tmp_path / "same.usdc").write_bytes(document.write(load_shapes(scene).vertices[0]))
    stage = opened(tmp_path / "same.usdc")
    for name in ("/World/Crate/Shape", "/World/Mirrored"):
        np.testing.assert_array_equal(get(stage, name).GetPointsAttr().Get(), BOX)
        np.testing.assert_allclose(shown_normals(stage, name), corner_normals(BOX), atol=1e-7)


def test_a_sequence_is_the_same_stage_with_time_samples(tmp_path, scene):
    shapes, document = load_shapes(scene), document_of(scene)
    first = shapes.vertices[0]
    poses = np.stack([first, bent(first), bent(bent(first))])
    path = tmp_path / "walk.usda"
    deformer.save_shapes(path, MeshSequence(poses, shapes.faces), like=document, fps=12)
    found = load_shapes(path)
    np.testing.assert_allclose(found.vertices, poses, atol=1e-4)
    stage = opened(path)
    assert stage.GetFramesPerSecond() == 12 and UsdGeom.GetStageUpAxis(stage) == "Z"
    # The camera still takes two seconds.
    assert stage.GetTimeCodesPerSecond() == 24
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 48)
    mesh = get(stage, "/World/Crate/Shape")
    assert mesh.GetPointsAttr().GetTimeSamples() == [0, 2, 4]
    for code in (0, 2, 4):
        points = np.array(mesh.GetPointsAttr().Get(code))
        box = np.array(mesh.GetExtentAttr().Get(code))
        np.testing.assert_array_equal(box, [points.min(axis=0), points.max(axis=0)])
    normals = [shown_normals(stage, "/World/Crate/Shape", code) for code in (0, 2, 4)]
    np.testing.assert_allclose(normals[0], corner_normals(BOX), atol=1e-6)
    assert np.abs(normals[2] - normals[1]).max() > 0.01
    assert opened(path).GetPrimAtPath("/World/Crate/Shape/red")


def test_without_other_motion_frames_are_time_codes(tmp_path, scene):
    stage = opened(scene)
    stage.RemovePrim("/World/Camera")
    stage.Save()
    shapes, document = load_shapes(scene), document_of(scene)
    poses = MeshSequence(shapes.vertices[[0, 0, 0]], shapes.faces)
    deformer.save_shapes(tmp_path / "walk.usdc", poses, like=document, fps=30)
    stage = opened(tmp_path / "walk.usdc")
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 2)


def test_a_directory_has_files_like_the_stage(tmp_path, scene):
    shapes, document = load_shapes(scene), document_of(scene)
    deformer.save_shapes(tmp_path / "out", shapes.subset([0, 4]), like=document)
    files = sorted(file.name for file in (tmp_path / "out").glob("*.*") if file.stem.isdecimal())
    assert files == ["0000.usdc", "0001.usdc"]
    found = load_shapes(tmp_path / "out")
    np.testing.assert_allclose(found.vertices, shapes.vertices[[0, 4]], atol=1e-4)
    assert UsdGeom.GetStageMetersPerUnit(opened(tmp_path / "out" / "0001.usdc")) == 0.01


def test_other_formats_get_what_they_know(tmp_path, scene):
    shapes, document = load_shapes(scene), document_of(scene)
    pose = bent(shapes.vertices[0])
    mesh = Mesh(pose, shapes.faces)
    save_mesh(tmp_path / "pose.obj", mesh, like=document)
    found = ObjFile((tmp_path / "pose.obj").read_bytes()).polygons({})
    assert found.counts.tolist() == [4] * 12
    assert [part.object for part in found.parts] == ["Shape", "Mirrored"]
    assert found.uvs is not None and found.normals is not None
    np.testing.assert_allclose(found.uvs[:4], [(0, 0), (1, 0), (1, 1), (0, 1)])
    names = [found.materials[n].name for n in found.material]
    assert names == ["red"] * 4 + ["blue"] * 8
    # The faces of the mirrored box are turned, and their texture coordinates with them.
    assert found.corners[24:28].tolist() == [8, 9, 11, 10]
    np.testing.assert_allclose(found.uvs[24:28], [(0, 0), (0, 1), (1, 1), (1, 0)])
    np.testing.assert_array_equal(deformer.load_mesh(tmp_path / "pose.obj").faces, shapes.faces)
    for own in (found.normals[:24], found.normals[24:]):
        assert len(np.unique(own)) == 8 + 4
    assert ply_polygons(document.write(pose, ".ply")).counts.tolist() == [4] * 12
    save_mesh(tmp_path / "pose.glb", mesh, like=document)
    asset = GltfAsset((tmp_path / "pose.glb").read_bytes(), "pose.glb")
    colours = {
        entry["name"]: entry["pbrMetallicRoughness"]["baseColorFactor"]
        for entry in asset.json["materials"]
    }
    assert colours == {"red": [1, 0, 0, 1], "blue": [0, 0, 0.5, 1]}
    # z is up in the stage, and y in a GLB file.
    low, high = (
        np.ptp(points, axis=0)
        for points in (as_other_programs_read(tmp_path / "pose.glb")[0], pose)
    )
    np.testing.assert_allclose(low, high[[0, 2, 1]], rtol=1e-4)


def test_display_colours_go_along(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = box(stage, "/Box")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    )
    primvar.Set([(0.2140411, 1, 0)] * 7 + [(0, 0, 1)])
    stage.Save()
    found = document_of(tmp_path / "a.usda").polygons()
    assert found.colours is not None
    np.testing.assert_allclose(found.colours, [(0.5, 1, 0)] * 7 + [(0, 0, 1)], atol=1e-5)


@pytest.fixture
def skinned(tmp_path):
    """A box that one joint turns and one blend shape widens, on a root with a transform."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "skin.usda"))
    root = UsdSkel.Root.Define(stage, "/Root")
    root.AddTranslateOp().Set((0, 5, 0))
    root.CreateExtentAttr([(-9, -9, -9), (9, 9, 9)])
    skeleton = UsdSkel.Skeleton.Define(stage, "/Root/Skeleton")
    skeleton.CreateJointsAttr(["joint"])
    identity = Gf.Matrix4d(1)
    skeleton.CreateBindTransformsAttr([identity])
    skeleton.CreateRestTransformsAttr([identity])
    animation = UsdSkel.Animation.Define(stage, "/Root/Skeleton/Walk")
    animation.CreateJointsAttr(["joint"])
    animation.CreateBlendShapesAttr(["wide"])
    turn = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), 40).GetQuat())
    animation.CreateRotationsAttr([turn])
    animation.CreateTranslationsAttr([(0, 0, 2)])
    animation.CreateScalesAttr([(1, 1, 1)])
    animation.CreateBlendShapeWeightsAttr([0.5])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    mesh = box(stage, "/Root/Box")
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 1).Set([0] * 8)
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8)
    shape = UsdSkel.BlendShape.Define(stage, "/Root/Box/wide")
    shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy((BOX * (1, 0, 0)).astype("f4")))
    binding.CreateBlendShapesAttr(["wide"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    stage.Save()
    return tmp_path / "skin.usda"


def test_a_pose_is_not_deformed_again(tmp_path, skinned):
    shapes, document = load_shapes(skinned), document_of(skinned)
    assert list(shapes.names) == ["base", "wide", "default"]
    for shape in shapes.vertices:
        (tmp_path / "pose.usda").write_bytes(document.write(shape, ".usda"))
        found = load_shapes(tmp_path / "pose.usda")
        assert len(found) == 1
        np.testing.assert_allclose(found.vertices[0], shape, atol=1e-5)
        np.testing.assert_array_equal(found.faces, shapes.faces)
        stage = opened(tmp_path / "pose.usda")
        assert stage.GetPrimAtPath("/Root/Skeleton") and not stage.GetPrimAtPath("/Root/Box/wide")
        box = stage.GetPrimAtPath("/Root/Box")
        assert not [name for name in box.GetPropertyNames() if "skel:" in name]
        bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
        shown = bounds.ComputeWorldBound(stage.GetPrimAtPath("/Root")).ComputeAlignedRange()
        np.testing.assert_allclose(shown.GetMax(), shape.max(axis=0), atol=1e-5)


def test_instances_references_and_textures(tmp_path):
    """Each instance takes its own pose; textures keep their paths relative to the file."""
    folder = tmp_path / "set"
    folder.mkdir()
    part = Usd.Stage.CreateNew(str(folder / "part.usda"))
    part.SetDefaultPrim(UsdGeom.Xform.Define(part, "/Part").GetPrim())
    box(part, "/Part/Box")
    reader = UsdShade.Shader.Define(part, "/Part/Texture")
    kind = Sdf.ValueTypeNames.Asset
    reader.CreateInput("file", kind).Set("./maps/wood.png")
    reader.CreateInput("other", kind).Set("/shared/maps/wood.png")
    part.Save()
    (folder / "maps").mkdir()
    (folder / "maps" / "wood.png").write_bytes(b"png")
    stage = Usd.Stage.CreateNew(str(folder / "set.usda"))
    for n in range(2):
        placed = UsdGeom.Xform.Define(stage, f"/Part{n}")
        placed.AddTranslateOp().Set((5 * n, 0, 0))
        placed.GetPrim().GetReferences().AddReference("./part.usda")
        placed.GetPrim().SetInstanceable(True)
    stage.Save()
    shapes, document = load_shapes(folder / "set.usda"), document_of(folder / "set.usda")
    pose = shapes.vertices[0].copy()
    pose[8:] = bent(pose[8:])
    (tmp_path / "pose.usda").write_bytes(document.write(pose, ".usda"))
    np.testing.assert_allclose(load_shapes(tmp_path / "pose.usda").vertices[0], pose, atol=1e-5)
    text = (tmp_path / "pose.usda").read_text()
    assert "@./maps/wood.png@" in text and "@/shared/maps/wood.png@" in text
    assert str(tmp_path) not in text and "part.usda" not in text


def test_another_mesh_and_a_flat_transform_are_refused(tmp_path, scene):
    document = document_of(scene)
    with pytest.raises(InputError, match=r"document scene\.usdc: 16 vertices"):
        save_mesh(tmp_path / "a.usda", Mesh(BOX, np.array([[0, 1, 2]])), like=document)
    stage = opened(scene)
    get(stage, "/World/Mirrored").GetPrim().GetAttribute("xformOp:scale").Set((1, 1, 0))
    stage.Save()
    flat = document_of(scene)
    with pytest.raises(InputError, match="Mirrored: has a scale of 0"):
        flat.write(load_shapes(scene).vertices[0])
    assert not (tmp_path / "a.usda").exists()


def test_damaged_and_linked_contents_are_refused(scene):
    document = document_of(scene)
    points = load_shapes(scene).vertices[0]
    broken = deformer.Document(".usdc", b"PXR-USDC" + b"x" * 99, "a", 16, document.faces)
    with pytest.raises(InputError, match=r"document a\.usdc"):
        broken.write(points)
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    stage.DefinePrim("/A").GetReferences().AddReference("./b.usda")
    path = scene.parent / "linked.usdc"
    layer.Export(str(path))
    linked = deformer.Document(".usdc", path.read_bytes(), "a", 16, document.faces)
    with pytest.raises(InputError, match="refers to other stages"):
        linked.write(points)


def test_a_model_keeps_it_and_needs_the_library_only_to_write(tmp_path, scene, monkeypatch):
    shapes, document = load_shapes(scene), document_of(scene)
    model = deformer.train(shapes, 2, epochs=2, document=document)
    model.save(tmp_path / "model")
    assert (tmp_path / "model" / "document.usdc").read_bytes() == document.data
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pxr.Usd", None)
        loaded = deformer.load_model(tmp_path / "model")
        for name in ("a.usda", "a.obj", "a.glb"):
            with pytest.raises(InputError, match=r'pip install "deformer\[usd\]"'):
                save_mesh(tmp_path / name, loaded.reference, like=loaded)
    save_mesh(tmp_path / "a.usda", loaded.reference, like=loaded)
    assert UsdGeom.GetStageMetersPerUnit(opened(tmp_path / "a.usda")) == 0.01
