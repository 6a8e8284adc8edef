"""Truths of many frames at once: numba's and torch's against each other and against formulas."""

import numpy as np
import pytest

from deformer.acap.jacobians import positions_from_features
from deformer.editing import batch_torch
from deformer.editing.batch_numba import NumbaFrames
from deformer.editing.batch_torch import TorchFrames
from deformer.editing.green_functions import HandleBasis
from deformer.geometry.rotations import log_to_rotation
from distances import largest
from shapes import large_model, pieces_model, small_model

pytestmark = pytest.mark.filterwarnings("error")


class Case:
    """A model with handles, codes about those of the training, and both kinds of frames."""

    def __init__(self, model, handles, count=7):
        self.model, self.handles = model, np.array(handles)
        self.unit = model.reference.bounding_diagonal
        self.basis = HandleBasis(model)
        self.basis.set_points(self.handles.tolist())
        rng = np.random.default_rng(0)
        K = model.components
        white = rng.normal(size=(count, K))
        self.z = model.latent_mean + white @ np.linalg.cholesky(model.latent_covariance).T
        self.Q = log_to_rotation(rng.normal(size=(count, 3)))
        self.origin = self.unit * rng.normal(size=(count, 3))
        shapes = np.array([model.decode(z) - model.centroid_offset(z) for z in self.z])
        self.free = shapes - model.reference.vertices.mean(axis=0)
        moved = self.free @ self.Q.transpose(0, 2, 1) + self.origin[:, None]
        self.targets = moved[:, handles]
        self.targets += 0.03 * self.unit * rng.normal(size=self.targets.shape)

    def both(self):
        return NumbaFrames(self.basis), TorchFrames(self.basis, "cpu")

    def shapes(self, frames, exact, rounds):
        out = np.full_like(self.free, np.nan)
        frames.shapes(self.z, self.Q, self.origin, self.targets, exact, rounds, out)
        return out

    def landmark_positions(self, z):
        """By formula, in double precision."""
        features = self.basis.landmark_decoder.features
        return np.array(
            [positions_from_features(features(row), self.basis.landmark_coefficients) for row in z]
        )


@pytest.fixture(scope="module", params=["all are landmarks", "fewer landmarks", "pieces"])
def case(request):
    if request.param == "all are landmarks":
        return Case(small_model(), [100, 3, 60, 40, 17])
    if request.param == "pieces":
        return Case(pieces_model(), [100, 3, 130, 162, 17])
    return Case(large_model(), [1400, 5, 600, 911])


def test_positions_by_landmarks_are_those_of_the_formula(case):
    expected = case.landmark_positions(case.z)
    for frames in case.both():
        found = frames.by_landmarks(case.z)
        assert found.shape == (7, len(case.handles), 3) and found.dtype == np.float64
        assert largest(found - expected) < 1e-5 * case.unit


def test_positions_by_all_are_decoded_ones(case):
    expected = case.free[:, case.handles]
    for frames in case.both():
        # 16 bits a weight.
        assert largest(frames.by_all(case.z) - expected) < 5e-5 * case.unit


def test_jacobians_are_central_differences(case):
    """Of the formula sharply, of each one's own positions up to its rounding."""
    K, h = case.model.components, 1e-5
    steps = np.eye(K)

    def differences(positions, h):
        columns = [(positions(case.z + h * s) - positions(case.z - h * s)) / (2 * h) for s in steps]
        return np.stack(columns, axis=-1)

    expected = differences(case.landmark_positions, h)
    size = np.abs(expected).max()
    for frames in case.both():
        J = frames.jacobians(case.z)
        assert J.shape == (7, len(case.handles), 3, K) and J.dtype == np.float64
        assert np.abs(J - expected).max() < 2e-5 * size
        own = differences(frames.by_landmarks, 1e-2 * np.abs(case.z).max())
        assert np.abs(J - own).max() < 5e-3 * size


def masks(count):
    rng = np.random.default_rng(1)
    mixed = rng.random((7, count)) < 0.5
    mixed[2] = False
    mixed[3:5] = True
    return {"none": np.zeros((7, count), bool), "all": np.ones((7, count), bool), "mixed": mixed}


@pytest.mark.parametrize("rounds", [0, 2])
@pytest.mark.parametrize("which", ["none", "all", "mixed"])
def test_shapes_agree_and_exact_handles_are_met(case, which, rounds):
    exact = masks(len(case.handles))[which]
    numba, torch = (case.shapes(frames, exact, rounds) for frames in case.both())
    assert largest(numba - torch) < 1e-4 * case.unit
    free = case.free @ case.Q.transpose(0, 2, 1) + case.origin[:, None]
    for out in (numba, torch):
        assert np.array_equal(out[:, case.handles][exact], case.targets[exact])
        # A frame without exact handles is the decoded shape, also amid frames that are relaxed.
        loose = ~exact.any(axis=1)
        np.testing.assert_allclose(out[loose], free[loose], atol=5e-5 * case.unit)


def test_exact_handles_move_their_surroundings_least(case):
    """Without relaxation: the smallest change of a shape as a plate under tension."""
    exact = np.zeros((7, len(case.handles)), bool)
    exact[:, [0, 2]] = True
    V = len(case.model.reference.vertices)
    L = case.model.poisson.weights
    laplacian = np.diag(np.asarray(L.sum(axis=1)).ravel()) - L.toarray()
    corners = case.model.reference.vertices[case.model.reference.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.zeros(V)
    np.add.at(area, case.model.reference.faces, np.linalg.norm(normals, axis=1)[:, None] / 6)
    area = np.maximum(area, 1e-6 * area.sum() / V)
    plate = laplacian @ np.diag(area.sum() / (100.0 * area)) @ laplacian + laplacian
    free = case.free @ case.Q.transpose(0, 2, 1) + case.origin[:, None]
    loose = np.setdiff1d(np.arange(V), case.handles[[0, 2]])
    for frames in case.both():
        change = case.shapes(frames, exact, 0) - free
        force = plate @ change
        size = np.abs(plate).max() * np.abs(change).max()
        assert np.abs(force[:, loose]).max() < 1e-3 * size


def test_batches_make_no_difference(case, monkeypatch):
    exact = masks(len(case.handles))["mixed"]
    _, torch = case.both()

    def everything():
        return (
            torch.by_landmarks(case.z),
            torch.jacobians(case.z),
            torch.by_all(case.z),
            case.shapes(torch, exact, 2),
        )

    whole = everything()
    for size in (1, 30 * len(case.model.reference.vertices)):
        monkeypatch.setattr(batch_torch, "_BATCH", size)
        for one, other in zip(whole, everything(), strict=True):
            np.testing.assert_allclose(other, one, atol=1e-5 * np.abs(one).max())


def test_no_handles():
    case = Case(small_model(), [])
    for frames in case.both():
        assert frames.by_landmarks(case.z).shape == (7, 0, 3)
        assert frames.by_all(case.z).shape == (7, 0, 3)
        assert frames.jacobians(case.z).shape == (7, 0, 3, case.model.components)
        out = case.shapes(frames, np.zeros((7, 0), bool), 2)
        free = case.free @ case.Q.transpose(0, 2, 1) + case.origin[:, None]
        np.testing.assert_allclose(out, free, atol=2e-5 * case.unit)
