"""Handles that become exact: how the surface goes to them, and what is said."""

from dataclasses import replace

import numpy as np

from deformer_app.viewer.changes import NoticeGiven
from deformer_app.viewer.gizmo import translation
from off_screen_editor import finish, texts


def pull_short(editor):
    """Drag a soft handle, which the surface does not follow to its target."""
    editor.handles.place(100)
    editor.commit("Place")
    editor.change("Noise", replace(editor.edit, noise=0.05))
    editor.handles.move_selected(translation([0.0, 0.3, 0.1]))
    editor.commit("Drag")
    finish(editor)


def test_an_exact_handle_takes_the_surface_along_smoothly_and_says_how_far(editor):
    told, drawn = [], []

    def hear(change):
        """Note what is said, and how far the surface is off when it is said."""
        if isinstance(change, NoticeGiven):
            told.append((change.text, np.linalg.norm(editor.vertices[100] - handle.centre) / size))

    size = editor.model.reference.bounding_diagonal
    pull_short(editor)
    before, (handle,) = editor.vertices.copy(), editor.edit.handles
    off = np.linalg.norm(before[100] - handle.centre) / size
    assert off > 0.01
    move = editor.state.view.surface.move
    editor.state.view.surface.move = lambda v, n: drawn.append(v.copy()) or move(v, n)
    editor.on_change.append(hear)
    editor.handles.set_kind("exact")
    finish(editor)
    np.testing.assert_allclose(drawn[0], before, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(editor.vertices[100], handle.centre, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(drawn[-1], editor.vertices, rtol=0, atol=1e-3 * size)
    ((note, now),) = told
    assert f"was {off:.1%} of the body's size off its target, and is {now:.1%} off now" in note
    assert now < 1e-6


def test_what_is_undone_before_the_surface_has_moved_is_not_told(editor, heard):
    pull_short(editor)
    editor.handles.set_kind("exact")
    editor.undo()
    finish(editor)
    assert editor.edit.handles[0].kind == "soft" and not texts(heard, NoticeGiven)


def test_a_handle_on_the_surface_becomes_exact_without_a_move_or_a_word(editor):
    heard = []
    size = editor.model.reference.bounding_diagonal
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.0, 0.3, 0.1]))
    editor.commit("Drag")
    finish(editor)
    editor.handles.place(60)
    editor.commit("Place")
    finish(editor)
    before = editor.vertices.copy()
    editor.on_change.append(heard.append)
    editor.handles.set_kind("exact")
    finish(editor)
    assert np.abs(editor.vertices - before).max() < 1e-3 * size
    assert not [change for change in heard if isinstance(change, NoticeGiven)]
