"""Handles that become exact: how the surface goes to them, and what is said."""

from dataclasses import replace

import numpy as np

from deformer_app.viewer.changes import NoticeGiven
from deformer_app.viewer.gizmo import translation
from off_screen_editor import finish


def test_an_exact_handle_takes_the_surface_along_smoothly_and_says_how_far(editor):
    heard, drawn = [], []
    size = editor.model.reference.bounding_diagonal
    editor.handles.place(100)
    editor.commit("Place")
    editor.change("Noise", replace(editor.edit, noise=0.05))
    editor.handles.move_selected(translation([0.0, 0.3, 0.1]))
    editor.commit("Drag")
    finish(editor)
    before, (handle,) = editor.vertices.copy(), editor.edit.handles
    off = np.linalg.norm(before[100] - handle.centre) / size
    assert off > 0.01
    move = editor.state.view.surface.move
    editor.state.view.surface.move = lambda v, n: drawn.append(v.copy()) or move(v, n)
    editor.on_change.append(heard.append)
    editor.handles.set_kind("exact")
    finish(editor)
    np.testing.assert_allclose(drawn[0], before, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(editor.vertices[100], handle.centre, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(drawn[-1], editor.vertices, rtol=0, atol=1e-3 * size)
    (note,) = [change.text for change in heard if isinstance(change, NoticeGiven)]
    assert f"{off:.1%} of the body's size" in note


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
