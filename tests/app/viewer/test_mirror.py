"""Mirroring: planes, whole poses, and both sides at once."""

import numpy as np
import pytest

import deformer
from deformer import DeformationModel
from deformer_app.viewer import handle_changes
from deformer_app.viewer.edit import Edit, Handle, point
from deformer_app.viewer.mirror_plane import MirrorPlane
from deformer_app.viewer.pose_worker import PoseWorker
from off_screen_editor import finish
from shapes import small_model, strip


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture
def plane(model):
    """Across the tube's axis: its two ends are each other's images."""
    plane = MirrorPlane(model)
    plane.set_across("x")
    return plane


class _Body:
    """As much of a model as its plane needs."""

    def __init__(self, reference, examples=()):
        self.reference, self.codes = reference, np.arange(len(examples))
        self.decode = lambda n: examples[n]


def test_the_plane_of_a_flat_sheet_separates_two_sides():
    """In its own plane each vertex is its own image: nothing could be mirrored."""
    sheet = strip(31, 5)
    plane = MirrorPlane(_Body(sheet))  # pyright: ignore[reportArgumentType]
    assert plane.is_symmetric
    assert (plane.symmetry.opposite != np.arange(len(sheet.vertices))).mean() > 0.5


def test_a_reference_that_is_not_posed_symmetrically_uses_an_example_that_is():
    sheet = strip(31, 5, length=3.0)
    straight = sheet.vertices - [1.5, 0.0, 0.0]
    straight[:, 1] += 0.3 * straight[:, 0] ** 2  # symmetric about x = 0 alone
    straight[:, 2] = 0.4 * straight[:, 1] ** 2
    bent = straight.copy()
    bent[:, 2] += 3.0 * np.maximum(straight[:, 0] - 0.2, 0.0)
    body = _Body(deformer.Mesh(bent, sheet.faces), [bent, straight])
    assert deformer.find_symmetry(body.reference).error > 0.02
    plane = MirrorPlane(body)  # pyright: ignore[reportArgumentType]
    assert plane.is_symmetric and abs(plane.symmetry.normal[0]) == pytest.approx(1.0, abs=1e-6)


def test_a_mirrored_state_is_solved_to_the_mirrored_pose(model: DeformationModel, plane):
    """An asymmetric pose: one end is pulled aside, the other held."""
    v = model.reference.vertices
    diagonal = model.reference.bounding_diagonal
    handles = (
        Handle(1, (3,), (point(v[3]),), "exact"),
        Handle(2, (115,), (point(v[115] + [0.0, 0.3, 0.2]),), "exact"),
        Handle(5, (60,), (point(v[60]),), "exact"),
    )
    edit = Edit(tuple(model.codes[0].tolist()), handles)
    worker = PoseWorker(model)
    pose = worker.final_pose(edit).vertices
    image = handle_changes.mirrored_edit(edit, plane)
    assert [handle.id for handle in image.handles] == [1, 2, 5]
    opposite = plane.symmetry.opposite[[3, 115]]
    found = worker.final_pose(image).vertices
    np.testing.assert_allclose(
        found[opposite], plane.symmetry.mirror(pose[[3, 115]]), atol=1e-6 * diagonal
    )
    wanted = plane.mirrored_pose(pose)
    off = np.linalg.norm(found - wanted, axis=1).mean()
    assert off < 0.25 * np.linalg.norm(pose - wanted, axis=1).mean()


def test_the_image_of_a_code_is_closer_to_the_image_of_its_shape_than_any_example(model, plane):
    shape = model.decode(model.codes[4])
    found, wanted = model.decode(plane.mirrored_code(model.codes[4])), plane.mirrored_pose(shape)
    error = deformer.e_rms(wanted, found)
    assert error <= min(deformer.e_rms(wanted, example) for example in model.decode(model.codes))


def test_a_pose_that_is_mirrored_twice_is_the_one_that_it_was(editor):
    def mirrored():
        editor.mirror.mirror_pose()
        finish(editor)
        return editor.edit, editor.vertices.copy()

    editor.prior.start_from("Shape 4", editor.model.codes[4])
    editor.handles.place(115)
    editor.handles.slide_centre(np.add(editor.vertices[115], (0.0, 0.3, 0.2)))
    editor.commit("Move")
    finish(editor)
    edit, vertices = editor.edit, editor.vertices.copy()
    image, shape = mirrored()
    assert np.abs(shape - vertices).max() > 0.1
    for wanted, there in ((edit, vertices), (image, shape), (edit, vertices)):
        found, surface = mirrored()
        assert found == wanted
        np.testing.assert_allclose(surface, there, atol=1e-9)
    editor.prior.set_noise(0.5 * editor.edit.noise)
    editor.commit("Strength of the prior")
    assert mirrored()[0].noise == editor.edit.noise == 0.5 * edit.noise
    editor.undo()
    editor.mirror.plane.set_across("y")  # another plane: other images
    assert mirrored()[0] != image
