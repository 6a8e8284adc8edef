"""Saved poses, their libraries, blends, and what of them a session stores."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformer import InputError, local_rotations
from deformer_app.viewer.changes import NoticeGiven, PosesChanged
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.pose_blend import PoseBlend
from deformer_app.viewer.pose_commands import (
    change_poses,
    copied,
    export_poses,
    import_poses,
    paste,
    paste_mirrored,
    save_pose,
    start_from,
)
from deformer_app.viewer.poses import PoseShelf, SavedPose
from deformer_app.viewer.session import Session
from deformer_app.viewer.timeline.keys import SLIDERS
from off_screen_editor import finish, texts

A, B, C = (SavedPose.of_code(name, (0.1, float(n))) for n, name in enumerate("abc"))


def pose_by_hand(editor):
    """Drag vertex 100 up, with vertex 8 as a pin."""
    editor.handles.place(8)
    editor.commit("Place")
    editor.handles.set_kind("pin")
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.0, 0.2, 0.1]))
    editor.commit("Drag")
    finish(editor)


def names(shelf):
    return [pose.name for pose in shelf.poses]


def test_poses_are_added_moved_renamed_deleted_and_brought_back():
    shelf = PoseShelf([A, B])
    assert shelf.add(C) == C and shelf.add(A).name == "a 2"
    shelf.move(3, 0)
    assert names(shelf) == ["a 2", "a", "b", "c"]
    shelf.rename(0, " first ")
    assert names(shelf) == ["first", "a", "b", "c"]
    assert shelf.delete(1) == A and shelf.deleted == A
    assert names(shelf) == ["first", "b", "c"]
    assert shelf.restore() == A and names(shelf) == ["first", "a", "b", "c"]
    assert shelf.deleted is None and shelf.restore() is None
    assert shelf.next_name() == "Pose 1"


@pytest.mark.parametrize("name", ["", "  ", "b", "a\nb", "x" * 61])
def test_a_name_that_is_none_or_taken_leaves_the_pose_as_it_is(name):
    shelf = PoseShelf([A, B])
    with pytest.raises(InputError, match="choose another"):
        shelf.rename(0, name)
    assert shelf.poses == (A, B)


def test_a_saved_pose_is_started_from_again_as_it_was(editor):
    told = []
    pose_by_hand(editor)
    before, was = editor.vertices.copy(), editor.edit
    editor.on_change.append(lambda change: told.append(type(change)))
    saved = save_pose(editor)
    assert saved.name == "Pose 1" and PosesChanged in told and editor.session.changed
    assert saved.handles == was.handles and saved.code == tuple(editor.code.tolist())
    editor.prior.reset()
    editor.floor.switch()
    finish(editor)
    start_from(editor, saved)
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, atol=1e-12)
    used = [h.id for entry in editor.session.entries[:-1] for h in entry.edit.handles]
    assert not {h.id for h in editor.edit.handles} & set(used), "ids of a session are used once"
    now = tuple(replace(h, id=w.id) for h, w in zip(editor.edit.handles, was.handles, strict=True))
    assert replace(editor.edit, handles=now) == was
    assert editor.session.entry.label == "Start from Pose 1"
    # It goes on from there: the next drag starts where the pose is.
    editor.handles.place(60)
    editor.commit("Place")
    finish(editor)
    size = editor.model.reference.bounding_diagonal
    assert np.abs(editor.vertices - before).max() < 1e-3 * size
    editor.undo()
    editor.undo()
    finish(editor)
    assert not editor.edit.handles and names(editor.session.shelf) == ["Pose 1"]


def test_a_pose_whose_state_is_there_already_is_shown_as_it_was_saved(editor):
    """Another way to the same state, as by a blend and back, may end beside it."""
    pose_by_hand(editor)
    before, saved = editor.vertices.copy(), save_pose(editor)
    beside = replace(saved.solution, z=tuple(1.05 * np.array(saved.solution.z)))
    editor.session.show_solution(beside)
    editor.ask(beside)
    finish(editor)
    assert np.abs(editor.vertices - before).max() > 1e-3
    start_from(editor, saved)
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, atol=1e-12)


def test_the_shape_of_a_saved_pose_is_started_from_with_the_present_handles(editor):
    pose_by_hand(editor)
    saved = save_pose(editor)
    editor.prior.reset()
    editor.handles.place(60)
    editor.commit("Place")
    finish(editor)
    editor.prior.start_at("Shape", saved.code)
    finish(editor)
    np.testing.assert_allclose(editor.vertices, editor.model.decode(saved.code), atol=1e-4)
    assert [h.vertices for h in editor.edit.handles] == [(60,)]


def test_a_pose_without_handles_takes_the_present_ones_along(editor):
    saved = save_pose(editor)
    pose_by_hand(editor)
    kinds = [(h.id, h.kind) for h in editor.edit.handles]
    start_from(editor, saved)
    finish(editor)
    assert [(h.id, h.kind) for h in editor.edit.handles] == kinds


def test_poses_of_earlier_versions_have_a_code_and_handles_alone(editor, tmp_path):
    file = tmp_path / "poses.json"
    pose_by_hand(editor)
    before = editor.vertices.copy()
    save_pose(editor, "reach")
    export_poses(editor, file)
    data = json.loads(file.read_text())
    for key in ("base", "noise", "body", "floor", "solution"):
        del data["poses"][0][key]
    file.write_text(json.dumps(data))
    editor.prior.reset()
    finish(editor)
    away = np.abs(editor.vertices - before).max()
    import_poses(editor, file)
    saved = editor.session.shelf.poses[1]
    start_from(editor, saved)
    finish(editor)
    assert [h.kind for h in editor.edit.handles] == ["pin", "soft"]
    assert np.abs(editor.vertices - before).max() < 0.2 * away


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_pins_hold_while_a_pose_is_blended_or_started_from(editor, share):
    pose_by_hand(editor)
    finish(editor)
    pin, soft = editor.edit.handles
    size = editor.model.reference.bounding_diagonal
    code = editor.model.codes[5]
    blend = PoseBlend(editor)
    blend.choose(SavedPose.of_code("Shape 5", tuple(code.tolist())))
    blend.move(share)
    blend.commit()
    finish(editor)
    assert editor.edit.handles[0].targets == pin.targets
    off = editor.vertices[list(pin.vertices)] - np.array(pin.targets)
    assert np.abs(off).max() < 1e-4 * size
    assert editor.edit.handles[1].targets != soft.targets
    if share == 1.0:  # the other handle keeps the surface where the pin has brought it, no more
        before = editor.vertices.copy()
        editor.change("Without", editor.edit.without([soft.id]))
        finish(editor)
        assert np.abs(editor.vertices - before).max() < 0.08 * size
        editor.undo()
        finish(editor)
        editor.prior.start_from("Shape 5", code)
        finish(editor)
        assert editor.edit.handles[0].targets == pin.targets
        off = editor.vertices[list(pin.vertices)] - np.array(pin.targets)
        assert np.abs(off).max() < 1e-4 * size


def test_a_blend_begins_where_the_pose_is_and_ends_at_a_saved_one(editor):
    size = editor.model.reference.bounding_diagonal
    pose_by_hand(editor)
    saved = save_pose(editor, "reach")
    reached = editor.vertices.copy()
    editor.prior.reset()
    finish(editor)
    blend = PoseBlend(editor)
    blend.choose(saved)
    blend.move(0.5)
    blend.move(1.0)
    blend.commit()
    finish(editor)
    np.testing.assert_allclose(editor.vertices, reached, atol=1e-12)
    editor.undo()
    editor.handles.place(60)
    editor.handles.move_selected(translation([0.3, 0.0, 0.2]))
    editor.commit("Pull")
    finish(editor)
    start, before = editor.vertices.copy(), editor.edit
    blend.move(0.001)
    finish(editor)
    apart = np.abs(reached - start).max()
    assert np.abs(editor.vertices - start).max() < 0.003 * size < 0.03 * apart
    blend.move(0.999)
    finish(editor)
    assert np.abs(editor.vertices - reached).max() < 0.005 * size
    assert [h.kind for h in editor.edit.handles] == ["soft", "pin", "soft"]
    blend.move(1.0)
    blend.commit()
    finish(editor)
    np.testing.assert_allclose(editor.vertices, reached, atol=1e-12)
    assert [h.targets for h in editor.edit.handles] == [h.targets for h in saved.handles]
    # Back at the start it is the state of the start.
    blend.move(0.0)
    blend.commit()
    finish(editor)
    assert editor.edit == before
    np.testing.assert_allclose(editor.vertices, start, atol=1e-3 * size)


def test_handles_and_their_keys_go_along_to_a_pose_that_is_started_from(editor):
    pose_by_hand(editor)
    editor.change("Free", editor.edit.without([editor.edit.handles[0].id]))
    editor.handles.place(60)
    (R,) = local_rotations(editor.model, [60], editor.vertices)
    editor.commit("Place")
    handle = editor.edit.handles[-1]
    editor.change("Turn", editor.edit.with_handles([handle.oriented(R)]))
    editor.timeline.keys.set([SLIDERS, *(h.id for h in editor.edit.handles)])
    finish(editor)
    before, chosen, clip = editor.edit, editor.handles.selected, editor.timeline.clip
    code = editor.model.codes[3]
    shape = editor.model.decode(code)
    editor.prior.start_from("Shape 3", code)
    finish(editor)
    after = editor.edit
    assert [(h.id, h.kind, h.vertices) for h in after.handles] == [
        (h.id, h.kind, h.vertices) for h in before.handles
    ]
    assert editor.handles.selected == chosen
    # What the orientation asks of the surface is a little more than the shape has.
    off = np.abs(editor.vertices - shape).max()
    assert off < 1e-3 * editor.model.reference.bounding_diagonal
    for handle in after.handles:
        np.testing.assert_allclose(handle.targets, shape[list(handle.vertices)])
    (turn,) = local_rotations(editor.model, [60], shape)
    np.testing.assert_allclose(after.handles[-1].orientation, turn)
    assert editor.timeline.clip.names == clip.names, "the key at the playhead is the new pose"
    assert editor.timeline.clip.at(after, 0) == after
    editor.undo()
    finish(editor)
    assert editor.edit == before and editor.timeline.clip == clip


def test_a_saved_pose_started_with_its_handles_goes_on_with_those_that_are_there(editor):
    pose_by_hand(editor)
    saved = save_pose(editor)
    editor.timeline.keys.set()
    ids = [handle.id for handle in editor.edit.handles]
    editor.handles.move_selected(translation([0.0, 0.1, 0.0]))
    editor.commit("Move")
    start_from(editor, saved)
    finish(editor)
    assert [handle.id for handle in editor.edit.handles] == ids
    assert {owner for owner, _ in editor.timeline.rows} >= set(ids)
    assert [h.targets for h in editor.edit.handles] == [h.targets for h in saved.handles]


def test_handles_at_the_same_place_keep_ids_of_their_own(editor):
    """As those of a mirrored pose may be, whose vertices have one opposite."""
    editor.handles.place(100)
    editor.commit("Place")
    finish(editor)
    (handle,) = editor.edit.handles
    twice = editor.edit.with_handles([replace(handle, id=7)])
    start_from(editor, SavedPose("two", twice))
    first, second = editor.edit.handles
    assert first.id == handle.id != second.id


def test_a_session_stores_its_poses_and_older_ones_open(editor, tmp_path):
    file = tmp_path / "s.json"
    pose_by_hand(editor)
    save_pose(editor, "reach")
    editor.save_session(file)
    assert not editor.session.changed
    again = Session.load(file)
    assert again.shelf.poses == editor.session.shelf.poses and not again.changed
    change_poses(editor, lambda shelf: shelf.rename(0, "stretch"))
    assert editor.session.changed
    older = json.loads(file.read_text())
    del older["poses"], older["component_names"]
    file.write_text(json.dumps(older))
    assert Session.load(file).shelf.poses == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["poses"].append(d["poses"][0]), r"poses\[1\].name: expected a name that no"),
        (lambda d: d["poses"][0].update(name=3), r"poses\[0\]"),
        (lambda d: d["poses"][0].update(name=""), "name of a pose"),
        (lambda d: d["poses"][0].update(more=1), "unknown key 'more'"),
        (lambda d: d["poses"][0]["code"].pop(), r"poses\[0\].base: expected a list of 5"),
        (lambda d: d["poses"][0]["solution"]["z"].pop(), "5 numbers, expected the model's 6"),
        (lambda d: d["poses"][0]["solution"].update(contacts=[9999]), "contact at vertex 9999"),
        (lambda d: d["poses"][0].pop("solution"), r"poses\[0\]: no 'solution'"),
        (lambda d: d["poses"][0].update(noise=0), r"poses\[0\].noise"),
        (lambda d: d["poses"][0]["code"].append("x"), r"poses\[0\].code\[6\]"),
        (lambda d: d["poses"][0]["handles"][1].update(vertices=[9999]), "vertex 9999, expected"),
        (lambda d: d["poses"][0]["handles"][0].pop("kind"), r"poses\[0\].handles\[0\]: no 'kind'"),
        (lambda d: d["component_names"].update(x="nod"), "component_names"),
    ],
)
def test_damaged_poses_are_one_line_that_names_the_file(editor, tmp_path, change, words):
    file = tmp_path / "s.json"
    pose_by_hand(editor)
    save_pose(editor)
    editor.save_session(file)
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match=words) as told:
        editor.open_session(file)
    assert str(file) in str(told.value) or str(editor.session.model.path) in str(told.value)
    assert "\n" not in str(told.value)


def test_a_library_goes_to_another_session_of_the_model_and_to_no_other_model(editor, tmp_path):
    file = tmp_path / "poses.json"
    with pytest.raises(InputError, match="no saved poses"):
        export_poses(editor, file)
    pose_by_hand(editor)
    save_pose(editor, "reach")
    export_poses(editor, file)
    import_poses(editor, file)
    first, second = editor.session.shelf.poses
    assert second == replace(first, name="reach 2")
    editor.open_model(editor.session.model.path)
    finish(editor)
    import_poses(editor, file)
    assert editor.session.shelf.poses == (first,)
    model = editor.model
    replace(model, codes=1.01 * model.codes).save(tmp_path / "other")
    editor.open_model(tmp_path / "other")
    finish(editor)
    with pytest.raises(InputError, match="poses made with another model than this one") as told:
        import_poses(editor, file)
    assert str(file) in str(told.value) and not editor.session.shelf.poses


def test_sessions_and_poses_of_a_model_that_was_trained_anew_are_told_so(
    editor, tmp_path, model_path
):
    save_pose(editor, "reach")
    poses, session = tmp_path / "poses.json", tmp_path / "work.json"
    export_poses(editor, poses)
    editor.save_session(session)
    model = editor.model
    replace(model, codes=1.01 * model.codes).save(model_path)
    with pytest.raises(InputError, match="trained anew or changed since") as told:
        editor.open_session(session)
    assert str(session) in str(told.value) and "open that one" not in str(told.value)
    editor.open_model(model_path)
    finish(editor)
    with pytest.raises(InputError, match="trained anew or changed since") as told:
        import_poses(editor, poses)
    assert str(poses) in str(told.value) and "open that one" not in str(told.value)


def test_a_copied_pose_is_pasted_as_it_was_and_can_be_undone(editor):
    pose_by_hand(editor)
    before, handles, text = editor.vertices.copy(), editor.edit.handles, copied(editor)
    editor.prior.reset()
    editor.handles.place(60)
    editor.commit("Place")
    finish(editor)
    told = []
    editor.on_change.append(told.append)
    paste(editor, text)
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, atol=1e-12)
    assert [h.targets for h in editor.edit.handles] == [h.targets for h in handles]
    assert editor.session.entry.label == "Paste pose"
    assert texts(told, NoticeGiven) == ["Its handles replace the one that was there"]
    editor.undo()
    finish(editor)
    assert [h.vertices for h in editor.edit.handles] == [(60,)]
    for wrong in ("", "some text", '{"deformer_poses": 1}', '{"deformer_poses": [}'):
        with pytest.raises(InputError, match="clipboard"):
            paste(editor, wrong)


def test_a_pose_pasted_mirrored_is_its_image(editor):
    pose_by_hand(editor)
    was, text = editor.edit, copied(editor)
    paste_mirrored(editor, text)
    finish(editor)
    assert editor.session.entry.label == "Paste pose mirrored"
    symmetry = editor.mirror.plane.symmetry
    for handle, source in zip(editor.edit.handles, was.handles, strict=True):
        assert handle.kind == source.kind
        assert handle.vertices == tuple(symmetry.opposite[list(source.vertices)])
        np.testing.assert_allclose(handle.targets, symmetry.mirror(source.targets))
    at = [v for handle in editor.edit.handles for v in handle.vertices]
    wanted = [target for handle in editor.edit.handles for target in handle.targets]
    size = editor.model.reference.bounding_diagonal
    off = np.abs(editor.vertices[at] - wanted).max(axis=1) / size
    assert (off < [1e-6, 1e-6, 0.05]).all()
    editor.undo()
    finish(editor)
    assert editor.edit == was


def test_a_pose_of_a_code_alone_is_pasted_mirrored_with_the_present_handles(editor):
    editor.prior.start_from("Shape 3", editor.model.codes[3])
    finish(editor)
    code, text = editor.code.copy(), copied(editor)
    editor.handles.place(100)
    editor.commit("Place")
    paste_mirrored(editor, text)
    finish(editor)
    image = editor.mirror.plane.mirrored_code(code)
    np.testing.assert_allclose(editor.code, image)
    shape = editor.model.decode(image)
    for handle in editor.edit.handles:
        np.testing.assert_allclose(handle.targets, shape[list(handle.vertices)])


def test_a_blend_is_live_goes_on_and_is_one_step(editor):
    pose_by_hand(editor)
    editor.change(
        "Free",
        editor.edit.with_handles([replace(handle, kind="soft") for handle in editor.edit.handles]),
    )
    finish(editor)
    blend, start = PoseBlend(editor), np.array(editor.edit.base)
    steps = len(editor.session.entries)
    chosen = tuple(editor.model.codes[5].tolist())
    blend.move(0.5)
    assert not editor.session.under_way, "nothing is chosen"
    blend.choose(SavedPose.of_code("Shape 5", chosen))
    for share in (0.1, 0.4, 0.25):
        blend.move(share)
    finish(editor)
    quarter = 0.75 * start + 0.25 * np.array(chosen)
    np.testing.assert_allclose(editor.edit.base, quarter)
    assert len(editor.session.entries) == steps and editor.session.under_way
    blend.commit()
    assert editor.session.entry.label == "Blend with Shape 5" and blend.share == 0.25
    # It goes on from the same start, until something else changes the pose.
    blend.move(1.0)
    blend.commit()
    finish(editor)
    np.testing.assert_allclose(editor.code, chosen)
    assert len(editor.edit.handles) == 2, "they go along, and none of them pulls"
    np.testing.assert_allclose(editor.vertices, editor.model.decode(chosen), atol=1e-5)
    editor.undo()
    assert blend.share == 0.0
    editor.undo()
    assert len(editor.edit.handles) == 2 and len(editor.session.entries) == steps + 2
    finish(editor)
    blend.move(0.5)
    finish(editor)
    np.testing.assert_allclose(editor.edit.base, 0.5 * start + 0.5 * np.array(chosen))
