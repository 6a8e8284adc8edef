"""What the end of a training says of shapes and pieces that the codes do not tell."""

import numpy as np
import pytest

from deformer import load_model, save_shapes, train
from deformer.training import trainer
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
        off = np.linalg.norm(model.decode(model.codes) - shapes, axis=-1) / D
        of_shapes = np.sqrt((off**2).mean(axis=1))
        summary = model.summary
        assert summary["worst_shape"] == of_shapes.argmax()
        assert summary["worst_shape_rms"] == pytest.approx(of_shapes.max(), rel=1e-6)
        of_pieces = [np.sqrt((off[:, part] ** 2).mean()) for part in (range(120), range(120, 162))]
        of_pieces.append(np.sqrt((off[:, 162] ** 2).mean()))
        assert summary["worst_piece_vertex"] == [0, 120, 162][int(np.argmax(of_pieces))]
        assert summary["worst_piece_rms"] == pytest.approx(max(of_pieces), rel=1e-6)


def test_few_components_are_named_with_a_remedy(told):
    lines = rebuilding.advice(told[1], None)
    assert len(lines) == 2
    assert "training shape" in lines[0] and "the piece of vertex" in lines[1]
    assert all("--components 2" in line for line in lines)
    assert not any("piece" in line for line in rebuilding.advice(told[30], None))


def test_the_index_is_that_of_the_file(monkeypatch, tmp_path, capsys):
    """Of a split, the training shapes are some of the files."""
    distances = np.full((3, 4), 0.01)
    distances[1] = 1.0
    reference = load_model("flag").reference
    found = trainer._farthest(
        distances[:, :1].repeat(len(reference.vertices), 1), [2, 5, 7], reference
    )
    assert found["worst_shape"] == 5 and "worst_piece_rms" not in found


def test_a_training_ends_with_the_advice(tmp_path, capsys):
    save_shapes(tmp_path / "pieces.npz", pieces())
    arguments = ["train", tmp_path / "pieces.npz", "-o", tmp_path / "m", "--components", "1"]
    assert console.run(app, [str(argument) for argument in arguments]) == 0
    assert "the piece of vertex" in capsys.readouterr().err
