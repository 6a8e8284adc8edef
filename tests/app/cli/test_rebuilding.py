"""What the end of a training says of shapes and pieces that the codes do not tell."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import MeshSequence, load_model, save_shapes, train
from deformer.training.rebuilding import rebuilding as rebuilding_of
from deformer_app import console
from deformer_app.cli import rebuilding
from deformer_app.cli.main import app
from shapes import pieces


@pytest.fixture(scope="module")
def told():
    """Models of one and of many components for shapes of a tube, a ball and a point."""
    return {K: train(pieces(), components=K) for K in (1, 30)}


def test_the_summary_says_how_far_off_the_worst_shape_and_piece_are(told):
    shapes = pieces().vertices
    for model in told.values():
        D = model.reference.bounding_diagonal
        moved = model.decode(model.codes) - shapes
        places = np.linalg.norm(moved.mean(axis=1), axis=-1) / D
        off = np.linalg.norm(moved - moved.mean(axis=1, keepdims=True), axis=-1) / D
        of_shapes = np.sqrt((off**2).mean(axis=1))
        summary = model.summary
        assert summary["worst_place"] == places.argmax()
        assert summary["worst_place_distance"] == pytest.approx(places.max(), rel=1e-6)
        assert summary["worst_shape"] == of_shapes.argmax()
        assert summary["worst_shape_rms"] == pytest.approx(of_shapes.max(), rel=1e-6)
        of_pieces = [np.sqrt((off[:, part] ** 2).mean()) for part in (range(120), range(120, 162))]
        of_pieces.append(np.sqrt((off[:, 162] ** 2).mean()))
        assert summary["worst_piece_vertex"] == [0, 120, 162][int(np.argmax(of_pieces))]
        assert summary["worst_piece_rms"] == pytest.approx(max(of_pieces), rel=1e-6)


def test_few_components_are_named_with_a_remedy(told):
    lines = rebuilding.advice(told[1], None)
    assert len([line for line in lines if "--components 2" in line]) == 2
    assert any("the piece of vertex" in line for line in lines)
    assert not any("components" in line for line in rebuilding.advice(told[30], None))


def test_a_place_that_no_form_tells_asks_for_no_components():
    """Form and place at random: no number of components helps."""
    base = pieces()
    rng = np.random.default_rng(0)
    places = rng.normal(size=(len(base), 1, 3)) * 0.1 * base.mesh(0).bounding_diagonal
    model = train(MeshSequence(base.vertices + places, base.faces), components=30)
    names = [f"{n}.ply" for n in range(len(base))]
    (line,) = rebuilding.advice(model, names)
    shape = model.summary["worst_place"]
    assert f"training shape {shape} ({shape}.ply)" in line
    assert "beside its place" in line and "components" not in line


def test_the_index_is_that_of_the_file():
    """Of a split, the training shapes are some of the files."""
    model = load_model("flag")
    model = replace(model, codes=model.codes[:3], split={})
    shapes = model.decode(model.codes)
    shapes[1, 0] += 1.0
    shapes[2] += 1.0
    found = rebuilding_of(MeshSequence(shapes, model.reference.faces), model, [2, 5, 7])
    assert (found["worst_shape"], found["worst_place"]) == (5, 7)
    assert "worst_piece_rms" not in found


def test_a_training_ends_with_the_advice(tmp_path, capsys):
    save_shapes(tmp_path / "pieces.npz", pieces())
    arguments = ["train", tmp_path / "pieces.npz", "-o", tmp_path / "m", "--components", "1"]
    assert console.run(app, [str(argument) for argument in arguments]) == 0
    assert "the piece of vertex" in capsys.readouterr().err
