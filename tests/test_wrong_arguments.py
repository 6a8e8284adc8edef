"""Arguments of the public functions that are of another type, shape or size: all are InputError."""

import numpy as np
import pytest

import deformer
from deformer import InputError
from shapes import sequence, small_model

# What a person may give in place of numbers.
JUNK = ["abc", None, {}, object(), 1j, [1, "a"], [[1], [1, 2]], np.array([None, 1]), "1"]
WHOLE = [1.5, "2", None, True, np.nan, 10**400, [1]]
# A name that no file system takes.
LONG = "x" * 300
MESH = deformer.Mesh(np.eye(3), [[0, 1, 2]])
POSITIVE = ["x", np.nan, np.inf, 0, -1, True, [1.0], 10**400, 1e300]


def model():
    return small_model()


def solver():
    made = deformer.HandleSolver(model())
    made.set_handles([17], model().reference.vertices[[17]])
    return made


def refusal(call):
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert len(message.splitlines()) == 1 and len(message) < 400
    return message


def cases():
    V = 120
    shapes, codes = np.zeros((V, 3)), np.zeros(6)

    def each(name, call, values, argument=""):
        return [pytest.param(call, v, argument, id=f"{name}-{n}") for n, v in enumerate(values)]

    arrays = [*JUNK, np.zeros((7, 7)), np.nan]
    bad_codes = [*JUNK, np.full(6, np.nan), np.full(6, 1e300), np.zeros(5), np.nan]
    bad_starts = [code for code in bad_codes if code is not None]
    bad_points = [*JUNK, [1, 2], [1, 2, np.inf], 3.0]
    indices = ["abc", [0.5], [1.0], ["a"], [-1], [V], [[1]], [True], [10**30], 3, None, {}]
    not_models = ["humanoid", None, 3, {}]
    return [
        *each("mesh", lambda v: deformer.Mesh(v, [[0, 1, 2]]), arrays, "vertices"),
        *each("faces", lambda v: deformer.Mesh(shapes, v), [*arrays, [[0.0, 1, 2]], [[0, 1, V]]]),
        *each("sequence", lambda v: deformer.MeshSequence(v, [[0, 1, 2]]), arrays, "vertices"),
        *each("subset", lambda v: sequence(3).subset(v), indices, "indices"),
        *each("shape", lambda v: sequence(3).mesh(v), [*WHOLE, 3], "shape"),
        *each("decode", lambda v: model().decode(v), bad_codes, "z"),
        *each("encode", lambda v: model().encode(v), [*arrays, np.zeros((0, V, 3))], "vertices"),
        *each("fit", lambda v: model().fit(v), arrays, "vertices"),
        *each("iterations", lambda v: model().fit(shapes, v), [*WHOLE, -1], "iterations"),
        *each("names", lambda v: model().with_component_names(v), ["nod", None, [1], 3]),
        *each("name", lambda v: model().with_component_names({0: v}), [5, None, "a\nb", "\ud800"]),
        *each("named", lambda v: model().with_component_names({v: "nod"}), [1.5, "0", True, 6, -1]),
        *each(
            "component", lambda v: model().component(v), [1.5, None, 99, "99", "²", [1], 10**400]
        ),
        *each("solver", deformer.HandleSolver, not_models, "model"),
        *each("noise", lambda v: deformer.HandleSolver(model(), noise=v), POSITIVE, "noise"),
        *each("freedom", lambda v: deformer.HandleSolver(model(), freedom=v), POSITIVE, "freedom"),
        *each(
            "relaxation",
            lambda v: deformer.HandleSolver(model(), relaxation=v),
            [*WHOLE, -1],
            "relaxation",
        ),
        *each("rigid", lambda v: deformer.HandleSolver(model(), rigid=v), ["no", 1, None], "rigid"),
        *each("drag", lambda v: solver().drag(17, v), bad_points, "position"),
        *each("dragged", lambda v: solver().drag(v, [0, 0, 0]), [*WHOLE, 3], "vertex"),
        *each("handles", lambda v: solver().set_handles(v, [[0, 0, 0]]), indices),
        *each(
            "targets", lambda v: solver().set_handles([3], v), [*arrays, [[0, np.nan, 0]]], "target"
        ),
        *each(
            "weights",
            lambda v: solver().set_handles([3], [[0, 0, 0]], v),
            [*[j for j in JUNK if j is not None], [0], [-1], [np.nan], [1e300], [1, 2]],
            "weight",
        ),
        *each(
            "hard",
            lambda v: solver().set_handles([3], [[0, 0, 0]], hard=v),
            ["no", [1.5], None, [True, False]],
            "hard",
        ),
        *each("mean", lambda v: solver().set_prior(mean=v), bad_starts),
        *each("restore-z", lambda v: solver().restore(v, [0, 0, 0], [0, 0, 0]), bad_codes, "z"),
        *each("restore-r", lambda v: solver().restore(codes, v, [0, 0, 0]), bad_points, "rotation"),
        *each("restore-t", lambda v: solver().restore(codes, [0, 0, 0], v), bad_points, "transl"),
        *each("solves", lambda v: solver().solve_to_convergence(v), [*WHOLE, 0], "solves"),
        *each("layout", lambda v: deformer.layout(v, 3), not_models, "model"),
        *each("handles", lambda v: deformer.layout(model(), v), ["abc", None, 1.5, 0, -1, 121, []]),
        *each("fixed", lambda v: deformer.layout(model(), 3, fixed=v), indices[:7], "fixed"),
        *each("noise", lambda v: deformer.layout(model(), 3, noise=v), ["x", np.nan, -1, True]),
        *each("uncertainty", deformer.uncertainty, ["x", None, 3], "solver"),
        *each("fit_sequence", lambda v: deformer.fit_sequence(v, [1], [[[0, 0, 0]]]), not_models),
        *each("frames", lambda v: deformer.fit_sequence(model(), [1], v), arrays, "targets"),
        *each(
            "frame weights",
            lambda v: deformer.fit_sequence(model(), [1], np.zeros((2, 1, 3)), weights=v),
            [*[j for j in JUNK if j is not None], [-1], [np.inf], [1e300]],
            "weight",
        ),
        *each(
            "smoothness",
            lambda v: deformer.fit_sequence(model(), [1], np.zeros((2, 1, 3)), smoothness=v),
            ["x", np.nan, -1, None, np.inf],
            "smoothness",
        ),
        *each(
            "device",
            lambda v: deformer.fit_sequence(model(), [1], np.zeros((2, 1, 3)), device=v),
            ["cpu:foo", "tpu", "", None, 3, "cuda:x", "cuda:999999999999", "cpu:1"],
            "device",
        ),
        *each("train", deformer.train, ["dir", None, shapes], "shapes"),
        *each(
            "components", lambda v: deformer.train(sequence(3), components=v), [1.5, "2", 0, True]
        ),
        *each("huge", lambda v: deformer.train(sequence(3), components=v), [1081, 10**9, 10**400]),
        *each("epochs", lambda v: deformer.train(sequence(3), epochs=v), [1.5, "2", 0, 10**9]),
        *each("config", lambda v: deformer.train(sequence(3), config=v), ["x", 3, None, {}]),
        *each(
            "seed", lambda v: deformer.train(sequence(3), seed=v), [-1, 1.5, None, 2**70], "seed"
        ),
        *each("up", lambda v: deformer.train(sequence(3), up=v), ["--y", 3, None, "w"], "up"),
        *each("align", lambda v: deformer.train(sequence(3), align_shapes=v), ["x", 2], "align"),
        *each(
            "train device", lambda v: deformer.train(sequence(3), device=v), ["cpu:foo", 3, None]
        ),
        *each("reference", lambda v: deformer.train(sequence(3), reference=v), [1.5, "0", 7]),
        *each(
            "split",
            lambda v: deformer.train(sequence(3), split=v),
            ["x", [0], {"train": 3}, {"train": [0.5, 1]}, {"other": []}, {"train": ["a"]}],
            "split",
        ),
        *each("synthesis", deformer.Synthesis, not_models, "model"),
        *each(
            "start",
            lambda v: deformer.Synthesis(model(), v),
            bad_starts,
        ),
        *each(
            "code", lambda v: deformer.Synthesis(model()).code(v), ["x", [1], {0: "a"}, {0: 1e300}]
        ),
        *each(
            "space", lambda v: deformer.Synthesis(model()).shape({0: 1.0}, v), ["x", None, ["a"]]
        ),
        *each("count", lambda v: deformer.draw_codes(model(), v), [*WHOLE, -1, 10**15], "count"),
        *each("bound", lambda v: deformer.draw_codes(model(), 1, bound=v), ["x", np.nan, -1, None]),
        *each("keys", lambda v: deformer.interpolate(model(), v), arrays, "keys"),
        *each(
            "steps",
            lambda v: deformer.interpolate(model(), np.zeros((2, V, 3)), v),
            [*WHOLE, 1, 10**12],
            "steps",
        ),
        *each("transfer", lambda v: deformer.transfer(model(), model(), v), bad_codes, "z"),
        *each("source", lambda v: deformer.transfer(v, model(), codes), not_models, "source"),
        *each("familiarity", lambda v: deformer.Familiarity(model()).percentile(v), bad_codes, "z"),
        *each("extreme", lambda v: deformer.ComponentAnalysis(model(), v), [*WHOLE, -1]),
        *each("features", deformer.extract_features, ["x", None, shapes], "shapes"),
        *each("reconstruct", lambda v: deformer.reconstruct(sequence(3), v), arrays, "features"),
        *each("e_rms", lambda v: deformer.e_rms(v, shapes), [*JUNK, np.zeros((7, 7))]),
        *each("errors", lambda v: deformer.vertex_errors(shapes, v), [*JUNK, np.zeros((7, 7))]),
        *each("rotations", deformer.log_to_rotation, [*JUNK, [1, 2]], "r"),
        *each("spread", lambda v: deformer.spread(v, 3), [*JUNK, [1, 2]], "points"),
        *each("normals", lambda v: deformer.vertex_normals(v, sequence(3).faces), arrays),
        *each(
            "mirror", lambda v: deformer.symmetry_about(model().reference, v, [1, 0, 0]), bad_points
        ),
        *each("examine", deformer.examine, ["x", None, shapes], "shapes"),
        *each("load", deformer.load_model, [None, 3, ["x"]], "path"),
        *each("load mesh", deformer.load_mesh, [None, 3, ["x"], "a\0b.ply", LONG + ".ply"]),
        *each("load shapes", deformer.load_shapes, [None, 3, ["x"]], "path"),
        *each("load long", deformer.load_model, [LONG], "xxx"),
        *each("load long shapes", deformer.load_shapes, [LONG, LONG + ".npz"], "xxx"),
        *each("save long", lambda v: model().save(v), [LONG], "xxx"),
        *each("save mesh", lambda v: deformer.save_mesh(v, MESH), [None, 3], "path"),
        *each("save long mesh", lambda v: deformer.save_mesh(v, MESH), [LONG + ".obj"], "xxx"),
        *each("saved mesh", lambda v: deformer.save_mesh("a.obj", v), [None, shapes, "m"], "mesh"),
        *each("save shapes", lambda v: deformer.save_shapes(v, sequence(3)), [None, 3], "path"),
        *each(
            "save long shapes",
            lambda v: deformer.save_shapes(v, sequence(3)),
            [LONG, LONG + ".npz"],
            "xxx",
        ),
        *each("saved shapes", lambda v: deformer.save_shapes("a", v), [None, shapes], "shapes"),
        *each(
            "format",
            lambda v: deformer.save_shapes("a", sequence(3), v),
            [3, "fbx", "\ud800"],
            "format",
        ),
        *each("geodesics", deformer.Geodesics, [None, shapes, "m"], "mesh"),
        *each("rows", lambda v: deformer.Geodesics(MESH, v), [*WHOLE, 0], "cache_rows"),
        *each("strain", deformer.FaceStrain, [None, shapes, "m"], "reference"),
        *each("poisson", deformer.PoissonSystem, [None, shapes, "m"], "reference"),
        *each("symmetry", deformer.find_symmetry, [None, shapes, "m"], "mesh"),
    ]


@pytest.mark.parametrize(("call", "value", "argument"), cases())
def test_wrong_arguments_are_named_in_one_line(call, value, argument):
    assert argument in refusal(lambda: call(value))


def test_right_arguments_of_unusual_types_are_taken():
    made = solver()
    pose = made.drag(np.int64(17), tuple(model().reference.vertices[17]))
    assert np.isfinite(pose.vertices).all()
    assert model().decode(pose.z.tolist()).shape == (120, 3)
    assert model().decode(np.empty((0, 6))).shape == (0, 120, 3)
    assert deformer.HandleSolver(model(), noise=1, relaxation=np.int8(0)).relaxation == 0
    made.set_handles([], [])
    assert made.solve().residual.shape == (0,)


def test_arrays_that_are_given_stay_writable():
    vertices = model().reference.vertices.copy()
    mesh = deformer.Mesh(vertices, model().reference.faces)
    vertices[0] = 7.0
    assert mesh.vertices[0, 0] != 7.0
    z = model().latent_mean.copy()
    made = solver()
    made.set_prior(mean=z)
    z[:] = 1e9
    assert np.abs(made.solve().z).max() < 1e9
