"""The timeline on an off-screen editor: keys, the fitted clip, playback, undo, the session."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformer import InputError
from deformer_app.rendering.palette import KINDS, SELECTED, rgb
from deformer_app.viewer import filming
from deformer_app.viewer.changes import MistakeMade, NoticeGiven, PlaybackBegun
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.pose_blend import PoseBlend
from deformer_app.viewer.pose_commands import save_pose, start_from
from deformer_app.viewer.pose_worker import replay
from deformer_app.viewer.poses import SavedPose
from deformer_app.viewer.session import Session
from deformer_app.viewer.timeline import exports
from deformer_app.viewer.timeline.clip_job import Request, fit_clip
from deformer_app.viewer.timeline.keys import SLIDERS, Key
from off_screen_editor import texts
from waiting import wait_for

HANDLES = (10, 60, 110)


@pytest.fixture
def clock():
    """Seconds that the timeline's clock shows; a list of one number."""
    return [0.0]


@pytest.fixture
def timeline(editor, clock):
    editor.timeline.clock = lambda: clock[0]
    finish(editor, clock)
    return editor.timeline


def finish(editor, clock):
    """Tick until nothing is left to do."""
    tick(editor, clock)
    wait_for(lambda: not editor.busy, lambda: tick(editor, clock), pause=0.001)


def tick(editor, clock):
    """Do what is due; the clock goes on by a tenth of a second."""
    clock[0] += 0.1
    editor.tick()


def place(editor, clock, *vertices):
    for vertex in vertices:
        editor.handles.place(vertex, add=True)
    editor.commit("Place handle")
    editor.handles.select_all()
    editor.handles.set_kind("exact")
    finish(editor, clock)


def drag(editor, clock, shift, number=1):
    editor.handles.select([number])
    for n in range(1, 5):
        editor.handles.move_selected(translation(np.array(shift) * n / 4))
        editor.tick()
    editor.commit("Drag")
    finish(editor, clock)


@pytest.fixture
def keyed(editor, timeline, clock):
    """A clip of three exact handles: the first is elsewhere at frame 12 than at frames 0 and 24."""
    place(editor, clock, *HANDLES)
    timeline.set_clip(length=25)
    timeline.keys.set()
    timeline.seek(24)
    timeline.keys.set()
    timeline.seek(12)
    drag(editor, clock, [0.1, 0.25, 0.1])
    return timeline


def test_a_step_with_auto_key_is_one_entry_with_a_key_for_what_it_moved(editor, keyed):
    assert [entry.label for entry in editor.session.entries][-4:] == [
        *("Clip", "Key at frame 0", "Key at frame 24", "Drag"),
    ]
    assert {name for name in keyed.clip.names if name[1] == 12} == {(1, 12)}
    assert keyed.clip.at(editor.edit, 12) == editor.edit


def test_without_keys_or_auto_key_a_step_sets_none(editor, timeline, clock):
    place(editor, clock, *HANDLES)
    assert timeline.clip.names == []
    timeline.keys.set([1])
    timeline.auto_key = False
    drag(editor, clock, [0.0, 0.1, 0.0])
    assert timeline.clip.names == [(1, 0)]


def test_each_key_reproduces_its_pose_at_its_frame(editor, keyed, clock):
    """Handles are on their targets in the fitted clip; a shown frame at rest has the pose."""
    diagonal = editor.model.reference.bounding_diagonal
    pose = editor.vertices.copy()
    for frame in (0, 12, 24):
        state = keyed.clip.at(editor.edit, frame)
        assert keyed.fitted is not None
        shape = keyed.fitted.vertices[frame]
        targets = [handle.targets[0] for handle in state.handles]
        np.testing.assert_allclose(shape[list(HANDLES)], targets, atol=1e-6)
        keyed.seek(frame)
        np.testing.assert_array_equal(editor.vertices, shape)
        finish(editor, clock)
        assert np.abs(editor.vertices - shape).max() < 5e-3 * diagonal
    keyed.seek(12)
    finish(editor, clock)
    assert np.abs(editor.vertices - pose).max() < 1e-3 * diagonal


def test_a_frame_of_the_clip_is_the_pose_of_its_handles(editor, keyed, clock):
    """Against a solver that knows nothing of the clip."""
    diagonal = editor.model.reference.bounding_diagonal
    keyed.auto_key = False
    for frame in (4, 12, 18):
        edit = keyed.clip.at(editor.edit, frame)
        session = Session(editor.session.model, [replace(editor.session.entry, edit=edit,
                                                         solution=None)])  # fmt: skip
        alone = replay(session, editor.model).vertices
        assert np.abs(keyed.fitted.vertices[frame] - alone).max() < 5e-3 * diagonal


def test_sliders_without_handles_are_a_clip_of_their_shapes(editor, timeline, clock):
    start = np.array(editor.edit.base)
    timeline.set_clip(length=11)
    timeline.keys.set([SLIDERS])
    timeline.seek(10)
    end = start + 0.5 * np.arange(1, len(start) + 1)
    editor.change("Slide", replace(editor.edit, base=tuple(end.tolist())))
    finish(editor, clock)
    assert timeline.clip.names == [(SLIDERS, 0), (SLIDERS, 10)]
    np.testing.assert_allclose(timeline.fitted.z[5], (start + end) / 2, atol=1e-9)
    expected = editor.model.decode((start + end) / 2)
    np.testing.assert_allclose(timeline.fitted.vertices[5], expected, atol=1e-5)
    timeline.seek(5)
    finish(editor, clock)
    np.testing.assert_allclose(editor.vertices, expected, atol=1e-5)


def test_the_playhead_is_no_step_and_shows_each_frame_s_handles(editor, keyed, clock):
    steps = len(editor.session.entries)
    editor.session.mark_unsaved()
    keyed.seek(6)
    assert len(editor.session.entries) == steps
    assert editor.edit == keyed.clip.at(editor.edit, 6)
    x = editor.edit.handle(1).targets[0][0]
    start, end = (keyed.clip.at(editor.edit, f).handle(1).targets[0][0] for f in (0, 12))
    assert x == pytest.approx((start + end) / 2)
    keyed.seek(1000)
    assert keyed.frame == 24
    keyed.seek(-5)
    assert keyed.frame == 0


def test_undo_takes_a_key_back_and_redo_sets_it_again(editor, keyed, clock):
    clip, moved = keyed.clip, editor.edit.handle(1).targets
    editor.undo()
    assert keyed.clip != clip and (1, 12) not in keyed.clip.names
    assert keyed.frame == 12
    assert editor.edit == keyed.clip.at(editor.edit, 12) != moved
    finish(editor, clock)
    still = keyed.fitted.vertices
    assert np.abs(still[12] - still[0]).max() < 1e-6
    editor.redo()
    assert keyed.clip == clip and editor.edit.handle(1).targets == moved
    finish(editor, clock)
    assert np.abs(keyed.fitted.vertices[12] - keyed.fitted.vertices[0]).max() > 0.1


def test_a_change_of_a_handle_without_keys_is_fitted_too(editor, keyed, clock):
    before = keyed.fitted
    editor.handles.place(80)
    editor.commit("Place handle")
    assert keyed.fitted is None
    keyed.auto_key = False
    finish(editor, clock)
    assert keyed.fitted is not None and keyed.fitted is not before


def test_keys_are_deleted_moved_copied_and_eased_as_steps(editor, keyed, clock):
    keyed.keys.select([(1, 12)])
    keyed.keys.move(-4)
    assert (1, 8) in keyed.clip.names and keyed.selected == {(1, 8)}
    keyed.keys.copy()
    keyed.seek(16)
    keyed.keys.paste()
    assert keyed.clip.key((1, 16)).value == keyed.clip.key((1, 8)).value
    keyed.keys.ease("linear")
    assert keyed.clip.key((1, 16)).ease == "linear" and keyed.clip.key((1, 8)).ease == "ease"
    keyed.keys.delete()
    assert (1, 16) not in keyed.clip.names
    keyed.seek(24)
    keyed.keys.delete()
    assert not [name for name in keyed.clip.names if name[1] == 24 and name[0] == 1]
    labels = [entry.label for entry in editor.session.entries]
    assert labels[-5:] == ["Move keys", "Paste keys", "Linear", "Delete keys", "Delete keys"]
    for _ in range(5):
        editor.undo()
    assert (1, 12) in keyed.clip.names


def test_the_next_key_is_gone_to(keyed):
    keyed.go_to_key(1)
    assert keyed.frame == 24
    keyed.go_to_key(1)
    assert keyed.frame == 24
    keyed.go_to_key(-1)
    keyed.go_to_key(-1)
    assert keyed.frame == 0


def test_a_clip_plays_in_real_time_and_shows_its_frames(editor, keyed, clock):
    keyed.set_clip(fps=30)
    keyed.loop = False
    finish(editor, clock)
    keyed.seek(0)
    keyed.play()
    begun, shown = clock[0], []
    while keyed.playing:
        editor.tick()
        shown.append(keyed.frame)
        assert keyed.frame == min(int((clock[0] - begun) * 30 + 1e-9), 24)
        np.testing.assert_array_equal(editor.vertices, keyed.fitted.vertices[keyed.frame])
        clock[0] += 0.05
    assert shown[-1] == 24 and len(set(shown)) < 25  # a slow picture leaves frames out


def test_playback_ends_with_a_drag_and_goes_on_without_end_in_a_loop(editor, keyed, clock):
    keyed.play()
    for _ in range(100):
        clock[0] += 0.07
        editor.tick()
    assert keyed.playing
    editor.handles.select([1])
    editor.handles.move_selected(translation([0.01, 0.0, 0.0]))
    editor.tick()
    assert not keyed.playing
    editor.revert()


def test_a_drag_cancels_the_fit_and_its_end_begins_another(editor, keyed, clock):
    keyed.set_clip(length=200)
    while keyed.progress is None:
        clock[0] += 0.1
        editor.tick()
    job = keyed._job
    editor.handles.select([1])
    editor.handles.move_selected(translation([0.02, 0.0, 0.0]))
    wait_for(lambda: job.done, editor.tick)
    assert job.result is None and job.error is None and keyed.fitted is None
    editor.commit("Drag")
    finish(editor, clock)
    assert len(keyed.fitted.vertices) == 200


def test_a_fit_that_cannot_be_done_is_told_once(editor, keyed, clock, heard, monkeypatch):
    from deformer_app.viewer.timeline import clip_job

    def refuse(*given):
        raise InputError("handles: no such vertices")

    monkeypatch.setattr(clip_job, "fit_clip", refuse)
    keyed.set_clip(length=30)
    finish(editor, clock)
    assert texts(heard, MistakeMade) == ["handles: no such vertices"]
    assert keyed.progress is None and keyed.fitted is None


def test_a_session_keeps_the_clip_its_history_and_the_playhead(editor, keyed, clock, tmp_path):
    keyed.seek(7)
    finish(editor, clock)
    editor.save_session(tmp_path / "work.json")
    assert not editor.session.changed
    keyed.seek(8)
    assert not editor.session.changed
    loaded = Session.load(tmp_path / "work.json")
    assert loaded.frame == 7
    assert [e.clip for e in loaded.entries] == [e.clip for e in editor.session.entries]
    shown = replay(loaded, editor.model).vertices
    diagonal = editor.model.reference.bounding_diagonal
    assert np.abs(shown - keyed.fitted.vertices[7]).max() < 5e-3 * diagonal


def test_a_session_without_a_timeline_opens(editor, keyed, clock, tmp_path):
    editor.save_session(tmp_path / "work.json")
    data = json.loads((tmp_path / "work.json").read_text())
    del data["clips"], data["tracks"], data["frame"]
    for entry in data["entries"]:
        del entry["clip"]
    (tmp_path / "old.json").write_text(json.dumps(data))
    editor.open_session(tmp_path / "old.json")
    assert keyed.clip.names == [] and keyed.frame == 0


DAMAGES = [
    (lambda d: d["clips"][-1].update(length=0), "clips[4].length"),
    (lambda d: d["clips"][-1].update(fps=7), "clips[4].fps"),
    (lambda d: d["clips"][-1].update(tracks=[99]), "clips[4].tracks"),
    (lambda d: d["tracks"][-1].update(owner=-1), "code"),
    (lambda d: d["clips"][-1]["tracks"].append(0), "one track an owner"),
    (lambda d: d["tracks"][-1].update(keys=[]), "keys"),
    (lambda d: d["tracks"][-1]["keys"].reverse(), "keys"),
    (lambda d: d["tracks"][-1]["keys"][0].update(ease="bounce"), "ease"),
    (lambda d: d["tracks"][-1]["keys"][0].update(targets=[[0, 0]]), "targets"),
    (lambda d: d["tracks"][-1]["keys"][0].update(targets=[]), "targets"),
    (
        lambda d: d["tracks"][-1].update(
            owner=-1, keys=[{"frame": 0, "ease": "ease", "code": [0.0]}]
        ),
        "numbers of a code",
    ),
    (lambda d: d["tracks"][-1].update(measured=1), "measured"),
    (lambda d: d["entries"][-1].update(clip=99), "clip"),
    (lambda d: d.update(frame=99), "frame"),
]


def test_a_damaged_timeline_is_one_line(editor, keyed, tmp_path):
    editor.session.save(tmp_path / "work.json")
    for damage, words in DAMAGES:
        data = json.loads((tmp_path / "work.json").read_text())
        damage(data)
        (tmp_path / "bad.json").write_text(json.dumps(data))
        with pytest.raises(InputError) as found:
            editor.open_session(tmp_path / "bad.json")
        text = str(found.value)
        assert "bad.json" in text or "model" in text, words
        assert words in text and "\n" not in text


def test_two_handles_at_a_vertex_are_one_in_a_clip(editor, timeline, clock):
    """A region may have a vertex that is a handle of its own."""
    place(editor, clock, 60)
    editor.handles.add_region(range(56, 72))
    finish(editor, clock)
    timeline.keys.set()
    finish(editor, clock)
    assert timeline.fitted is not None


def test_a_fit_depends_on_keys_and_unkeyed_handles_not_on_the_playhead(editor, keyed):
    one = Request.of(keyed.clip, keyed.clip.at(editor.edit, 3))
    assert one == Request.of(keyed.clip, keyed.clip.at(editor.edit, 20))
    other = keyed.clip.with_keys([(1, Key(5, keyed.clip.key((1, 0)).value))])
    assert one != Request.of(other, editor.edit)


def test_the_progress_ends_with_all_frames(editor, keyed):
    seen = []
    request = Request.of(keyed.clip, editor.edit)
    fit_clip(editor.model, request, lambda done, total: seen.append((done, total)))
    assert seen[0] == (0, 25) and seen[-1] == (25, 25) and seen == sorted(seen)


def test_pictures_of_a_clip_show_no_handles(editor, keyed, clock, tmp_path, monkeypatch):
    taken = []

    def keep(path, pictures, fps):
        taken.extend(pictures)

    def coloured(picture):
        """Number of pixels that are about the colour of a selected handle or of exact ones."""
        off = [
            np.abs(picture.astype(int) - rgb(c)).sum(axis=-1) for c in (SELECTED, KINDS["exact"])
        ]
        return int((np.minimum(*off) < 120).sum())

    monkeypatch.setattr(filming, "save_animation", keep)
    editor.handles.select([1])
    keyed.set_onion(before=2, after=2)
    finish(editor, clock)
    assert coloured(editor.state.view.picture()) > 20
    editor.run(exports.export_clip(editor, tmp_path / "clip.gif"))
    finish(editor, clock)
    assert len(taken) == 25 and not any(coloured(picture) for picture in taken)
    assert coloured(editor.state.view.picture()) > 20, "the window shows them again"
    assert (keyed.onion.before, keyed.onion.after) == (2, 2)


def test_playing_is_told(editor, keyed):
    heard = []
    editor.on_change.append(heard.append)
    keyed.play()
    assert [type(change) for change in heard].count(PlaybackBegun) == 1
    keyed.stop()


def fitted_shape(timeline, frame):
    assert timeline.fitted is not None
    return timeline.fitted.vertices[frame]


def test_a_pose_at_one_frame_leaves_the_poses_of_the_others(editor, timeline, clock):
    """With handles of its own, which pull at no other frame, and without some that are keyed."""
    size = editor.model.reference.bounding_diagonal
    place(editor, clock, 10, 110)
    drag(editor, clock, [0.0, 0.2, 0.1], number=2)
    first = save_pose(editor, "first")
    shapes = {0: editor.vertices.copy()}
    editor.prior.reset()
    place(editor, clock, 60, 110)
    drag(editor, clock, [0.0, -0.1, 0.25], number=editor.edit.handles[1].id)
    second = save_pose(editor, "second")
    shapes[20] = editor.vertices.copy()
    start_from(editor, first)
    finish(editor, clock)
    timeline.keys.set([SLIDERS, *(handle.id for handle in editor.edit.handles)])
    finish(editor, clock)
    names = set(timeline.clip.names)
    for frame in (20, 40):
        timeline.seek(frame)
        start_from(editor, second if frame == 20 else first)
        finish(editor, clock)
    assert names < set(timeline.clip.names)
    assert {(SLIDERS, 20), (SLIDERS, 40)} < set(timeline.clip.names), "the whole pose is keyed"
    assert {h.vertices[0] for h in editor.edit.handles} == {10, 60, 110}
    for frame, shape in {**shapes, 40: shapes[0]}.items():
        timeline.seek(frame)
        finish(editor, clock)
        off = np.abs(editor.vertices - shape).max() / size
        assert off < 0.01, f"frame {frame}"
        assert np.abs(fitted_shape(timeline, frame) - shape).max() < 0.01 * size
    editor.undo()
    editor.undo()
    finish(editor, clock)
    assert set(timeline.clip.names) == names


def test_a_kind_that_a_pose_brings_to_all_frames_is_told(editor, timeline, clock):
    told = []
    place(editor, clock, 10)
    pose = save_pose(editor)
    editor.handles.set_kind("soft")
    timeline.keys.set()
    finish(editor, clock)
    timeline.seek(20)
    editor.on_change.append(told.append)
    start_from(editor, pose)
    finish(editor, clock)
    assert editor.edit.handles[0].kind == "exact"
    assert any("is exact now, at all frames" in text for text in texts(told, NoticeGiven))


def test_poses_that_are_keyed_before_the_clip_is_fitted_stay_as_they_are(editor, timeline, clock):
    """Each with a handle of its own, whose keys at the other frames are on the poses there."""
    size = editor.model.reference.bounding_diagonal
    poses = []
    for vertex, shift in ((10, [0, 0.2, 0.1]), (60, [0, -0.1, 0.25]), (30, [0.1, 0.1, -0.2])):
        editor.handles.clear()
        place(editor, clock, vertex, 110)
        drag(editor, clock, shift, number=editor.edit.handles[1].id)
        poses.append((save_pose(editor), editor.vertices.copy()))
    start_from(editor, poses[0][0])
    finish(editor, clock)
    timeline.keys.set([SLIDERS, *(handle.id for handle in editor.edit.handles)])
    for frame, (pose, _) in ((20, poses[1]), (40, poses[2])):
        timeline.seek(frame)
        steps = len(editor.session.entries)
        start_from(editor, pose)
        wait_for(
            lambda steps=steps: len(editor.session.entries) > steps,
            lambda: tick(editor, clock),
            pause=0.001,
        )
        assert timeline.waiting, "the fit of this step is still to come"
    finish(editor, clock)
    for frame, (_, shape) in zip((0, 20, 40), poses, strict=True):
        timeline.seek(frame)
        finish(editor, clock)
        assert np.abs(fitted_shape(timeline, frame) - shape).max() < 0.01 * size, f"frame {frame}"


@pytest.mark.parametrize("near", [True, False])
def test_a_pin_of_a_pose_goes_on_as_the_one_that_holds_its_place(editor, timeline, clock, near):
    """One that overlaps it by half; one elsewhere gets a row of its own."""
    size, model = editor.model.reference.bounding_diagonal, editor.model
    editor.pins.radius = 0.1

    def pose(pinned, shift):
        editor.handles.clear()
        editor.pins.pin_at(pinned)
        editor.handles.place(110)
        drag(editor, clock, shift, number=editor.edit.handles[1].id)
        return save_pose(editor), editor.vertices.copy()

    distances = model.distances(8)
    distances[8] = np.inf if near else 0.0
    other = int(distances.argmin() if near else np.abs(distances - 0.25 * size).argmin())
    first, start = pose(8, [0.0, 0.2, 0.1])
    second, later = pose(other, [0.0, -0.1, 0.25])
    patches = [set(p.handles[0].patch) for p in (first, second)]
    assert patches[0] != patches[1] and bool(patches[0] & patches[1]) == near
    start_from(editor, first)
    finish(editor, clock)
    timeline.keys.set([SLIDERS, *(handle.id for handle in editor.edit.handles)])
    finish(editor, clock)
    pin, keys = editor.edit.handles[0], timeline.clip.copied(timeline.clip.names)
    timeline.seek(20)
    start_from(editor, second)
    finish(editor, clock)
    pins = [handle for handle in editor.edit.handles if handle.kind == "pin"]
    assert len(pins) == (1 if near else 2) and pin.id in {handle.id for handle in pins}
    assert [name for name in timeline.clip.names if name[0] == pin.id] == [
        (pin.id, 0),
        (pin.id, 20),
    ]
    assert timeline.clip.copied((owner, key.frame) for owner, key in keys) == keys
    for frame, shape in ((0, start), (20, later)):
        timeline.seek(frame)
        finish(editor, clock)
        assert np.abs(editor.vertices - shape).max() < 0.01 * size, f"frame {frame}"


@pytest.mark.parametrize("auto_key", [True, False])
@pytest.mark.parametrize("fitted", [True, False])
def test_a_pin_of_another_size_holds_what_it_held_at_every_key(
    editor, timeline, clock, auto_key, fitted
):
    """Its keys told places of the vertices of before, where those of now were pulled to."""
    size = editor.model.reference.bounding_diagonal
    editor.pins.radius = 0.2
    editor.pins.pin_at(8)
    editor.handles.place(110)
    finish(editor, clock)
    pin, hand = editor.edit.handles
    for frame in (0, 20):
        timeline.seek(frame)
        finish(editor, clock)
        drag(editor, clock, [0.0, 0.01 * frame, 0.1], number=hand.id)
        timeline.keys.set([pin.id, hand.id])
        finish(editor, clock)
    shapes = {frame: fitted_shape(timeline, frame).copy() for frame in (0, 20)}
    timeline.auto_key = auto_key
    if not fitted:
        timeline._fitted = None
    editor.handles.select([pin.id])
    editor.pins.resize_selected(3)
    finish(editor, clock)
    assert len(editor.edit.handles[0].targets) == len(pin.targets)
    assert editor.edit.handles[0].vertices != pin.vertices
    assert timeline.clip.track(pin.id).frames == [0, 20]
    for frame, shape in shapes.items():
        timeline.seek(frame)
        finish(editor, clock)
        off = np.abs(fitted_shape(timeline, frame) - shape).max()
        assert off < (0.01 if fitted else 0.03) * size, f"frame {frame}"


def test_a_pose_gives_way_to_what_changes_meanwhile(editor, timeline, clock):
    told = []
    place(editor, clock, 10)
    timeline.keys.set()
    finish(editor, clock)
    pose = save_pose(editor)
    editor.on_change.append(told.append)
    start_from(editor, pose, "Paste pose")
    timeline.seek(20)
    finish(editor, clock)
    assert editor.session.entry.label != "Paste pose"
    assert any("Paste pose: given up" in text for text in texts(told, NoticeGiven))


def test_a_handle_that_is_placed_at_one_frame_pulls_at_no_other(editor, timeline, clock):
    size = editor.model.reference.bounding_diagonal
    place(editor, clock, 10, 110)
    timeline.keys.set()
    timeline.seek(20)
    drag(editor, clock, [0.0, 0.25, 0.1], number=2)
    timeline.seek(40)
    drag(editor, clock, [0.0, -0.1, 0.2], number=2)
    finish(editor, clock)
    before = fitted_shape(timeline, slice(0, 21)).copy()
    place(editor, clock, 60)
    drag(editor, clock, [0.0, 0.15, -0.1], number=editor.edit.handles[-1].id)
    finish(editor, clock)
    assert {name for name in timeline.clip.names if name[0] == editor.edit.handles[-1].id} == {
        (editor.edit.handles[-1].id, frame) for frame in (0, 20, 40)
    }
    off = np.abs(fitted_shape(timeline, [0, 20]) - before[[0, 20]]).max() / size
    assert off < 0.01


def test_a_blend_in_a_clip_keeps_handles_that_have_keys(editor, timeline, clock):
    place(editor, clock, 10, 110)
    drag(editor, clock, [0.0, 0.2, 0.1], number=2)
    timeline.keys.set()
    ids = {handle.id for handle in editor.edit.handles}
    other = editor.handles.on_surface(Handle(9, (60,), ((0.0, 0.0, 0.0),)))
    pose = SavedPose("other", replace(editor.edit, handles=(other,)))
    timeline.seek(20)
    finish(editor, clock)
    blend = PoseBlend(editor)
    blend.choose(pose)
    blend.move(0.5)
    blend.move(1.0)
    blend.commit()
    finish(editor, clock)
    assert ids < {handle.id for handle in editor.edit.handles}
    assert {frame for owner, frame in timeline.clip.names if owner not in ids} == {0, 20}
