"""The ghost of the pose before the last step or drag."""

import numpy as np

from deformer_app.viewer.edit import Edit
from deformer_app.viewer.previous_pose import PreviousPose
from off_screen_editor import event, finish, seen

FIRST, SECOND, THIRD = (Edit((float(n),)) for n in range(3))
A, B, C, D = (np.full((2, 3), float(n)) for n in range(4))


def test_it_is_the_pose_at_rest_before_the_last_step_or_the_drag_under_way():
    previous = PreviousPose()
    assert previous.vertices is None
    previous.note(FIRST, A, True)
    assert previous.vertices is None  # there has been only one
    previous.note(SECOND, B, False)
    assert previous.vertices is A  # while it is dragged
    previous.note(THIRD, C, False)
    assert previous.vertices is A
    previous.note(THIRD, D, True)
    assert previous.vertices is A  # after the drag
    previous.note(SECOND, B, False)
    assert previous.vertices is D
    previous.note(THIRD, D, True)  # the drag was given up
    assert previous.vertices is A
    previous.note(FIRST, A, True)  # undone
    assert previous.vertices is D


def ghost_points(editor):
    """Vertices of the ghost that is shown, or None."""
    ghosts = editor.state.view.ghosts
    return ghosts.vertices("compared") if "compared" in ghosts.names else None


def test_the_picture_s_ghost_is_the_pose_before_the_drag(editor):
    editor.picture.change_look(ghost="previous")
    finish(editor)
    assert ghost_points(editor) is None
    start = editor.vertices
    _, at = seen(editor, 0.95)
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    event(editor, "MouseMove", at - np.array([20, 30]))
    finish(editor)
    np.testing.assert_allclose(ghost_points(editor), start, atol=1e-5)
    event(editor, "LeftButtonRelease", at - np.array([20, 30]))
    finish(editor)
    moved = editor.vertices
    assert np.abs(moved - start).max() > 0.01
    np.testing.assert_allclose(ghost_points(editor), start, atol=1e-5)
    editor.undo()
    finish(editor)
    np.testing.assert_allclose(ghost_points(editor), moved, atol=1e-5)
    editor.picture.change_look(ghost="none")
    assert ghost_points(editor) is None


def test_a_session_keeps_the_choice(editor, tmp_path):
    editor.picture.change_look(ghost="previous", cube=False)
    editor.save_session(tmp_path / "s.json")
    editor.picture.change_look(ghost="none", cube=True)
    editor.open_session(tmp_path / "s.json")
    assert editor.state.look.ghost == "previous" and not editor.state.look.cube
