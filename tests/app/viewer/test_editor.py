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
import pyvista as pv
from PIL import Image
from scipy.spatial.transform import Rotation

import deformer
from deformer import InputError, io
from deformer_app.rendering.animation import save_animation
from deformer_app.rendering.offscreen import off_screen
from deformer_app.viewer import recording
from deformer_app.viewer.changes import FrameDrawn, MistakeMade, NoticeGiven
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.exports import export_handles, export_pose, save_screenshot
from deformer_app.viewer.gizmo import rotation, translation
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.pose_worker import PoseWorker, replay
from deformer_app.viewer.recording import Recorder, save_recording, save_turntable
from deformer_app.viewer.rigs import load_handles, place_rig
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.stage import Hover
from deformer_app.viewer.vtk_input import listen
from deformer_app.viewer.worker import in_background
from shapes import sequence, small_model
from waiting import HANG, wait_for

SIZE = (480, 360)


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "tube"
    small_model().save(path)
    return path


@pytest.fixture
def screen():
    """Pixels of the screen along each side of one that a person aims at; may be changed."""
    return [1.0]


@pytest.fixture
def editor(model_path, screen):
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=list(SIZE), lighting="none")
        plotter.show(auto_close=False)
    work = Editor(MeshView(plotter, density=lambda: screen[0]))
    listen(work.state.view, work.controller.handle)
    work.open_model(model_path)
    finish(work)
    yield work
    work.close()
    plotter.close()


def finish(editor):
    """Tick until nothing is left to do."""
    editor.tick()
    wait_for(lambda: not editor.busy, editor.tick, pause=0.001)


@pytest.mark.parametrize("write", ["export", "save", "copy", "close"])
def test_what_is_written_has_the_pose_that_was_last_asked_for(editor, tmp_path, write):
    """However early after a step: the solver has shown an earlier pose, or none of this state."""
    editor.place(100)
    editor.set_kind("exact")
    finish(editor)
    editor.move_selected(translation([0.3, 0.2, 0.1]))
    finish(editor)
    for n in range(2, 5):
        editor.move_selected(translation([0.3 * n, 0.2, 0.1]))
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


@pytest.fixture
def heard(editor):
    """All changes that the editor has told of."""
    changes = []
    editor.on_change.append(changes.append)
    return changes


def texts(changes, kind):
    """What the user has been told by one kind of change."""
    return [change.text for change in changes if isinstance(change, kind)]


def event(editor, name, pixel, shift=False, control=False):
    interactor = editor.state.view.plotter.iren.interactor
    x, y = pixel
    interactor.SetEventInformation(int(x), SIZE[1] - 1 - int(y), control, shift)
    interactor.InvokeEvent(name)


def mouse(editor, start, end=None, shift=False, button="Left", steps=8):
    """Press, move in steps, release; a click without `end`."""
    event(editor, "MouseMoveEvent", start)
    event(editor, f"{button}ButtonPressEvent", start, shift)
    for n in range(1, steps + 1) if end is not None else ():
        at = np.array(start) + (np.array(end) - start) * n / steps
        event(editor, "MouseMoveEvent", at, shift)
        editor.tick()
    event(editor, f"{button}ButtonReleaseEvent", start if end is None else end, shift)
    finish(editor)


def seen(editor, wanted):
    """A vertex that is seen at a share of the tube's length, and its pixel."""
    pixels = np.floor(editor.state.camera.project(editor.vertices, SIZE)) + 0.5
    for vertex in np.argsort(np.abs(editor.vertices[:, 0] - 2 * wanted)):
        if editor.stage.vertex_at(pixels[vertex]) == vertex:
            return int(vertex), pixels[vertex]
    raise AssertionError("no vertex is seen there")


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
    event(editor, "MouseMoveEvent", at)
    assert editor.state.hovered.vertex == vertex
    mouse(editor, at)
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
            vertex, face = editor.stage.vertex_at((x, y)), first_face(editor, (x, y))
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
    mouse(editor, at, goal)
    there = editor.state.camera.project(editor.vertices[[vertex]], SIZE)[0]
    target = editor.state.camera.project([editor.edit.handles[0].centre], SIZE)[0]
    np.testing.assert_allclose(target, goal, atol=1.5)
    assert np.hypot(*(there - goal)) < 0.5 * np.hypot(25, 40), "the prior resists a little"
    editor.set_kind("exact")
    finish(editor)
    there = editor.state.camera.project(editor.vertices[[vertex]], SIZE)[0]
    np.testing.assert_allclose(there, goal, atol=1.5)
    assert [entry.label for entry in editor.session.entries] == [
        "Start", "Place and drag", "Make exact"]  # fmt: skip


def test_orbiting_leaves_no_handle_behind(editor):
    camera = editor.state.camera
    mouse(editor, (8, 8), (240, 180))
    mouse(editor, (240, 180), (300, 150), button="Right")
    assert editor.state.camera != camera
    assert editor.edit.handles == () and len(editor.session.entries) == 1


def test_undo_and_redo_give_the_very_poses_back(editor):
    poses = [editor.vertices.copy()]
    for share, step in ((0.95, (-25, -40)), (0.5, (10, 25))):
        _, at = seen(editor, share)
        mouse(editor, at, at + step)
        poses.append(editor.vertices.copy())
    editor.set_kind("exact")
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


def test_escape_takes_a_drag_back(editor):
    before = editor.vertices.copy()
    _, at = seen(editor, 0.95)
    event(editor, "MouseMoveEvent", at)
    event(editor, "LeftButtonPressEvent", at)
    event(editor, "MouseMoveEvent", at + np.array([-30, -30]))
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
        mouse(editor, at, at + step)
    editor.set_kind("exact")
    finish(editor)
    editor.slide(2, float(editor.code[2]) + 0.5)
    editor.commit("Component 2")
    mouse(editor, (8, 8), (60, 40))
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
    editor.change_look(wireframe=True, dark=True, ghost="reference")
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
    session.model = replace(session.model, fingerprint="0" * 64)
    with pytest.raises(InputError, match="another model"):
        editor.open_model(session.model.path, session)
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
    mouse(editor, at)
    editor.set_kind("pin")
    finish(editor)
    before = editor.vertices[vertex].copy()
    mouse(editor, at, at + np.array([40, 40]))
    np.testing.assert_allclose(editor.edit.handles[0].targets[0], before, atol=1e-6)
    _, far = seen(editor, 0.95)
    mouse(editor, far, far + np.array([-30, -50]))
    np.testing.assert_allclose(editor.vertices[vertex], before, atol=1e-5)


def test_numbers_move_the_selection_exactly(editor):
    _, at = seen(editor, 0.9)
    mouse(editor, at)
    editor.set_centre([1.7, 0.25, 0.125])
    assert editor.edit.handles[0].centre == pytest.approx((1.7, 0.25, 0.125))
    assert editor.session.entry.label == "Move"


def test_a_painted_region_moves_and_turns_as_one(editor):
    editor.state.set_tool("paint")
    editor.stage.brush.radius = 0.15
    _, at = seen(editor, 0.9)
    mouse(editor, at, at + np.array([6, 0]), steps=2)
    (region,) = editor.edit.handles
    assert (
        region.is_region and len(region.vertices) > 3 and set(region.vertices) <= set(region.patch)
    )
    assert editor.state.tool == "drag" and editor.selected == {region.id}
    editor.state.set_gizmo("rotate")
    assert editor.stage.gizmo.mode == "rotate"
    turn = rotation(region.centre, [0.0, 0.0, 0.3])
    editor.move_selected(turn)
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


def turn(editor, part="rz", by=(20, 25)):
    """Drag a ring of the manipulator."""
    gizmo, camera = editor.stage.gizmo, editor.state.camera
    at = next(
        pixel
        for pixel in camera.project(gizmo.outline(part, camera, SIZE), SIZE)
        if gizmo.part_at(pixel, camera, SIZE) == part and editor.stage.handle_at(pixel) is None
    )
    mouse(editor, at, at + np.array(by))


def test_one_handle_turns_in_its_place(editor, tmp_path):
    """From the rotation that the surface has; the surface follows, exactly if the handle is exact.

    Undone and redone, saved, exported and read again; at last it turns freely as before.
    """
    vertex = seen(editor, 1.0)[0]
    editor.place(vertex)
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
    editor.set_kind("exact")
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
    editor.turn_freely()
    assert editor.edit.handles[0].orientation is None
    load_handles(editor, tmp_path / "h.json")
    np.testing.assert_allclose(editor.edit.handles[0].orientation, handle.orientation, atol=1e-12)


def test_handles_that_are_turned_turn_with_the_others(editor):
    """Several about their centre: those with an orientation, and no others, turn it along."""
    for vertex in (4, 60, 115):
        editor.place(vertex, add=True)
    editor.commit("Place handle")
    first, *rest = editor.edit.handles
    editor.change("Turn", editor.edit.with_handles([first.oriented(np.eye(3))]))
    motion = rotation([1.0, 0, 0], [0.0, 0.3, 0.0])
    editor.move_selected(motion)
    editor.commit("Rotate")
    (turned, *others) = editor.edit.handles
    np.testing.assert_allclose(turned.orientation, motion.matrix, atol=1e-12)
    assert [handle.orientation for handle in others] == [None, None]
    for handle, was in zip(editor.edit.handles, [first, *rest], strict=True):
        np.testing.assert_allclose(handle.targets, motion(was.targets), atol=1e-12)
    editor.move_selected(translation([0.1, 0.0, 0.0]))
    editor.commit("Move")
    np.testing.assert_allclose(editor.edit.handles[0].orientation, motion.matrix, atol=1e-12)


def test_a_mirrored_handle_is_turned_as_in_a_mirror(editor):
    editor.plane.set_across("z")
    editor.place(int(editor.model.reference.vertices[:, 2].argmax()))
    editor.commit("Place handle")
    (handle,) = editor.edit.handles
    tilt = rotation(np.zeros(3), [0.2, 0.1, 0.4]).matrix
    editor.change("Turn", editor.edit.with_handles([handle.oriented(tilt)]))
    editor.mirror()
    copy = editor.edit.handles[1]
    # A rotation vector is an axial one: along the normal it stays, across it turns round.
    np.testing.assert_allclose(
        copy.orientation, rotation(np.zeros(3), [-0.2, -0.1, 0.4]).matrix, atol=1e-12
    )


@pytest.mark.parametrize("mode", ["rotate", "scale"])
def test_several_handles_turn_and_grow_about_their_centre(editor, mode):
    for vertex in (4, 60, 115):
        editor.place(vertex, add=True)
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
    mouse(editor, at, at + (np.array([20, 25]) if mode == "rotate" else np.array([60, 0])))
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


def test_looking_around_never_waits_for_a_slow_solver(editor, monkeypatch, heard):
    """The solver has begun and does not end before two frames have been drawn."""
    begun, gate, solve = threading.Event(), threading.Event(), deformer.HandleSolver.solve

    def slow(*arguments, **options):
        begun.set()
        assert gate.wait(HANG)
        return solve(*arguments, **options)

    def look_around():
        editor.state.set_camera(editor.state.camera.orbited(1.0, 0.0, editor.state.sky))
        editor.tick()

    monkeypatch.setattr(deformer.HandleSolver, "solve", slow)
    try:
        editor.place(60)
        assert begun.wait(HANG)
        heard.clear()
        wait_for(lambda: heard.count(FrameDrawn()) >= 2, look_around)
        assert editor.answer.request.edit != editor.edit
    finally:
        gate.set()


def test_mirroring_copies_handles_to_the_other_side(editor):
    editor.plane.set_across("z")
    vertex, at = seen(editor, 0.9)
    mouse(editor, at, at + np.array([0, -20]))
    (first,) = editor.edit.handles
    editor.mirror()
    finish(editor)
    opposite = editor.plane.symmetry.opposite[vertex]
    if opposite == vertex:
        assert len(editor.edit.handles) == 1
    else:
        second = editor.edit.handles[1]
        assert second.vertices == (opposite,)
        np.testing.assert_allclose(second.centre, editor.plane.symmetry.mirror(first.centre))
        editor.select([first.id])
        editor.mirror()
        assert len(editor.edit.handles) == 2, "what is there already moves"


def test_the_suggested_handle_is_the_most_telling_one(editor):
    editor.suggest()
    finish(editor)
    assert editor.state.look.colour == "uncertainty"
    wanted = editor.answer.suggestion
    assert wanted is not None
    editor.suggest()
    finish(editor)
    assert editor.edit.handles[0].vertices == (wanted,)
    assert editor.answer.suggestion != wanted


def test_a_rig_has_the_handles_of_the_layout_and_keeps_those_that_are_there(editor):
    editor.place(7)
    editor.commit("Place handle")
    place_rig(editor, 3)
    finish(editor)
    vertices = [handle.vertices[0] for handle in editor.edit.handles]
    assert vertices == deformer.layout(small_model(), 4, fixed=[7]).vertices.tolist()
    assert len(editor.selected) == 3
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
    editor.place(50)
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
        editor.slide(k, float(value))
    editor.commit("Component")
    finish(editor)
    assert editor.code[k] == pytest.approx(limits.high[k], abs=1e-6)
    np.testing.assert_allclose(editor.vertices, editor.model.decode(editor.code), atol=1e-4)
    assert len(editor.session.entries) == 2


def test_a_slider_waits_for_the_end_of_a_drag(editor):
    _, at = seen(editor, 0.9)
    event(editor, "MouseMoveEvent", at)
    event(editor, "LeftButtonPressEvent", at)
    event(editor, "MouseMoveEvent", at + np.array([-20, -20]))
    base = editor.edit.base
    editor.slide(1, float(editor.code[1]) + 1.0)
    event(editor, "LeftButtonReleaseEvent", at + np.array([-20, -20]))
    finish(editor)
    assert editor.edit.base == base and len(editor.session.entries) == 2


def test_starting_from_training_shapes_and_meshes(editor, tmp_path):
    codes = start_codes(editor.model)
    assert len([name for name in codes if name.startswith("Shape")]) == len(editor.model.codes)
    editor.start_from("Shape 3", codes["Shape 3"])
    finish(editor)
    np.testing.assert_allclose(editor.vertices, editor.model.decode(codes["Shape 3"]), atol=1e-4)
    shape = editor.model.decode(codes["Shape 5"])
    io.save_mesh(tmp_path / "five.ply", deformer.Mesh(shape, editor.model.reference.faces))
    editor.start_from_mesh(tmp_path / "five.ply")
    finish(editor)
    assert np.abs(editor.vertices - shape).max() < 0.02
    editor.reset()
    finish(editor)
    np.testing.assert_allclose(editor.code, codes["Reference"], atol=1e-9)


def test_a_target_gives_errors_and_e_rms(editor, tmp_path):
    target = sequence().vertices[4]
    io.save_mesh(tmp_path / "t.ply", deformer.Mesh(target, editor.model.reference.faces))
    editor.load_target(tmp_path / "t.ply")
    finish(editor)
    expected = deformer.e_rms(target, editor.vertices, "none")
    assert editor.answer.error == pytest.approx(expected)
    distance = np.linalg.norm(editor.vertices - target, axis=1)
    np.testing.assert_allclose(editor.answer.paint.values, distance)
    io.save_mesh(tmp_path / "wrong.ply", deformer.Mesh(np.eye(3), [[0, 1, 2]]))
    with pytest.raises(InputError, match="3 vertices, expected 120"):
        editor.load_target(tmp_path / "wrong.ply")


@pytest.mark.parametrize("colour", ["displacement", "stretch", "uncertainty", "plain"])
def test_every_colouring_can_be_seen(editor, colour):
    _, at = seen(editor, 0.95)
    mouse(editor, at, at + np.array([-25, -40]))
    before = editor.state.view.picture().astype(int)
    editor.change_look(colour=colour)
    finish(editor)
    changed = (np.abs(editor.state.view.picture() - before).max(axis=2) > 24).mean()
    assert (changed > 0.01) == (colour != "plain")


def test_handles_leave_for_the_command_line_and_come_out_the_same(editor, tmp_path):
    _, at = seen(editor, 0.9)
    mouse(editor, at, at + np.array([-20, -30]))
    editor.set_weight(2.5)
    editor.commit("Weight")
    export_handles(editor, tmp_path / "h.json")
    (row,) = io.load_handles(tmp_path / "h.json", 120).frames[0]
    handle = editor.edit.handles[0]
    assert row == io.HandleTarget(handle.vertices[0], handle.targets[0], 2.5, handle.kind)
    editor.clear()
    with pytest.raises(InputError, match="no handles"):
        export_handles(editor, tmp_path / "h.json")


def test_anti_aliasing_is_off_while_moving_and_back_at_rest(editor):
    _, at = seen(editor, 0.9)
    event(editor, "MouseMoveEvent", at)
    event(editor, "LeftButtonPressEvent", at)
    event(editor, "MouseMoveEvent", at + np.array([-10, -10]))
    finish(editor)
    assert not editor.state.view.is_sharp
    event(editor, "LeftButtonReleaseEvent", at + np.array([-10, -10]))
    wait_for(lambda: editor.idle, editor.tick)
    assert editor.state.view.is_sharp


def test_an_error_of_the_solver_is_a_message_and_the_session_lives(editor, monkeypatch, heard):
    def broken(*_, **__):
        raise RuntimeError("no luck today")

    _, at = seen(editor, 0.9)
    with monkeypatch.context() as patch:
        patch.setattr(deformer.HandleSolver, "solve", broken)
        mouse(editor, at, at + np.array([-20, -30]))
    assert "no luck today" in texts(heard, MistakeMade)[0]
    assert len(editor.edit.handles) == 1
    mouse(editor, (4, 4))
    at = editor.state.camera.project([editor.edit.handles[0].centre], SIZE)[0]
    mouse(editor, at, at + np.array([5, 5]))
    assert editor.answer.final and editor.answer.request.edit == editor.edit


def test_a_fast_drag_leaves_no_backlog(editor):
    _, at = seen(editor, 0.95)
    event(editor, "MouseMoveEvent", at)
    event(editor, "LeftButtonPressEvent", at)
    for n in range(300):  # faster than anything can be solved or drawn
        event(editor, "MouseMoveEvent", at + np.array([-0.1, -0.15]) * n)
    wanted, before, answered = editor.edit, editor.answer.request.number, set()

    def look():
        editor.tick()
        answered.add(editor.answer.request.number)

    wait_for(lambda: editor.answer.request.edit == wanted, look, pause=0.0)
    # One that was ready, one that was under way, and the newest.
    assert len(answered - {before}) <= 3
    assert editor.answer.request.number > 250
    event(editor, "LeftButtonReleaseEvent", at + np.array([-30, -45]))
    finish(editor)
    assert len(editor.session.entries) == 2


def test_recordings_and_turntables_are_animations(editor, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "_TURN", 5)
    recorder = Recorder(editor)
    _, at = seen(editor, 0.95)
    mouse(editor, at, at + np.array([-25, -40]))
    pictures = recorder.stop()
    assert len(pictures) >= 2 and pictures[0].shape == (*SIZE[::-1], 3)
    assert (pictures[0] != pictures[-1]).any()
    editor.run(save_recording(editor, tmp_path / "drag.glb", pictures))
    finish(editor)
    shapes = deformer.load_shapes(tmp_path / "drag.glb", clip="drag", fps=recording.FPS).vertices
    assert len(shapes) == len(pictures)
    # The clip ends at the pose, to its tolerance, and has begun elsewhere.
    size = editor.model.reference.bounding_diagonal
    np.testing.assert_allclose(shapes[-1], editor.vertices, atol=2e-3 * size)
    assert np.abs(shapes[0] - shapes[-1]).max() > 1e-2 * size
    save_animation(tmp_path / "drag.gif", pictures, recording.FPS)
    with Image.open(tmp_path / "drag.gif") as movie:
        assert movie.size == SIZE and getattr(movie, "n_frames", 1) > 1
    camera = editor.state.camera
    editor.run(save_turntable(editor, tmp_path / "turn.gif"))
    finish(editor)
    assert (tmp_path / "turn.gif").is_file() and editor.state.camera == camera
    pytest.importorskip("imageio_ffmpeg", reason="MP4 needs imageio-ffmpeg")
    save_animation(tmp_path / "drag.mp4", pictures, recording.FPS)
    assert (tmp_path / "drag.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_recording_of_too_many_shapes_is_one_of_pictures(editor, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "_MOST_BYTES", 100)
    recorder = Recorder(editor)
    _, at = seen(editor, 0.95)
    mouse(editor, at, at + np.array([-25, -40]))
    pictures = recorder.stop()
    assert len(pictures) >= 2 and pictures.shapes is None
    with pytest.raises(deformer.InputError, match="record a shorter drag"):
        list(save_recording(editor, tmp_path / "drag.glb", pictures))


def test_a_screenshot_shows_the_mesh(editor, tmp_path):
    save_screenshot(editor, tmp_path / "a.png")
    image = np.asarray(Image.open(tmp_path / "a.png")).astype(int)
    pixels = np.floor(editor.state.camera.project(editor.vertices, SIZE))
    shown = [v for v, at in enumerate(pixels) if editor.stage.vertex_at(at + 0.5) == v]
    x, y = pixels[shown].astype(int).T
    # The light makes some of the surface as bright as what is behind it, left of the tube.
    assert np.median(np.abs(image[y, x] - image[y, 2]).sum(axis=1)) > 30


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


def test_targets_in_other_units_are_told(editor, heard):
    rest = editor.model.reference.vertices
    for factor in (1.0, 1000.0):
        handles = [
            Handle(n + 1, (v,), (tuple(factor * rest[v]),)) for n, v in enumerate((0, 40, 80, 119))
        ]
        editor.session.change(editor.edit.with_handles(handles))
        editor.commit("Place handles")
        told = any("millimetres" in text for text in texts(heard, NoticeGiven))
        assert told == (factor > 1)


def test_a_session_brings_its_target_back(editor, tmp_path, heard):
    target = deformer.Mesh(sequence().vertices[4], editor.model.reference.faces)
    mesh, file = tmp_path / "t.ply", tmp_path / "a.json"
    io.save_mesh(mesh, target)
    editor.load_target(mesh)
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
    event(editor, "LeftButtonPressEvent", at)
    event(editor, "LeftButtonReleaseEvent", at)
    finish(editor)
    assert editor.edit.handles == () and not editor.session.changed


def test_a_component_can_stay_coloured(editor):
    k = int(editor.activations.order[1])
    editor.change_look(colour=f"component:{k}")
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


@pytest.mark.parametrize("command", ["delete", "mirror", "suggest"])
def test_a_command_that_needs_a_handle_says_so(editor, heard, command):
    getattr(editor, command)()
    assert texts(heard, NoticeGiven)
    heard.clear()
    editor.set_kind("pin")
    assert "Select a handle" in texts(heard, NoticeGiven)[0]


def test_a_rehearsal_leaves_no_trace(editor):
    handle = Handle(1, (115,), ((1.9, 0.4, 0.2),), "exact")
    edit = replace(editor.edit, handles=(handle,))
    fresh, rehearsed = PoseWorker(editor.model), PoseWorker(editor.model)
    rehearsed.rehearse()
    expected, found = fresh.final_pose(edit).vertices, rehearsed.final_pose(edit).vertices
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("density", [1.0, 2.0])
def test_a_dense_screen_changes_neither_aim_nor_the_size_of_handles(editor, screen, density):
    """The same picture on a screen of twice the pixels: same vertices, balls twice as many wide."""
    plotter = editor.state.view.plotter
    plotter.window_size = [int(density * side) for side in SIZE]
    screen[0] = density
    assert editor.stage.size == SIZE
    editor.frame()
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
    editor.select([])
    editor.stage.hover(Hover())
    editor.tick()
    picture = editor.state.view.grab().astype(int)
    red, green, blue = np.moveaxis(picture, 2, 0)
    ball = (red > 150) & (red - blue > 80) & (red - green > 50)
    assert np.sqrt(4 / np.pi * ball.sum()) == pytest.approx(14 * density, rel=0.25)


def test_a_recording_survives_another_size_of_the_window(editor):
    recorder = Recorder(editor)
    for size in (SIZE, (300, 200)):
        editor.state.view.plotter.window_size = list(size)
        editor.state.set_camera(editor.state.camera)
        time.sleep(2 / recording.FPS)
        editor.tick()
    assert {picture.shape for picture in recorder.stop()} == {(200, 300, 3)}
