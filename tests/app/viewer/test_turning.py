"""Handles that turn with the rings of the manipulator, alone and together."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import deformer
from deformer_app.viewer.exports import export_handles
from deformer_app.viewer.gizmo import rotation, translation
from deformer_app.viewer.pose_worker import replay
from deformer_app.viewer.rigs import load_handles
from deformer_app.viewer.session import Session
from off_screen_editor import SIZE, drag, finish, part_pixel, seen


def turn(editor, part="rz", by=(20, 25)):
    """Drag a ring of the manipulator."""
    at = part_pixel(editor, part)
    drag(editor, at, at + np.array(by))


def test_one_handle_turns_in_its_place(editor, tmp_path):
    """From the rotation that the surface has; the surface follows, exactly if the handle is exact.

    Undone and redone, saved, exported and read again; at last it turns freely as before.
    """
    vertex = seen(editor, 1.0)[0]
    editor.handles.place(vertex)
    editor.commit("Place handle")
    editor.state.set_gizmo("rotate")
    finish(editor)
    assert editor.stage.gizmo.mode == "rotate"
    drawn = editor.state.view.overlays._frames.actor
    editor.state.draw(editor.vertices, editor.edit.handles)
    assert not drawn.GetVisibility()
    (start,) = deformer.local_rotations(editor.model, [vertex], editor.vertices)
    (before,) = editor.edit.handles
    turn(editor)
    (handle,) = editor.edit.handles
    assert editor.session.entry.label == "Rotate" and drawn.GetVisibility()
    assert handle.targets == before.targets
    delta = Rotation.from_matrix(np.array(handle.orientation) @ start.T).as_rotvec()
    assert np.linalg.norm(delta) > 0.1
    np.testing.assert_allclose(delta[:2], 0, atol=1e-9)
    off = editor.answer.pose.orientation_residual[0]
    assert off < 0.9 * np.linalg.norm(delta)
    editor.handles.set_kind("exact")
    finish(editor)
    (own,) = deformer.local_rotations(editor.model, [vertex], editor.vertices)
    np.testing.assert_allclose(own, handle.orientation, atol=1e-9)
    shown = editor.vertices
    editor.undo()
    editor.undo()
    finish(editor)
    assert editor.edit.handles == (before,) and not drawn.GetVisibility()
    editor.redo()
    editor.redo()
    finish(editor)
    np.testing.assert_allclose(editor.vertices, shown, atol=1e-6)
    turn(editor)
    assert editor.edit.handles[0].orientation != handle.orientation
    editor.undo()
    export_handles(editor, tmp_path / "h.json")
    editor.save_session(tmp_path / "s.json")
    found = replay(Session.load(tmp_path / "s.json"), editor.model).vertices
    np.testing.assert_allclose(found, shown, atol=1e-6)
    editor.handles.turn_freely()
    assert editor.edit.handles[0].orientation is None
    load_handles(editor, tmp_path / "h.json")
    np.testing.assert_allclose(editor.edit.handles[0].orientation, handle.orientation, atol=1e-12)


def test_handles_that_are_turned_turn_with_the_others(editor):
    """Several about their centre: those with an orientation, and no others, turn it along."""
    for vertex in (4, 60, 115):
        editor.handles.place(vertex, add=True)
    editor.commit("Place handle")
    first, *rest = editor.edit.handles
    editor.change("Turn", editor.edit.with_handles([first.oriented(np.eye(3))]))
    motion = rotation([1.0, 0, 0], [0.0, 0.3, 0.0])
    editor.handles.move_selected(motion)
    editor.commit("Rotate")
    (turned, *others) = editor.edit.handles
    np.testing.assert_allclose(turned.orientation, motion.matrix, atol=1e-12)
    assert [handle.orientation for handle in others] == [None, None]
    for handle, was in zip(editor.edit.handles, [first, *rest], strict=True):
        np.testing.assert_allclose(handle.targets, motion(was.targets), atol=1e-12)
    editor.handles.move_selected(translation([0.1, 0.0, 0.0]))
    editor.commit("Move")
    np.testing.assert_allclose(editor.edit.handles[0].orientation, motion.matrix, atol=1e-12)


def test_a_mirrored_handle_is_turned_as_in_a_mirror(editor):
    editor.mirror.plane.set_across("z")
    editor.handles.place(int(editor.model.reference.vertices[:, 2].argmax()))
    editor.commit("Place handle")
    (handle,) = editor.edit.handles
    tilt = rotation(np.zeros(3), [0.2, 0.1, 0.4]).matrix
    editor.change("Turn", editor.edit.with_handles([handle.oriented(tilt)]))
    editor.mirror.mirror_handles()
    copy = editor.edit.handles[1]
    # A rotation vector is an axial one: along the normal it stays, across it turns round.
    np.testing.assert_allclose(
        copy.orientation, rotation(np.zeros(3), [-0.2, -0.1, 0.4]).matrix, atol=1e-12
    )


@pytest.mark.parametrize("mode", ["rotate", "scale"])
def test_several_handles_turn_and_grow_about_their_centre(editor, mode):
    for vertex in (4, 60, 115):
        editor.handles.place(vertex, add=True)
    editor.commit("Place handle")
    finish(editor)
    editor.state.set_gizmo(mode)
    finish(editor)
    before = np.array([handle.centre for handle in editor.edit.handles])
    part = {"rotate": "rz", "scale": "s"}[mode]
    outline = editor.stage.gizmo.outline(part, editor.state.camera, SIZE)
    line = editor.state.camera.project(outline, SIZE)
    at = next(
        pixel
        for pixel in line
        if editor.stage.gizmo.part_at(pixel, editor.state.camera, SIZE) == part
        and editor.stage.handle_at(pixel) is None
    )
    drag(editor, at, at + (np.array([20, 25]) if mode == "rotate" else np.array([60, 0])))
    after = np.array([handle.centre for handle in editor.edit.handles])
    assert editor.session.entry.label == mode.capitalize()
    np.testing.assert_allclose(after.mean(axis=0), before.mean(axis=0), atol=1e-9)
    was, now = (np.linalg.norm(p - p.mean(axis=0), axis=1) for p in (before, after))
    if mode == "rotate":
        np.testing.assert_allclose(now, was)
        np.testing.assert_allclose(after[:, 2], before[:, 2], atol=1e-9)
        assert np.abs(after - before).max() > 0.01
    else:
        np.testing.assert_allclose(now, 2**0.5 * was, rtol=1e-6)
