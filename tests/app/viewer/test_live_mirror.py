"""The live mirror: whatever is done to a handle is done on the other side, as one step."""

import threading
from dataclasses import replace

import numpy as np
import pytest

import deformer
from deformer import InputError
from deformer_app.viewer import live_mirror
from deformer_app.viewer.changes import NoticeGiven, WaitBegun, WaitEnded
from deformer_app.viewer.edit import Handle, point
from deformer_app.viewer.gizmo import rotation, translation
from deformer_app.viewer.live_mirror import LiveMirror
from deformer_app.viewer.mirror_commands import MirrorCommands
from deformer_app.viewer.mirror_plane import MirrorPlane
from deformer_app.viewer.session import Session
from off_screen_editor import drag, finish, seen, texts


@pytest.fixture
def editor(editor):
    """An editor with the mirror on: the two ends of the tube are each other's partners."""
    editor.mirror.plane.set_across("x")
    editor.mirror.switch_live()
    assert editor.mirror.is_live
    return editor


def pair(editor, vertex=100):
    """Place a handle beside the plane; the handle and its partner."""
    number = editor.handles.place(vertex)
    editor.commit("Place handle")
    finish(editor)
    first = editor.edit.handle(number)
    partner = editor.mirror.live.partner(first, editor.edit.handles)
    assert partner is not None and partner.id != first.id
    return first, partner


def test_a_handle_is_placed_and_dragged_on_both_sides_with_the_mouse(editor):
    vertex, at = seen(editor, 0.95)
    shown = editor.vertices
    drag(editor, at, at + np.array([-25, -40]))
    first, second = editor.edit.handles
    symmetry = editor.mirror.plane.symmetry
    assert first.vertices == (vertex,) and second.vertices == (symmetry.opposite[vertex],)
    moved = np.subtract(first.targets, shown[[vertex]])
    assert np.abs(moved).max() > 0.05
    np.testing.assert_allclose(
        np.subtract(second.targets, shown[list(second.vertices)]),
        symmetry.mirror_directions(moved),
        atol=1e-9,
    )
    assert editor.handles.selected == {first.id}, "the partner follows, and is not selected"
    editor.undo()
    assert not editor.edit.handles, "one step for both"


def test_the_partner_of_what_is_dragged_follows_even_if_both_are_selected(editor):
    first, second = pair(editor)
    editor.handles.select([first.id, second.id])
    motion = np.array([0.1, 0.2, -0.1])
    editor.handles.move_selected(translation(motion))
    editor.commit("Move")
    lead, follower = editor.edit.handles
    np.testing.assert_allclose(np.subtract(lead.targets, first.targets), [motion], atol=1e-12)
    np.testing.assert_allclose(
        np.subtract(follower.targets, second.targets), [motion * [-1, 1, 1]], atol=1e-9
    )


def test_a_partner_keeps_its_own_kind_until_that_of_the_other_changes(editor):
    first, second = pair(editor)
    editor.mirror.switch_live()
    editor.handles.select([second.id])
    editor.handles.set_kind("exact")
    editor.mirror.switch_live()
    editor.handles.select([first.id])
    editor.handles.move_selected(translation([0.1, 0.2, -0.1]))
    editor.commit("Move")
    finish(editor)
    assert [h.kind for h in editor.edit.handles] == ["soft", "exact"]
    assert editor.edit.handle(second.id).targets != second.targets
    editor.handles.set_kind("exact")
    editor.handles.set_kind("soft")
    assert [h.kind for h in editor.edit.handles] == ["soft", "soft"]


@pytest.fixture
def coarse(monkeypatch):
    """Vertices of the tube are far apart: handles are partners up to 8 % of its size."""
    monkeypatch.setattr(live_mirror, "_NEAR", 0.08)


def beside_the_image(editor, vertex, low, high):
    """A vertex whose distance from the mirror image of another is a share of the body's size."""
    plane, rest = editor.mirror.plane, editor.model.reference
    image = plane.symmetry.mirror(rest.vertices[[vertex]])
    apart = np.linalg.norm(rest.vertices - image, axis=1) / rest.bounding_diagonal
    return int(np.flatnonzero((apart > low) & (apart < high))[0])


def test_a_handle_near_the_mirror_image_becomes_the_partner(editor, coarse):
    editor.mirror.switch_live()
    old = editor.handles.place(100)
    editor.commit("Place handle")
    finish(editor)
    editor.mirror.switch_live()
    was = editor.edit.handle(old)
    near = beside_the_image(editor, 100, 0.05, 0.08)
    new = editor.handles.place(near)
    assert len(editor.edit.handles) == 2 and editor.edit.handle(old) == was, "nothing is added"
    motion = np.array([0.1, 0.2, -0.1])
    editor.handles.move_selected(translation(motion))
    editor.commit("Place and drag")
    moved = editor.edit.handle(old)
    assert editor.edit.handle(new).vertices == (near,) and moved.vertices == was.vertices
    np.testing.assert_allclose(
        np.subtract(moved.targets, was.targets), [motion * [-1, 1, 1]], atol=1e-9
    )


def test_a_handle_far_from_the_mirror_image_gets_a_partner_of_its_own(editor, coarse):
    editor.mirror.switch_live()
    alone = editor.handles.place(100)
    editor.commit("Place handle")
    finish(editor)
    editor.mirror.switch_live()
    number = editor.handles.place(beside_the_image(editor, 100, 0.085, 0.12))
    live, handles = editor.mirror.live, editor.edit.handles
    found = live.partner(editor.edit.handle(number), handles)
    assert len(handles) == 3 and found is not None and found.id not in (alone, number)
    assert live.partner(editor.edit.handle(alone), handles) is None


def test_a_near_handle_that_has_a_partner_keeps_it(editor, coarse):
    first, second = pair(editor)
    near = beside_the_image(editor, 100, 0.05, 0.08)
    number = editor.handles.place(near)
    handles = editor.edit.handles
    assert len(handles) == 4
    live = editor.mirror.live
    assert live.partner(editor.edit.handle(first.id), handles).id == second.id
    assert live.partner(editor.edit.handle(number), handles).id not in (first.id, second.id)


def test_in_an_asymmetric_pose_nothing_jumps_and_moves_are_mirrored(editor):
    editor.mirror.switch_live()
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.0, 0.4, 0.2]))
    editor.commit("Place and drag")
    finish(editor)
    editor.handles.clear()
    editor.prior.start_from("an asymmetric example", editor.code)
    editor.prior.use_as_base()
    finish(editor)
    editor.mirror.switch_live()
    before = editor.vertices
    first, second = pair(editor)
    np.testing.assert_allclose(second.targets, before[list(second.vertices)], atol=1e-12)
    editor.handles.move_selected(translation([0.0, 0.1, 0.0]))
    editor.commit("Move")
    np.testing.assert_allclose(
        editor.edit.handle(second.id).targets,
        np.array(second.targets) + np.array([0.0, 0.1, 0.0]),
        atol=1e-9,
    )
    assert editor.edit.handle(first.id) != first


def test_kinds_weights_and_deleting_are_mirrored(editor):
    first, second = pair(editor)
    editor.handles.set_weight(3.0)
    editor.commit("Weight")
    assert editor.edit.handle(second.id).weight == 3.0
    editor.handles.set_kind("exact")
    assert editor.edit.handle(second.id).kind == "exact"
    editor.handles.set_kind("pin")
    ours, theirs = editor.edit.handle(first.id), editor.edit.handle(second.id)
    assert theirs.kind == "pin" and theirs.radius == ours.radius > 0
    opposite = editor.mirror.plane.symmetry.opposite
    assert set(theirs.patch) == set(opposite[list(ours.patch)].tolist())
    np.testing.assert_allclose(theirs.targets, editor.vertices[list(theirs.vertices)], atol=1e-9)
    editor.pins.resize(3.0)
    assert len(editor.edit.handle(second.id).patch) > len(theirs.patch)
    editor.handles.set_kind("soft")
    assert editor.edit.handle(second.id).vertices == second.vertices
    editor.handles.delete()
    assert not editor.edit.handles


def test_turns_are_mirrored(editor):
    first, second = pair(editor)
    editor.state.set_gizmo("rotate")
    editor.handles.move_selected(rotation(first.centre, [0.15, 0.25, 0.1]))
    editor.commit("Rotate")
    ours, theirs = editor.edit.handle(first.id), editor.edit.handle(second.id)
    assert ours.orientation is not None and theirs.orientation is not None
    # In the symmetric pose that the tube starts in, up to the rotations that it has there.
    np.testing.assert_allclose(
        theirs.orientation,
        editor.mirror.plane.symmetry.mirror_rotations(ours.orientation),
        atol=0.1,
    )


def test_regions_are_painted_on_both_sides(editor):
    editor.handles.add_region(range(96, 112))
    first, second = editor.edit.handles
    opposite = editor.mirror.plane.symmetry.opposite
    assert set(second.patch) == set(opposite[list(first.patch)].tolist())
    assert len(editor.session.entries) == 2


def test_handles_on_the_plane_stay_on_it(editor):
    plane = editor.mirror.plane.symmetry
    on_plane = int(np.flatnonzero(plane.opposite == np.arange(len(plane.opposite)))[0])
    editor.handles.place(on_plane)
    before = editor.edit.handles[0]
    editor.handles.move_selected(translation([0.3, 0.2, 0.1]))
    editor.commit("Place and drag")
    (handle,) = editor.edit.handles
    np.testing.assert_allclose(
        np.subtract(handle.targets, before.targets), [[0.0, 0.2, 0.1]], atol=1e-9
    )


def test_mirroring_while_it_is_on_makes_an_asymmetric_pair_symmetric(editor):
    """Copying to the other side is a change of the partner alone."""
    first, second = pair(editor)
    editor.mirror.switch_live()
    editor.handles.move_selected(translation([0.1, 0.3, 0.0]))
    editor.commit("Move")
    editor.mirror.switch_live()
    editor.handles.select([first.id])
    editor.mirror.mirror_handles()
    ours, theirs = editor.edit.handle(first.id), editor.edit.handle(second.id)
    np.testing.assert_allclose(theirs.targets, editor.mirror.plane.symmetry.mirror(ours.targets))
    np.testing.assert_allclose(
        np.subtract(ours.targets, first.targets), [[0.1, 0.3, 0.0]], atol=1e-12
    )


def test_what_is_loaded_with_both_sides_stays_as_it_is(editor):
    first, second = pair(editor)
    apart = [
        replace(first, targets=(point((2.2, 0.3, 0.0)),)),
        replace(second, targets=(point((-0.1, -0.5, 0.0)),)),
    ]
    editor.change("Load handles", editor.edit.with_handles(apart))
    assert list(editor.edit.handles) == apart


def test_it_is_off_again_after_a_second_press_and_partners_are_marked_while_it_is_on(editor):
    first, second = pair(editor)
    assert {h.id for h, _ in editor.mirror.live.pairs(editor.edit.handles)} == {first.id, second.id}
    editor.mirror.switch_live()
    assert not editor.mirror.live.pairs(editor.edit.handles)
    editor.handles.move_selected(translation([0.0, 0.1, 0.0]))
    editor.commit("Move")
    assert editor.edit.handle(second.id) == second


def test_the_window_goes_on_while_the_plane_is_looked_for(editor, monkeypatch):
    found, release, heard = deformer.find_symmetry, threading.Event(), []

    def slow(mesh):
        release.wait(60)
        return found(mesh)

    monkeypatch.setattr(deformer, "find_symmetry", slow)
    editor.mirror.begin(editor.model)  # without a plane
    editor.on_change.append(heard.append)
    editor.mirror.switch_live()
    editor.mirror.switch_live()  # by an impatient person
    editor.tick()
    assert not editor.mirror.is_live and not release.is_set()
    (wait,) = [change for change in heard if isinstance(change, WaitBegun | WaitEnded)]
    assert isinstance(wait, WaitBegun) and "plane" in wait.text
    release.set()
    finish(editor)
    assert editor.mirror.is_live
    assert [type(c) for c in heard if isinstance(c, WaitBegun | WaitEnded)] == [
        WaitBegun,
        WaitEnded,
    ]


def test_a_mirror_that_is_relative_says_so(editor):
    def told():
        heard = []
        editor.on_change.append(heard.append)
        editor.mirror.switch_live()
        editor.on_change.remove(heard.append)
        return " ".join(change.text for change in heard if isinstance(change, NoticeGiven))

    told()
    assert "relative" not in told() and editor.mirror.is_live
    told()
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.0, 0.4, 0.2]))
    editor.commit("Place and drag")
    finish(editor)
    assert editor.mirror.plane.asymmetry(editor.vertices) > 0.01
    assert "moves are mirrored relative to it" in told()


def test_a_body_without_sides_is_told_in_one_line(editor, heard):
    class _Crooked(MirrorPlane):
        is_symmetric = False  # pyright: ignore[reportAssignmentType]

    mirror = LiveMirror(_Crooked(editor.model))
    reason = mirror.switch()
    assert not mirror.on and reason and "\n" not in reason and "no two like sides" in reason
    editor.mirror._live = mirror
    editor.mirror.switch_live()
    finish(editor)
    assert texts(heard, NoticeGiven) == [reason]
    assert not editor.mirror.is_live


def test_without_a_model_there_is_no_mirror():
    commands = MirrorCommands(None)  # pyright: ignore[reportArgumentType]
    assert not commands.is_live
    with pytest.raises(InputError, match="open one first"):
        commands.switch_live()


def test_both_handles_of_a_pair_are_saved(editor, tmp_path):
    pair(editor)
    editor.save_session(tmp_path / "work.json")
    assert len(Session.load(tmp_path / "work.json").edit.handles) == 2
    assert all(isinstance(h, Handle) for h in editor.edit.handles)


def test_a_session_keeps_both_sides_and_the_plane(editor, model_path, tmp_path):
    first, second = pair(editor)
    editor.save_session(tmp_path / "both.json")
    editor.mirror.switch_live()
    editor.save_session(tmp_path / "alone.json")
    editor.open_model(model_path, Session.load(tmp_path / "both.json"))
    finish(editor)
    assert editor.mirror.is_live and editor.mirror.plane.across == "x"
    _, start = seen(editor, 0.2)
    drag(editor, start, start + np.array([0, -40]))
    moved = [handle for handle in editor.edit.handles if handle not in (first, second)]
    assert len(moved) == 2, "a drag with the mouse acts on both sides"
    editor.open_model(model_path, Session.load(tmp_path / "alone.json"))
    assert not editor.mirror.is_live and editor.mirror.plane.across == "x"
    editor.open_model(model_path)
    assert not editor.mirror.is_live and editor.mirror.plane.across is None


def test_a_session_saved_while_the_plane_is_looked_for_has_both_sides(editor, monkeypatch):
    release, found = threading.Event(), deformer.find_symmetry
    monkeypatch.setattr(deformer, "find_symmetry", lambda mesh: release.wait(60) and found(mesh))
    editor.mirror.begin(editor.model)
    editor.mirror.switch_live()
    editor.tick()
    assert not editor.mirror.is_live
    assert editor.mirror.as_json() == {"both_sides": True, "across": None}
    release.set()
    finish(editor)
