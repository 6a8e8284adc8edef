"""The editor on an off-screen plotter: what a person does with the mouse, and what comes of it."""

import json
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import deformer
from deformer import InputError, io
from deformer_app.viewer.changes import FrameDrawn, MistakeMade, NoticeGiven
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.exports import export_handles, export_pose
from deformer_app.viewer.gizmo import rotation, translation
from deformer_app.viewer.handle_rows import handle_rows
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.pose_worker import PoseWorker, replay
from deformer_app.viewer.rigs import load_handles, place_rig
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.stage import Hover
from deformer_app.viewer.worker import in_background
from number_fields import type_centre
from off_screen_editor import SIZE, click, drag, editing, event, finish, seen, texts
from shapes import sequence, small_model
from waiting import HANG, wait_for


@pytest.mark.parametrize("write", ["export", "save", "copy", "close"])
def test_what_is_written_has_the_pose_that_was_last_asked_for(editor, tmp_path, write):
    """However early after a step: the solver has shown an earlier pose, or none of this state."""
    editor.handles.place(100)
    editor.handles.set_kind("exact")
    finish(editor)
    editor.handles.move_selected(translation([0.3, 0.2, 0.1]))
    finish(editor)
    for n in range(2, 5):
        editor.handles.move_selected(translation([0.3 * n, 0.2, 0.1]))
        editor.tick()
    editor.commit("Drag")
    if write == "export":
        export_pose(editor, tmp_path / "pose.ply")
    elif write != "close":
        (editor.save_session if write == "save" else editor.write_copy)(tmp_path / "work.json")
    else:
        editor.close()
        editor.session.save(tmp_path / "work.json")
    assert editor.answer.final and editor.answer.request.edit == editor.edit
    if write == "export":
        found = io.load_mesh(tmp_path / "pose.ply").vertices
    else:
        found = replay(Session.load(tmp_path / "work.json"), editor.model).vertices
    np.testing.assert_allclose(found, editor.vertices, atol=1e-6)


def first_face(editor, pixel):
    """The face that a line of sight meets first, found by solving for every face; or None."""
    ray = editor.state.camera.ray(pixel, SIZE)
    faces = editor.model.reference.faces
    a, b, c = (editor.vertices[faces[:, corner]] for corner in range(3))
    system = np.stack([b - a, c - a, np.broadcast_to(-ray.direction, a.shape)], axis=2)
    u, v, t = np.linalg.solve(system, (ray.origin - a)[:, :, None])[:, :, 0].T
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return int(np.where(inside, t, np.inf).argmin()) if inside.any() else None


def test_it_opens_with_the_reference_in_view(editor):
    assert not editor.preparing
    reference = editor.model.decode(start_codes(editor.model)["Reference"])
    np.testing.assert_allclose(editor.vertices, reference, atol=1e-4)
    pixels = editor.state.camera.project(editor.vertices, SIZE)
    assert (pixels > 0).all() and (pixels < SIZE).all()
    assert not editor.session.changed


def test_the_hovered_vertex_is_the_one_that_is_placed_and_it_is_in_front(editor):
    vertex, at = seen(editor, 0.5)
    event(editor, "MouseMove", at)
    assert editor.state.hovered.vertex == vertex
    click(editor, at)
    (handle,) = editor.edit.handles
    assert handle.vertices == (vertex,)
    # Placing moves nothing.
    np.testing.assert_allclose(
        editor.vertices, editor.model.decode(np.array(editor.edit.base)), atol=1e-4
    )


def test_no_vertex_of_the_back_side_is_ever_offered(editor):
    """Over the whole picture: what is offered is a corner of the face that is seen there."""
    hits = misses = 0
    for x in range(20, SIZE[0], 14):
        for y in range(20, SIZE[1], 14):
            vertex, face = editor.state.view.vertex_at((x, y)), first_face(editor, (x, y))
            if vertex is None or face is None:
                misses += vertex is not None or face is not None  # the very rim of a face
                continue
            corners = editor.model.reference.faces[face]
            misses += vertex not in corners
            hits += 1
    assert hits > 30 and misses <= 0.01 * hits


def test_a_drag_brings_the_vertex_under_the_mouse_and_is_one_step(editor):
    vertex, at = seen(editor, 0.95)
    goal = at + np.array([-25, -40])
    drag(editor, at, goal)
    there = editor.state.camera.project(editor.vertices[[vertex]], SIZE)[0]
    target = editor.state.camera.project([editor.edit.handles[0].centre], SIZE)[0]
    np.testing.assert_allclose(target, goal, atol=1.5)
    assert np.hypot(*(there - goal)) < 0.5 * np.hypot(25, 40), "the prior resists a little"
    editor.handles.set_kind("exact")
    finish(editor)
    there = editor.state.camera.project(editor.vertices[[vertex]], SIZE)[0]
    np.testing.assert_allclose(there, goal, atol=1.5)
    assert [entry.label for entry in editor.session.entries] == [
        "Start", "Place and drag", "Make exact"]  # fmt: skip


def test_orbiting_leaves_no_handle_behind(editor):
    camera = editor.state.camera
    drag(editor, (8, 8), (240, 180))
    drag(editor, (240, 180), (300, 150), button="Right")
    assert editor.state.camera != camera
    assert editor.edit.handles == () and len(editor.session.entries) == 1


def test_undo_and_redo_give_the_very_poses_back(editor):
    poses = [editor.vertices.copy()]
    for share, step in ((0.95, (-25, -40)), (0.5, (10, 25))):
        _, at = seen(editor, share)
        drag(editor, at, at + step)
        poses.append(editor.vertices.copy())
    editor.handles.set_kind("exact")
    finish(editor)
    poses.append(editor.vertices.copy())
    for expected in poses[-2::-1]:
        editor.undo()
        finish(editor)
        np.testing.assert_allclose(editor.vertices, expected, atol=1e-6)
    editor.undo()
    for expected in poses[1:]:
        editor.redo()
        finish(editor)
        np.testing.assert_allclose(editor.vertices, expected, atol=1e-6)


def test_a_pose_that_was_not_at_rest_is_stored_when_it_is(editor):
    """Undone and redone while it settles, a drag goes on from where it was, and ends elsewhere."""
    editor.handles.place(100)
    finish(editor)
    editor.handles.move_selected(translation([0.3, 0.2, 0.1]))
    editor.commit("Drag")
    finish(editor)
    early = replace(editor.answer.solution, z=editor.edit.base, final=False)
    editor.restore("Step", replace(editor.edit, noise=0.02), early)
    finish(editor)
    assert editor.answer.final
    assert editor.session.entry.solution == editor.answer.solution
    found = replay(editor.session, editor.model).vertices
    np.testing.assert_allclose(found, editor.vertices, atol=1e-6)


def test_a_step_that_changes_nothing_shows_the_pose_that_was_there(editor):
    """It is not solved for again, which may end elsewhere."""
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.3, 0.2, 0.1]))
    editor.commit("Drag")
    finish(editor)
    other = replace(editor.answer.solution, z=editor.edit.base)
    editor.restore("Step", replace(editor.edit, noise=0.02), other)
    finish(editor)
    pose, steps = editor.vertices.copy(), len(editor.session.entries)
    editor.show_edit(editor.edit)
    finish(editor)
    assert np.abs(editor.vertices - pose).max() > 0.01
    editor.commit("Drag")
    finish(editor)
    assert len(editor.session.entries) == steps and editor.session.entry.solution == other
    np.testing.assert_allclose(editor.vertices, pose, atol=1e-6)


def test_escape_takes_a_drag_back(editor):
    before = editor.vertices.copy()
    _, at = seen(editor, 0.95)
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    event(editor, "MouseMove", at + np.array([-30, -30]))
    finish(editor)
    assert np.abs(editor.vertices - before).max() > 0.01
    editor.controller.cancel()
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, atol=1e-6)
    assert editor.edit.handles == () and not editor.session.changed


def deform(editor):
    """Two handles, one of them exact and far from the examples, a moved slider and camera."""
    for share, step in ((0.95, (-60, -90)), (0.05, (5, 10))):
        _, at = seen(editor, share)
        drag(editor, at, at + step)
    editor.handles.set_kind("exact")
    finish(editor)
    editor.prior.slide(2, float(editor.code[2]) + 0.5)
    editor.commit("Component 2")
    drag(editor, (8, 8), (60, 40))
    finish(editor)


def test_a_session_replays_to_the_same_mesh_on_the_command_line(editor, tmp_path, capfd):
    from deformer_app import console
    from deformer_app.cli import main as cli

    deform(editor)
    file, out = tmp_path / "session.json", tmp_path / "pose.ply"
    editor.save_session(file)
    assert not editor.session.changed
    assert console.run(cli.app, ["fit", "--session", str(file), "-o", str(out), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["z"] == pytest.approx(editor.code.tolist())
    diagonal = editor.model.reference.bounding_diagonal
    replayed = io.load_mesh(out).vertices
    assert np.abs(replayed - editor.vertices).max() < 1e-6 * diagonal
    export_pose(editor, tmp_path / "here.ply")
    np.testing.assert_array_equal(io.load_mesh(tmp_path / "here.ply").vertices, editor.vertices)


def test_opening_a_session_brings_everything_back(editor, tmp_path):
    deform(editor)
    editor.picture.change_look(wireframe=True, dark=True, ghost="reference")
    finish(editor)
    before, camera, entries = editor.vertices.copy(), editor.state.camera, editor.session.entries
    editor.save_session(tmp_path / "a.json")
    editor.open_session(tmp_path / "a.json")
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, atol=1e-6)
    assert editor.state.camera == camera and editor.session.entries == entries
    assert (
        editor.state.look.wireframe
        and editor.state.look.dark
        and editor.state.look.ghost == "reference"
    )
    editor.undo()
    finish(editor)
    assert np.abs(editor.vertices - before).max() > 1e-4


def test_a_session_of_another_model_is_refused(editor, tmp_path):
    editor.save_session(tmp_path / "a.json")
    session = Session.load(tmp_path / "a.json")
    session.model = replace(session.model, path="elsewhere", fingerprint="0" * 64)
    with pytest.raises(InputError, match=r"another model .* \(it was elsewhere\); open that one"):
        editor.open_model(editor.session.model.path, session)
    assert editor.is_open and replay(editor.session, editor.model).vertices.shape == (120, 3)


def test_a_session_without_a_noted_pose_is_solved_for(editor):
    deform(editor)
    session = editor.session
    session.entries[session.cursor] = replace(session.entry, solution=None)
    pose = replay(session, editor.model)
    targets = next(h for h in editor.edit.handles if h.kind == "exact")
    np.testing.assert_allclose(pose.vertices[targets.vertices[0]], targets.targets[0], atol=1e-6)


def test_a_pin_stays_and_drags_leave_it(editor):
    vertex, at = seen(editor, 0.05)
    click(editor, at)
    editor.handles.set_kind("pin")
    finish(editor)
    before = editor.vertices[vertex].copy()
    drag(editor, at, at + np.array([40, 40]))
    np.testing.assert_allclose(editor.edit.handles[0].targets[0], before, atol=1e-6)
    _, far = seen(editor, 0.95)
    drag(editor, far, far + np.array([-30, -50]))
    np.testing.assert_allclose(editor.vertices[vertex], before, atol=1e-5)


def test_numbers_move_the_selection_exactly(editor):
    _, at = seen(editor, 0.9)
    click(editor, at)
    type_centre(editor, [1.7, 0.25, 0.125])
    assert editor.edit.handles[0].centre == pytest.approx((1.7, 0.25, 0.125))
    assert editor.session.entry.label == "Move"


def test_a_painted_region_moves_and_turns_as_one(editor):
    editor.state.set_tool("paint")
    editor.stage.brush.radius = 0.15
    _, at = seen(editor, 0.9)
    drag(editor, at, at + np.array([6, 0]), steps=2)
    (region,) = editor.edit.handles
    assert (
        region.is_region and len(region.vertices) > 3 and set(region.vertices) <= set(region.patch)
    )
    assert editor.state.tool == "drag" and editor.handles.selected == {region.id}
    editor.state.set_gizmo("rotate")
    assert editor.stage.gizmo.mode == "rotate"
    turn = rotation(region.centre, [0.0, 0.0, 0.3])
    editor.handles.move_selected(turn)
    editor.commit("Rotate")
    finish(editor)
    patch = list(region.patch)
    wanted = turn(editor.model.decode(np.array(editor.edit.base))[patch])
    off = np.linalg.norm(editor.vertices[patch] - wanted, axis=1)
    stayed = np.linalg.norm(editor.model.reference.vertices[patch] - wanted, axis=1)
    assert off.mean() < 0.5 * stayed.mean()


def test_the_brush_grows_and_shrinks(editor):
    painted = []
    for factor in (1.0, 3.0):
        editor.stage.brush.resize(factor)
        editor.stage.paint_region(60)
        editor.stage.finish_region(add=False)
        painted.append(len(editor.edit.handles[-1].patch))
    assert painted[0] < painted[1]


def test_a_session_shows_its_pose_before_the_solver_is_prepared(editor, model_path, tmp_path):
    vertex, _ = seen(editor, 0.9)
    editor.handles.place(vertex)
    editor.handles.move_selected(translation([0.1, 0.6, 0.2]))
    editor.commit("Drag")
    finish(editor)
    before = editor.vertices.copy()
    editor.save_session(tmp_path / "s.json")
    editor.open_session(tmp_path / "s.json")
    assert editor.preparing
    size = editor.model.reference.bounding_diagonal
    assert np.abs(before - editor.model.reference.vertices).max() > 0.05 * size
    np.testing.assert_allclose(editor.vertices, before, rtol=0, atol=1e-5 * size)
    finish(editor)
    np.testing.assert_allclose(editor.vertices, before, rtol=0, atol=1e-6 * size)


def test_looking_around_never_waits_for_a_slow_solver(editor, monkeypatch, heard):
    """The solver has begun and does not end before two frames have been drawn."""
    begun, gate, solve = threading.Event(), threading.Event(), deformer.HandleSolver.solve

    def slow(*arguments, **options):
        begun.set()
        assert gate.wait(HANG)
        return solve(*arguments, **options)

    def look_around():
        editor.state.viewpoint.set_camera(
            editor.state.camera.orbited(1.0, 0.0, editor.state.viewpoint.sky)
        )
        editor.tick()

    monkeypatch.setattr(deformer.HandleSolver, "solve", slow)
    try:
        editor.handles.place(60)
        assert begun.wait(HANG)
        heard.clear()
        wait_for(lambda: heard.count(FrameDrawn()) >= 2, look_around)
        assert editor.answer.request.edit != editor.edit
    finally:
        gate.set()


def test_mirroring_copies_handles_to_the_other_side(editor):
    editor.mirror.plane.set_across("z")
    vertex, at = seen(editor, 0.9)
    drag(editor, at, at + np.array([0, -20]))
    (first,) = editor.edit.handles
    editor.mirror.mirror_handles()
    finish(editor)
    opposite = editor.mirror.plane.symmetry.opposite[vertex]
    if opposite == vertex:
        assert len(editor.edit.handles) == 1
    else:
        second = editor.edit.handles[1]
        assert second.vertices == (opposite,)
        np.testing.assert_allclose(second.centre, editor.mirror.plane.symmetry.mirror(first.centre))
        editor.handles.select([first.id])
        editor.mirror.mirror_handles()
        assert len(editor.edit.handles) == 2, "what is there already moves"


def test_the_suggested_handle_is_the_most_telling_one(editor):
    editor.handles.suggest()
    finish(editor)
    assert editor.state.look.colour == "uncertainty"
    wanted = editor.answer.suggestion
    assert wanted is not None
    editor.handles.suggest()
    finish(editor)
    assert editor.edit.handles[0].vertices == (wanted,)
    assert editor.answer.suggestion != wanted


def test_a_rig_has_the_handles_of_the_layout_and_keeps_those_that_are_there(editor):
    editor.handles.place(7)
    editor.commit("Place handle")
    place_rig(editor, 3)
    finish(editor)
    vertices = [handle.vertices[0] for handle in editor.edit.handles]
    assert vertices == deformer.layout(small_model(), 4, fixed=[7]).vertices.tolist()
    assert len(editor.handles.selected) == 3
    for handle in editor.edit.handles:
        np.testing.assert_allclose(
            handle.targets[0], editor.vertices[handle.vertices[0]], atol=0.05
        )
    editor.undo()
    assert [handle.vertices for handle in editor.edit.handles] == [(7,)], "a rig is one step"


def test_a_rig_that_cannot_be_laid_out_says_why(editor, heard):
    place_rig(editor, 500)
    finish(editor)
    assert "at most 120" in texts(heard, MistakeMade)[0]
    assert not editor.edit.handles


def test_handles_of_a_file_are_loaded_with_their_targets(editor, tmp_path):
    file = tmp_path / "handles.json"
    editor.handles.place(50)
    editor.commit("Place handle")
    rows = [
        {"vertex": 50, "position": [1.0, 0.3, 0.1], "kind": "pin"},
        {"vertex": 115, "position": [1.9, 0.4, 0.2], "weight": 2.0},
    ]
    io.write_json(file, {"handles": rows})
    load_handles(editor, file)
    finish(editor)
    found = [(h.vertices, h.targets, h.kind, h.weight) for h in editor.edit.handles]
    assert found == [
        ((50,), ((1.0, 0.3, 0.1),), "pin", 1.0),
        ((115,), ((1.9, 0.4, 0.2),), "soft", 2.0),
    ]
    export_handles(editor, tmp_path / "again.json")
    load_handles(editor, tmp_path / "again.json")
    assert [h.targets for h in editor.edit.handles] == [targets for _, targets, _, _ in found]
    io.write_json(file, {"frames": [rows]})
    with pytest.raises(InputError, match="one pose"):
        load_handles(editor, file)
    io.write_json(file, {"handles": [{**rows[0], "offset": 0.1}]})
    with pytest.raises(InputError, match=r"handles\[0\]"):
        load_handles(editor, file)


def test_sliders_set_the_code_and_one_drag_is_one_step(editor):
    limits = editor.activations
    k = int(limits.order[0])
    for value in np.linspace(limits.low[k], limits.high[k], 5):
        editor.prior.slide(k, float(value))
    editor.commit("Component")
    finish(editor)
    assert editor.code[k] == pytest.approx(limits.high[k], abs=1e-6)
    np.testing.assert_allclose(editor.vertices, editor.model.decode(editor.code), atol=1e-4)
    assert len(editor.session.entries) == 2


def test_a_slider_waits_for_the_end_of_a_drag(editor):
    _, at = seen(editor, 0.9)
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    event(editor, "MouseMove", at + np.array([-20, -20]))
    base = editor.edit.base
    editor.prior.slide(1, float(editor.code[1]) + 1.0)
    event(editor, "LeftButtonRelease", at + np.array([-20, -20]))
    finish(editor)
    assert editor.edit.base == base and len(editor.session.entries) == 2


def test_starting_from_training_shapes_and_meshes(editor, tmp_path):
    codes = start_codes(editor.model)
    assert len([name for name in codes if name.startswith("Shape")]) == len(editor.model.codes)
    editor.prior.start_from("Shape 3", codes["Shape 3"])
    finish(editor)
    np.testing.assert_allclose(editor.vertices, editor.model.decode(codes["Shape 3"]), atol=1e-4)
    shape = editor.model.decode(codes["Shape 5"])
    io.save_mesh(tmp_path / "five.ply", deformer.Mesh(shape, editor.model.reference.faces))
    editor.prior.start_from_mesh(tmp_path / "five.ply")
    finish(editor)
    assert np.abs(editor.vertices - shape).max() < 0.02
    editor.prior.reset()
    finish(editor)
    np.testing.assert_allclose(editor.code, codes["Reference"], atol=1e-9)


def test_a_target_gives_errors_and_e_rms(editor, tmp_path):
    target = sequence().vertices[4]
    io.save_mesh(tmp_path / "t.ply", deformer.Mesh(target, editor.model.reference.faces))
    editor.session.save(tmp_path / "before.json")
    editor.picture.load_target(tmp_path / "t.ply")
    assert editor.session.changed, "the session has the target's path, too"
    finish(editor)
    expected = deformer.e_rms(target, editor.vertices, "none")
    assert editor.answer.error == pytest.approx(expected)
    distance = np.linalg.norm(editor.vertices - target, axis=1)
    np.testing.assert_allclose(editor.answer.paint.values, distance)
    io.save_mesh(tmp_path / "wrong.ply", deformer.Mesh(np.eye(3), [[0, 1, 2]]))
    with pytest.raises(InputError, match="3 vertices, expected 120"):
        editor.picture.load_target(tmp_path / "wrong.ply")


@pytest.mark.parametrize("colour", ["displacement", "stretch", "uncertainty", "plain"])
def test_every_colouring_can_be_seen(editor, colour):
    _, at = seen(editor, 0.95)
    drag(editor, at, at + np.array([-25, -40]))
    before = editor.state.view.picture().astype(int)
    editor.picture.change_look(colour=colour)
    finish(editor)
    changed = (np.abs(editor.state.view.picture() - before).max(axis=2) > 24).mean()
    assert (changed > 0.01) == (colour != "plain")


def test_handles_leave_for_the_command_line_and_come_out_the_same(editor, tmp_path):
    _, at = seen(editor, 0.9)
    drag(editor, at, at + np.array([-20, -30]))
    editor.handles.set_weight(2.5)
    editor.commit("Weight")
    export_handles(editor, tmp_path / "h.json")
    (row,) = io.load_handles(tmp_path / "h.json", 120).frames[0]
    handle = editor.edit.handles[0]
    assert row == io.HandleTarget(handle.vertices[0], handle.targets[0], 2.5, handle.kind)
    editor.handles.clear()
    with pytest.raises(InputError, match="no handles"):
        export_handles(editor, tmp_path / "h.json")


def test_anti_aliasing_is_off_while_moving_and_back_at_rest(editor):
    _, at = seen(editor, 0.9)
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    event(editor, "MouseMove", at + np.array([-10, -10]))
    finish(editor)
    assert not editor.state.view.is_sharp
    event(editor, "LeftButtonRelease", at + np.array([-10, -10]))
    wait_for(lambda: editor.idle, editor.tick)
    assert editor.state.view.is_sharp


def test_an_error_of_the_solver_is_a_message_and_the_session_lives(editor, monkeypatch, heard):
    def broken(*_, **__):
        raise RuntimeError("no luck today")

    _, at = seen(editor, 0.9)
    with monkeypatch.context() as patch:
        patch.setattr(deformer.HandleSolver, "solve", broken)
        drag(editor, at, at + np.array([-20, -30]))
    assert "no luck today" in texts(heard, MistakeMade)[0]
    assert len(editor.edit.handles) == 1
    click(editor, (4, 4))
    at = editor.state.camera.project([editor.edit.handles[0].centre], SIZE)[0]
    drag(editor, at, at + np.array([5, 5]))
    assert editor.answer.final and editor.answer.request.edit == editor.edit


def test_a_fast_drag_leaves_no_backlog(editor):
    _, at = seen(editor, 0.95)
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    for n in range(300):  # faster than anything can be solved or drawn
        event(editor, "MouseMove", at + np.array([-0.1, -0.15]) * n)
    wanted, before, answered = editor.edit, editor.answer.request.number, set()

    def look():
        editor.tick()
        answered.add(editor.answer.request.number)

    wait_for(lambda: editor.answer.request.edit == wanted, look, pause=0.0)
    # One that was ready, one that was under way, and the newest.
    assert len(answered - {before}) <= 3
    assert editor.answer.request.number > 250
    event(editor, "LeftButtonRelease", at + np.array([-30, -45]))
    finish(editor)
    assert len(editor.session.entries) == 2


def test_work_of_a_crash_is_found_again_and_of_a_good_end_is_not(tmp_path, editor):
    code = (
        "import sys; from pathlib import Path; from deformer_app.viewer.settings import Settings\n"
        "kept = Settings(Path(sys.argv[1])); print(kept.autosave, flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    crashed = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        autosave = Path(crashed.stdout.readline().strip())
        editor.write_copy(autosave)
        assert Settings(tmp_path).left_by_crash() is None, "its window is still open"
    finally:
        crashed.kill()
        crashed.wait()
    later = Settings(tmp_path)
    assert later.left_by_crash() == autosave != later.autosave
    later.forget(autosave)
    later.close()
    assert Settings(tmp_path).left_by_crash() is None


def test_recent_files_are_the_latest_first_and_once(tmp_path):
    settings = Settings(tmp_path)
    for name in ("a", "b", "a", *map(str, range(20)), "a"):
        settings.remember(name)
    assert settings.recent[:2] == ["a", "19"] and len(settings.recent) == 10
    Path(tmp_path / "settings.json").write_text("{ damaged")
    assert settings.recent == [] and not settings.tour_seen
    settings.note_tour()
    assert settings.tour_seen


@pytest.mark.parametrize("factor", [1.0, 1000.0])
def test_a_file_of_targets_in_other_units_is_told_and_a_drag_never(
    editor, heard, tmp_path, caplog, factor
):
    def told():
        return [text for text in texts(heard, NoticeGiven) if "millimetres" in text]

    rest, chosen = editor.model.reference.vertices, (0, 40, 80, 119)
    handles = [Handle(n + 1, (v,), (tuple(factor * rest[v]),)) for n, v in enumerate(chosen)]
    editor.session.change(editor.edit.with_handles(handles))
    editor.commit("Move handles")
    finish(editor)
    assert not told() and "millimetres" not in caplog.text

    file, session = tmp_path / "handles.json", tmp_path / "session.json"
    io.write_json(file, {"handles": handle_rows(handles)})
    editor.save_session(session)
    editor.open_session(session)
    assert len(told()) == (factor > 1)
    load_handles(editor, file)
    assert len(told()) == 2 * (factor > 1)
    finish(editor)


def test_a_session_brings_its_target_back(editor, tmp_path, heard):
    target = deformer.Mesh(sequence().vertices[4], editor.model.reference.faces)
    mesh, file = tmp_path / "t.ply", tmp_path / "a.json"
    io.save_mesh(mesh, target)
    editor.picture.load_target(mesh)
    finish(editor)
    error, values = editor.answer.error, editor.answer.paint.values
    editor.save_session(file)
    editor.open_model(editor.session.model.path)
    assert editor.state.target_mesh is None and editor.state.look.colour == "plain"
    editor.open_session(file)
    finish(editor)
    assert not texts(heard, MistakeMade)
    assert (editor.state.look.colour, editor.state.look.ghost) == ("error", "target")
    assert editor.answer.error == pytest.approx(error)
    np.testing.assert_allclose(editor.answer.paint.values, values, atol=1e-6)

    io.save_mesh(mesh, deformer.Mesh(target.vertices + 0.1, target.faces))
    editor.open_session(file)
    finish(editor)
    told = texts(heard, MistakeMade)[-1]
    assert "t.ply" in told and "changed" in told
    assert editor.answer.error > error

    mesh.unlink()
    editor.open_session(file)
    finish(editor)
    told = texts(heard, MistakeMade)[-1]
    assert "t.ply" in told and "cannot be loaded" in told
    assert editor.state.target_mesh is None and (
        editor.state.look.colour,
        editor.state.look.ghost,
    ) == ("plain", "none")
    editor.save_session(file)
    io.save_mesh(mesh, target)
    editor.open_session(file)
    assert editor.state.target_mesh is not None, "it is not forgotten while it is away"


def test_before_there_is_a_pose_nothing_is_placed_or_written(editor, tmp_path):
    _, at = seen(editor, 0.5)
    editor.open_model(editor.session.model.path)
    assert editor.preparing
    with pytest.raises(InputError, match="still being prepared"):
        export_pose(editor, tmp_path / "pose.ply")
    event(editor, "LeftButtonPress", at)
    event(editor, "LeftButtonRelease", at)
    finish(editor)
    assert editor.edit.handles == () and not editor.session.changed


def test_a_component_can_stay_coloured(editor):
    k = int(editor.activations.order[1])
    editor.picture.change_look(colour=f"component:{k}")
    finish(editor)
    np.testing.assert_array_equal(editor.answer.paint.values, editor.activations.support(k))
    assert editor.answer.paint.title == editor.model.label(k)


def test_work_in_the_background_keeps_no_other_work_waiting(editor):
    done, held = [], [True]

    def quick():
        yield
        done.append("quick")

    def slow():
        yield from in_background(lambda: [time.sleep(0.01) for _ in iter(lambda: held[0], False)])
        done.append("slow")

    editor.run(slow())
    editor.run(quick())
    for _ in range(5):
        editor.tick()
    assert done == ["quick"]
    held[0] = False
    finish(editor)
    assert done == ["quick", "slow"]


def test_a_mistake_in_the_background_is_a_message(editor, heard):
    def fail():
        raise InputError("the disk is full of holes")

    editor.run(in_background(fail))
    finish(editor)
    assert texts(heard, MistakeMade) == ["the disk is full of holes"]


@pytest.mark.parametrize(
    "command",
    [
        lambda editor: editor.handles.delete(),
        lambda editor: editor.mirror.mirror_handles(),
        lambda editor: editor.handles.suggest(),
    ],
    ids=["delete", "mirror", "suggest"],
)
def test_a_command_that_needs_a_handle_says_so(editor, heard, command):
    command(editor)
    assert texts(heard, NoticeGiven)
    heard.clear()
    editor.handles.set_kind("pin")
    assert "Select a handle" in texts(heard, NoticeGiven)[0]


def test_a_rehearsal_leaves_no_trace(editor):
    handle = Handle(1, (115,), ((1.9, 0.4, 0.2),), "exact")
    edit = replace(editor.edit, handles=(handle,))
    fresh, rehearsed = PoseWorker(editor.model), PoseWorker(editor.model)
    rehearsed.rehearse()
    expected, found = fresh.final_pose(edit).vertices, rehearsed.final_pose(edit).vertices
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("density", [1.0, 2.0])
def test_a_dense_screen_changes_neither_aim_nor_the_size_of_handles(model_path, density):
    """The same picture on a screen of twice the pixels: same vertices, balls twice as many wide."""
    screen = [1.0]
    with editing(model_path, density=lambda: screen[0]) as editor:
        check_aim_and_size(editor, screen, density)


def check_aim_and_size(editor, screen, density):
    plotter = editor.state.view.plotter
    plotter.window_size = [int(density * side) for side in SIZE]
    screen[0] = density
    assert editor.stage.size == SIZE
    editor.picture.frame()
    finish(editor)
    vertex, at = seen(editor, 0.9)
    for share in (0.3, 0.5, 0.7):
        other, pixel = seen(editor, share)
        assert other in editor.model.reference.faces[first_face(editor, pixel)]
    interactor, height = plotter.iren.interactor, plotter.render_window.GetSize()[1]
    interactor.SetEventInformation(
        int(density * at[0]), height - 1 - int(density * at[1]), False, False
    )
    for name in ("MouseMove", "LeftButtonPress", "LeftButtonRelease"):
        interactor.InvokeEvent(f"{name}Event")
    finish(editor)
    assert editor.edit.handles[0].vertices == (vertex,)
    editor.handles.select([])
    editor.stage.hover(Hover())
    editor.tick()
    picture = editor.state.view.grab().astype(int)
    red, green, blue = np.moveaxis(picture, 2, 0)
    ball = (red > 150) & (red - blue > 80) & (red - green > 50)
    assert np.sqrt(4 / np.pi * ball.sum()) == pytest.approx(14 * density, rel=0.25)


def test_pinning_at_rest_moves_nothing_and_releasing_is_told(editor, heard):
    """A dragged handle lags behind its target; pinned where it is, it goes on to pull as before."""
    for vertex, motion in ((4, [0, 0, 0]), (100, [0.1, 0.3, 0.2])):
        editor.handles.place(vertex)
        editor.commit("Place handle")
        editor.handles.set_kind("exact")
        finish(editor)
        editor.handles.move_selected(translation(motion))
        editor.commit("Drag")
        finish(editor)
    limit = 1e-3 * editor.model.reference.bounding_diagonal
    before = editor.vertices
    editor.handles.set_kind("pin")
    finish(editor)
    assert np.abs(editor.vertices - before).max() < limit
    editor.handles.place(60)
    editor.commit("Place handle")
    finish(editor)
    assert np.abs(editor.vertices - before).max() < limit, "placed on the deformed surface"
    editor.handles.set_weight(10.0)
    editor.commit("Weight")
    editor.handles.set_kind("pin")
    finish(editor)
    assert np.abs(editor.vertices - before).max() < limit
    editor.handles.set_kind("soft")
    assert "Soft: " in texts(heard, NoticeGiven)[-1]
    editor.handles.delete()
    assert "Released: " in texts(heard, NoticeGiven)[-1]
