"""USD stages give their meshes, time samples and blend shapes as shapes."""

import logging

import numpy as np
import pytest

from deformer import io
from deformer.errors import InputError

pytest.importorskip("pxr")

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = [[0, 1, 2], [0, 2, 3], [0, 4, 1]]
MESH = """
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 4, 1]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]
"""
HEAD = '#usda 1.0\n(\n    timeCodesPerSecond = 24\n    framesPerSecond = 12\n    upAxis = "Z"\n)\n'


def load(folder, text, name="a.usda", **options):
    (folder / name).write_text(HEAD + text)
    return io.load_shapes(folder / name, **options)


def refusal(*arguments, **options):
    with pytest.raises(InputError) as caught:
        load(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message and "a.usda" in message
    return message


def mesh(extra="", base=MESH, name="m"):
    return f'def Mesh "{name}"\n{{{base}{extra}}}\n'


def test_meshes_come_in_order_with_transforms_and_orientation(tmp_path):
    inner = mesh('uniform token orientation = "leftHanded"\n', name="left")
    text = 'def Xform "up"\n{\n    double3 xformOp:translate = (0, 0, 5)\n'
    text += '    uniform token[] xformOpOrder = ["xformOp:translate"]\n' + inner + "}\n" + mesh()
    shapes = load(tmp_path, text)
    assert shapes.names == ("a",)
    np.testing.assert_array_equal(shapes.vertices[0], [*(POINTS + np.array([0, 0, 5])), *POINTS])
    left = [[0, 3, 2], [0, 2, 1], [0, 1, 4]]
    np.testing.assert_array_equal(shapes.faces, [*left, *(np.array(FACES) + 5)])


def test_mirrored_meshes_and_holes(tmp_path):
    extra = "double3 xformOp:scale = (-1, 1, 1)\nint[] holeIndices = [1]\n"
    extra += 'uniform token[] xformOpOrder = ["xformOp:scale"]\n'
    shapes = load(tmp_path, mesh(extra))
    np.testing.assert_array_equal(shapes.vertices[0], POINTS * [-1, 1, 1])
    np.testing.assert_array_equal(shapes.faces, [[0, 3, 2], [0, 2, 1]])


def test_time_samples_are_frames_at_the_stage_s_rate_or_another(tmp_path):
    extra = "double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 24: (24, 0, 0) }\n"
    extra += 'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    shapes = load(tmp_path, mesh(extra))
    assert len(shapes) == 13 and shapes.names[:2] == ("animation 0 s", "animation 0.08333 s")
    np.testing.assert_allclose(shapes.vertices[:, 0, 0], np.arange(13) * 2)
    shapes = load(tmp_path, mesh(extra), fps=2, clip="animation")
    np.testing.assert_allclose(shapes.vertices[:, 1, 0], [1, 13, 25])
    assert io.load_mesh(tmp_path / "a.usda").vertices[0, 0] == 0
    assert "no clip 'walk'" in refusal(tmp_path, mesh(extra), clip="walk")
    assert "nothing in the file moves" in refusal(tmp_path, mesh(), clip=0)


SHAPES = """
def SkelRoot "root"
{
    def Skeleton "skeleton" (prepend apiSchemas = ["SkelBindingAPI"])
    {
        uniform token[] joints = ["a", "a/b"]
        uniform matrix4d[] bindTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, 1))]
        uniform matrix4d[] restTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, 1))]
        rel skel:animationSource = </root/skeleton/motion>
        def SkelAnimation "motion"
        {
            uniform token[] joints = ["a", "a/b"]
            float3[] translations = [(0, 0, 0), (1, 0, 0)]
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
            MOTION
            uniform token[] blendShapes = ["smile"]
            float[] blendShapeWeights = [WEIGHT]
        }
    }
    def Mesh "m" (prepend apiSchemas = ["SkelBindingAPI"])
    {
        MESH
        int[] primvars:skel:jointIndices = [0, 1, 1, 0, 0] (elementSize = 1
            interpolation = "vertex")
        float[] primvars:skel:jointWeights = [1, 1, 1, 1, 1] (elementSize = 1
            interpolation = "vertex")
        rel skel:skeleton = </root/skeleton>
        uniform token[] skel:blendShapes = ["frown", "smile"]
        rel skel:blendShapeTargets = [</root/m/frown>, </root/m/smile>]
        def BlendShape "frown"
        {
            uniform vector3f[] offsets = [(0, 0, -1)]
            uniform int[] pointIndices = [4]
        }
        def BlendShape "smile"
        {
            uniform vector3f[] offsets = [(0, 0, 2)]
            uniform vector3f[] inbetweens:half = [(0, 1, 0)] (weight = 0.5)
            uniform int[] pointIndices = [4]
        }
    }
}
""".replace("MESH", MESH)
STILL = "quatf[] rotations = [(1, 0, 0, 0), (1, 0, 0, 0)]"
HALF = 0.70710678
TURNS = f"""quatf[] rotations.timeSamples = {{
    0: [(1, 0, 0, 0), (1, 0, 0, 0)], 12: [(1, 0, 0, 0), ({HALF}, 0, 0, {HALF})] }}"""


def stage(motion=STILL, weight="0"):
    return SHAPES.replace("MOTION", motion).replace("WEIGHT", weight)


def test_blend_shapes_are_shapes_with_their_in_betweens(tmp_path):
    shapes = load(tmp_path, stage())
    assert shapes.names == ("base", "frown", "smile at 0.5", "smile")
    tips = [[0, 0, 1], [0, 0, 0], [0, 1, 1], [0, 0, 3]]
    np.testing.assert_allclose(shapes.vertices[:, 4], tips, atol=1e-6)
    np.testing.assert_allclose(shapes.vertices[:, :4], np.tile(POINTS[:4], (4, 1, 1)), atol=1e-6)


def test_weights_that_are_shown_give_one_more_shape(tmp_path):
    shapes = load(tmp_path, stage(weight="0.25"))
    assert shapes.names[-1] == "default"
    np.testing.assert_allclose(shapes.vertices[-1, 4], [0, 0.5, 1], atol=1e-6)


def test_skeletons_turn_their_points(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, "deformer"):
        assert "smile" in load(tmp_path, stage(TURNS)).names
    assert "'animation'" in caplog.text
    shapes = load(tmp_path, stage(TURNS), clip=0, fps=2)
    assert len(shapes) == 2
    np.testing.assert_allclose(shapes.vertices[0], POINTS, atol=1e-6)
    # Points 1 and 2 go with the joint at (1, 0, 0), which turns by 90° about z.
    turned = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]]
    np.testing.assert_allclose(shapes.vertices[1], turned, atol=1e-6)


def test_binary_and_packed_files_are_read_alike(tmp_path):
    from pxr import Sdf, UsdUtils

    text = load(tmp_path, stage())
    Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda")).Export(str(tmp_path / "a.usdc"))
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usdc"), str(tmp_path / "a.usdz"))
    for suffix in ("usdc", "usdz"):
        shapes = io.load_shapes(tmp_path / f"a.{suffix}")
        np.testing.assert_array_equal(shapes.vertices, text.vertices)
        assert shapes.names == text.names


def test_a_folder_has_one_shape_a_file(tmp_path):
    for n in range(2):
        (tmp_path / f"{n}.usda").write_text(HEAD + mesh().replace("(1, 1, 0)", f"(1, 1, {n})"))
    shapes = io.load_shapes(tmp_path)
    assert shapes.names == ("0", "1")
    np.testing.assert_array_equal(shapes.vertices[:, 2, 2], [0, 1])


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no faces"),
        ("garbage", "cannot be opened"),
        (mesh().replace("0, 4, 1]", "0, 9, 1]"), "vertex index 9 of 5"),
        (mesh().replace("[4, 3]", "[4, 2]"), "counts of 6"),
        (mesh().replace("[4, 3]", "[5, 3]"), "counts of 8"),
        (mesh().replace("(0, 0, 1)]", "(0, 0, inf)]"), "inf"),
        (mesh("int[] faceVertexIndices.timeSamples = { 1: [0, 1, 2, 3, 0, 4, 1], "
              "2: [0, 1, 2, 3, 0, 1, 4] }\npoint3f[] points.timeSamples = { 1: [(0, 0, 0), "
              "(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)], 3: [(0, 0, 0), (1, 0, 0), (1, 1, 0), "
              "(0, 1, 0), (0, 0, 2)] }\n", base="int[] faceVertexCounts = [4, 3]\n"),
         "other faces at time code 2"),
        (mesh("point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), "
              "(0, 0, 1)], 3: [(0, 0, 0)] }\n", base=MESH.partition("point3f")[0]), "1 points"),
        ('def PointInstancer "many"\n{\n}\n', "point instancer"),
        ('def "x" (references = @gone.usda@)\n{\n}\n' + mesh(), "missing"),
        ('def "x" (references = @../out.usda@</m>)\n{\n}\n' + mesh(), "not in its folder"),
        (stage().replace("pointIndices = [4]", "pointIndices = [7]"), "point 7 of 5"),
    ],
)  # fmt: skip
def test_stages_that_cannot_be_kept_are_refused(tmp_path, text, part):
    (tmp_path / "out.usda").write_text(HEAD + mesh())
    inside = tmp_path / "inside"
    inside.mkdir()
    assert part in refusal(inside, text)


def test_without_the_library_one_line_says_what_to_install(tmp_path, monkeypatch):
    import importlib

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    assert 'pip install "deformer[usd]"' in refusal(tmp_path, mesh())
