"""The floor of the viewer: its switch, its height, its grid, and what is kept of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

import deformer
from deformer import io
from deformer_app.viewer.exports import export_handles
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.handle_changes import region_handle
from deformer_app.viewer.pose_worker import replay
from deformer_app.viewer.rigs import load_handles
from deformer_app.viewer.session import Session
from number_fields import type_centre, type_height
from off_screen_editor import finish


def lowest(editor):
    return editor.vertices[:, 1].min()


def pull_down(editor, vertex=115):
    """Drag a handle below the floor."""
    editor.handles.place(vertex)
    size = editor.model.reference.bounding_diagonal
    for step in range(1, 5):
        editor.handles.move_selected(translation([0.0, -0.07 * step * size, 0.0]))
        editor.tick()
    editor.commit("Place and drag")
    finish(editor)


def test_it_is_switched_on_where_the_examples_stand_and_off_again(editor):
    editor.floor.switch()
    finish(editor)
    assert editor.floor.height == pytest.approx(deformer.Floor.under(editor.model).height)
    editor.floor.switch()
    assert editor.floor.height is None
    editor.undo()
    assert editor.floor.height is not None


def test_nothing_that_is_dragged_passes_it(editor):
    type_height(editor, float(lowest(editor)) - 0.05)
    pull_down(editor)
    size = editor.model.reference.bounding_diagonal
    assert lowest(editor) >= editor.floor.height - 1e-9 * size
    assert lowest(editor) < editor.floor.height + 0.01 * size, "it lies on the floor"


def test_a_handle_stops_at_it_and_comes_up_at_once(editor):
    type_height(editor, float(lowest(editor)) - 0.05)
    pull_down(editor)
    floor, size = editor.floor.height, editor.model.reference.bounding_diagonal
    assert editor.edit.handles[0].centre[1] == pytest.approx(floor)
    editor.handles.move_selected(translation([0.0, 0.02 * size, 0.0]))
    editor.commit("Up")
    assert editor.edit.handles[0].centre[1] == pytest.approx(floor + 0.02 * size)
    x, _, z = editor.edit.handles[0].centre
    type_centre(editor, [x, floor - size, z])
    assert editor.edit.handles[0].centre[1] == pytest.approx(floor)


def test_a_region_that_is_dragged_below_it_keeps_its_shape(editor):
    type_height(editor, float(lowest(editor)) - 0.05)
    region = np.flatnonzero(editor.model.reference.vertices[:, 0] > 1.6)
    handle = editor.handles.on_surface(region_handle(1, region, editor.model.reference))
    editor.change("Region", editor.edit.with_handles([handle]))
    editor.handles.select([1])
    finish(editor)
    before = np.array(handle.targets)
    size = editor.model.reference.bounding_diagonal
    editor.handles.move_selected(translation([0.0, -0.5 * size, 0.0]))
    editor.commit("Down")
    after = np.array(editor.edit.handles[0].targets)
    assert after[:, 1].min() == pytest.approx(editor.floor.height)
    np.testing.assert_allclose(after - after[0], before - before[0], atol=1e-12)


def test_what_is_below_it_is_drawn_where_it_acts(editor):
    pull_down(editor)
    (handle,) = editor.edit.handles
    size = editor.model.reference.bounding_diagonal
    floor = handle.centre[1] + 0.06 * size
    type_height(editor, floor)
    finish(editor)
    editor.handles.select([handle.id])
    dots = editor.state.drawn_handles(editor.vertices, editor.edit.handles).dots
    x, _, z = handle.centre
    np.testing.assert_allclose(dots.targets, [[x, floor, z]])
    assert editor.stage.gizmo is not None
    np.testing.assert_allclose(editor.stage.gizmo.centre, [x, floor, z])
    editor.floor.switch()
    finish(editor)
    dots = editor.state.drawn_handles(editor.vertices, editor.edit.handles).dots
    np.testing.assert_allclose(dots.targets, [handle.centre])


def test_without_it_the_body_goes_where_it_is_dragged(editor):
    height = float(lowest(editor)) - 0.05
    pull_down(editor)
    assert lowest(editor) < height - 0.1


def test_the_base_alone_stands_above_it(editor):
    height = float(lowest(editor)) + 0.1
    type_height(editor, height)
    finish(editor)
    assert lowest(editor) == pytest.approx(height)


def test_the_grid_is_drawn_in_both_themes(editor):
    def pictures():
        finish(editor)
        editor.state.invalidate()
        finish(editor)
        return editor.state.view.grab().astype(int)

    for dark in (False, True):
        editor.picture.change_look(dark=dark)
        without = pictures()
        type_height(editor, float(editor.model.reference.vertices[:, 1].min()) - 0.3)
        changed = np.abs(pictures() - without).sum(axis=2) > 6
        assert changed.mean() > 0.005
        # It fades: the borders of the picture are as before.
        assert not changed[0].any()
        editor.floor.switch()


def test_a_session_keeps_it_and_gives_the_same_pose(editor, tmp_path):
    type_height(editor, float(lowest(editor)) - 0.05)
    pull_down(editor)
    editor.save_session(tmp_path / "work.json")
    again = Session.load(tmp_path / "work.json")
    assert again.edit.floor == editor.floor.height
    np.testing.assert_allclose(replay(again, editor.model).vertices, editor.vertices, atol=1e-6)


def test_sessions_of_earlier_versions_have_none(editor, tmp_path):
    editor.save_session(tmp_path / "work.json")
    data = json.loads((tmp_path / "work.json").read_text())
    for entry in data["entries"]:
        del entry["floor"]
    (tmp_path / "old.json").write_text(json.dumps(data))
    assert Session.load(tmp_path / "old.json").edit.floor is None


def test_exported_handles_have_it(editor, tmp_path):
    type_height(editor, float(lowest(editor)) - 0.05)
    pull_down(editor)
    height, shown = editor.floor.height, editor.vertices
    export_handles(editor, tmp_path / "h.json")
    file = io.load_handles(tmp_path / "h.json", len(shown), components=editor.model.components)
    assert file.floor == height
    editor.change("No floor", replace(editor.edit, floor=None, handles=()))
    load_handles(editor, tmp_path / "h.json")
    finish(editor)
    assert editor.floor.height == height
    np.testing.assert_allclose(
        editor.vertices, shown, atol=1e-3 * editor.model.reference.bounding_diagonal
    )
