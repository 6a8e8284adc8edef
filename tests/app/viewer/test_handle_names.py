"""Names of handles: by place, given, kept in files; and the selection through undo and redo."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformer import InputError, io
from deformer_app.viewer.exports import export_handles
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.handle_changes import image, mirrored
from deformer_app.viewer.handle_names import opposite_name
from deformer_app.viewer.handle_rows import handles_of_rows
from deformer_app.viewer.pose_commands import save_pose, start_from
from deformer_app.viewer.session import Session
from deformer_app.viewer.timeline.exports import handle_frames
from off_screen_editor import finish


@pytest.fixture
def handles(editor):
    """Handles at vertices 8 and 100 of an editor, the second one selected."""
    for vertex in (8, 100):
        editor.handles.place(vertex)
        editor.commit("Place")
    finish(editor)
    return editor.handles


def test_a_handle_is_named_by_its_place_on_the_body_whatever_the_pose(editor, handles):
    names = [handles.names.of(handle) for handle in editor.edit.handles]
    # The tube lies along x: vertex 8 is at its left end, as of somebody who faces the viewer.
    ends = editor.model.reference.vertices[[8, 100], 0]
    assert ends[0] < ends[1]
    assert [name.split()[-1] for name in names] == ["8", "100"]
    assert ("right" in names[0].lower()) != ("right" in names[1].lower())
    editor.handles.move_selected(translation([-3.0, 0.0, 0.0]))
    editor.commit("Move")
    assert [handles.names.of(handle) for handle in editor.edit.handles] == names


def test_a_given_name_is_shown_everywhere_and_is_a_step_that_moves_nothing(editor, handles):
    fitted = editor.timeline
    fitted.keys.set()
    finish(editor)
    before, solution = editor.vertices.copy(), editor.session.entry.solution
    clip = fitted.fitted
    handles.names.rename(1, "  left foot ")
    assert editor.session.entry.label == "Rename handle"
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, rtol=0, atol=1e-12)
    assert editor.session.entry.solution == solution
    assert clip is not None and fitted.fitted is clip, "the clip is not fitted again"
    assert (1, "left foot") in fitted.rows
    editor.state.hovered = replace(editor.state.hovered, handle=1)
    assert editor.stage.hint.startswith("left foot: drag")
    editor.undo()
    assert "left foot" not in dict(fitted.rows).values()
    editor.redo()
    handles.names.rename(1, "")
    assert handles.names.of(editor.edit.handle(1)).endswith(" 8")


def test_no_hint_is_about_a_handle_that_undo_has_removed(editor, handles):
    editor.state.hovered = replace(editor.state.hovered, handle=2)
    assert "drag the handle" in editor.stage.hint
    editor.undo()
    finish(editor)
    assert "drag the handle" not in editor.stage.hint
    editor.redo()
    finish(editor)
    assert "drag the handle" in editor.stage.hint


@pytest.mark.parametrize("name", ["foot", "a\nb", "x" * 61])
def test_a_name_that_is_taken_or_none_changes_nothing(editor, handles, name):
    handles.names.rename(2, "foot")
    before = editor.edit
    with pytest.raises(InputError, match="choose another"):
        handles.names.rename(1, name)
    assert editor.edit == before


def test_names_are_kept_in_sessions_poses_and_handle_files(editor, handles, tmp_path):
    handles.names.rename(1, "left foot")
    saved = save_pose(editor)
    editor.save_session(tmp_path / "s.json")
    assert Session.load(tmp_path / "s.json").edit == editor.edit
    export_handles(editor, tmp_path / "h.json")
    file = io.load_handles(tmp_path / "h.json", len(editor.model.reference.vertices))
    assert [row.name for row in file.frames[0]] == ["left foot", ""]
    assert [h.name for h in handles_of_rows("h.json", file, 1)] == ["left foot", ""]
    handles.clear()
    start_from(editor, saved)
    assert [h.name for h in editor.edit.handles] == ["left foot", ""]
    editor.timeline.keys.set()
    finish(editor)
    rows = handle_frames(editor.timeline.fitted, editor.edit.handles)["frames"][0]
    assert [row.get("name") for row in rows] == ["left foot", None]
    older = json.loads((tmp_path / "s.json").read_text())
    for handle in older["handles"]:
        del handle["name"]
    (tmp_path / "s.json").write_text(json.dumps(older))
    assert [h.name for h in Session.load(tmp_path / "s.json").edit.handles] == ["", ""]


def test_the_other_side_has_the_other_name(editor, handles):
    assert opposite_name("Left foot") == "Right foot" and opposite_name("toe, right") == "toe, left"
    assert opposite_name("leftover") == "" == opposite_name("nose")
    handles.names.rename(1, "left foot")
    symmetry = editor.mirror.plane.symmetry
    handle = editor.edit.handle(1)
    assert image(handle, symmetry).name == "right foot"
    (copy,) = mirrored(editor.edit, [handle], symmetry, 9)
    assert copy.name == "right foot"
    known = editor.edit.with_handles([replace(copy, name="the other")])
    assert mirrored(known, [handle], symmetry, 10)[0].name == "the other"


def test_undo_and_redo_keep_the_selection(editor, handles):
    assert handles.selected == {2}
    handles.select([1, 2])
    handles.move_selected(translation([0.0, 0.1, 0.0]))
    editor.commit("Move")
    editor.undo()
    assert handles.selected == {1, 2}
    editor.undo()
    assert handles.selected == {1}, "the second one is not there"
    editor.redo()
    assert handles.selected == {1, 2}
    handles.delete()
    assert handles.selected == frozenset()
    editor.undo()
    assert handles.selected == {1, 2}
    editor.undo()
    editor.undo()
    handles.select([])
    editor.redo()
    assert handles.selected == frozenset(), "meanwhile the user has selected something else"
