"""The session: endless history, one entry a drag, one file for everything."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from PIL import Image

from deformer import InputError, io
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.session import ModelName, Session
from deformer_app.viewer.thumbnails import SIZE, save_thumbnail

BASE = (0.1, -0.2, 1 / 3)
NAME = ModelName("somewhere/model", "ab" * 32)
# A quarter turn about z, then one about x: no number is rounded.
TURN = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
ANSWER = Solution((0.3, 0.1, 1e-17), (0.0, 1e-300, 2.0), (1 / 7, 0.0, -5.0))


def handle(number, vertex=7, **changes):
    return replace(Handle(number, (vertex,), ((1.0, 2.0, 1 / 3),)), **changes)


def session():
    return Session.begin(NAME, BASE)


def test_a_drag_is_one_entry_however_many_moves_it_has():
    work = session()
    for step in range(50):
        moved = handle(1).moved(translation([0.01 * step, 0, 0]))
        work.change(work.edit.with_handles([moved]))
    assert len(work.entries) == 1 and work.under_way
    assert work.commit("Drag")
    assert [entry.label for entry in work.entries] == ["Start", "Drag"]
    assert work.edit.handle(1).targets[0][0] == pytest.approx(1.49)


def test_a_drag_that_comes_to_nothing_is_no_entry():
    work = session()
    work.change(replace(work.edit, noise=0.1))
    work.change(replace(work.edit, noise=work.entry.edit.noise))
    assert not work.commit("Nothing")
    assert len(work.entries) == 1 and not work.under_way


@settings(max_examples=60)
@given(st.lists(st.sampled_from(["do", "undo", "redo", "revert"]), max_size=40))
def test_history_is_a_list_with_a_cursor(steps):
    """Against the plainest model: a list of states, cut off after the cursor by a new one."""
    work, states, at = session(), [session().edit], 0
    for n, step in enumerate(steps):
        if step == "do":
            edit = replace(work.edit, noise=1.0 + n)
            work.do(f"step {n}", edit)
            states, at = [*states[: at + 1], edit], at + 1
        elif step == "undo":
            work.undo()
            at = max(at - 1, 0)
        elif step == "redo":
            work.redo()
            at = min(at + 1, len(states) - 1)
        else:
            work.change(replace(work.edit, noise=99.0))
            work.revert()
        assert work.edit == states[at]
        assert (work.can_undo, work.can_redo) == (at > 0, at + 1 < len(states))


def test_history_has_no_limit():
    work = session()
    for n in range(3000):
        work.do("step", replace(work.edit, noise=1.0 + n))
    for _ in range(3000):
        work.undo()
    assert work.edit.noise == session().edit.noise and not work.can_undo


def test_the_pose_of_an_entry_is_noted_only_if_it_is_its_own():
    work = session()
    old = work.edit
    work.do("Place", old.with_handles([handle(1)]))
    work.solved(old, ANSWER)
    assert work.entry.solution is None
    work.solved(work.edit, ANSWER)
    assert work.entry.solution == ANSWER
    work.change(replace(work.edit, noise=1.0))
    work.solved(work.edit, Solution((0.0,), (0, 0, 0), (0, 0, 0)))
    work.revert()
    assert work.entry.solution == ANSWER


def test_a_pose_on_its_way_does_not_replace_the_one_at_rest():
    work = session()
    work.do("Place", work.edit.with_handles([handle(1)]))
    moving = replace(ANSWER, z=(1.0, 2.0, 3.0), final=False)
    work.solved(work.edit, moving)
    assert work.entry.solution == moving
    work.solved(work.edit, ANSWER)
    work.solved(work.edit, moving)
    assert work.entry.solution == ANSWER


def test_the_pose_of_another_entry_of_the_same_edit_does_not_replace_the_one_at_rest():
    """A step that changes keys alone has the edit of the one before, whose pose comes late."""
    work = session()
    work.do("Place", work.edit.with_handles([handle(1)]))
    work.solved(work.edit, ANSWER)
    late = replace(ANSWER, z=(1.0, 2.0, 3.0))
    work.solved(work.edit, late)
    assert work.entry.solution == ANSWER
    work.show_solution(late)
    assert work.entry.solution == late
    work.change(replace(work.edit, noise=1.0))
    work.show_solution(ANSWER)
    work.revert()
    assert work.entry.solution == late


def test_saving_and_loading_gives_every_number_back(tmp_path):
    work = session()
    work.do("Place", work.edit.with_handles([handle(1, kind="pin"), handle(2, 9, weight=0.3)]))
    work.solved(work.edit, ANSWER)
    region = Handle(3, (1, 2), ((0.1, 0.0, 0.0), (0.0, 1e-9, 0.0)), patch=(1, 2, 5))
    work.do("Paint", work.edit.with_handles([region.at(region.targets, [[0, 0, 0.1], [1, 0, 0]])]))
    work.solved(work.edit, replace(ANSWER, final=False))
    turned = replace(handle(4).oriented(TURN), orientation_weight=0.25)
    work.do("Rotate", work.edit.with_handles([turned, handle(5).oriented(np.eye(3))]))
    work.do("Body", replace(work.edit, body="moves", noise=0.02, base=(1.0, 2.0, 3.0)))
    work.undo()
    work.view = {"camera": {"position": [1, 2, 3]}}
    work.save(tmp_path / "a.json")
    again = Session.load(tmp_path / "a.json")
    assert again.entries == work.entries
    assert (again.cursor, again.model, again.view) == (work.cursor, work.model, work.view)
    assert again.can_redo and not again.changed
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_sessions_from_before_orientations_open(tmp_path):
    work = session()
    work.do("Place", work.edit.with_handles([handle(1), handle(2, 9)]))
    work.save(tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    for entry in data["handles"]:
        del entry["orientation"], entry["orientation_weight"]
    (tmp_path / "a.json").write_text(json.dumps(data))
    assert Session.load(tmp_path / "a.json").entries == work.entries


@pytest.mark.parametrize(
    ("key", "value", "part"),
    [
        ("orientation", [1, 0, 0], "(4,) or (3, 3)"),
        ("orientation", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "reflection"),
        ("orientation", "up", "numbers"),
        ("orientation_weight", -1, "above 0"),
    ],
)
def test_damaged_orientations(tmp_path, key, value, part):
    work = session()
    work.do("Place", work.edit.with_handles([handle(1)]))
    work.save(tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    data["handles"][0][key] = value
    (tmp_path / "a.json").write_text(json.dumps(data))
    with pytest.raises(InputError) as caught:
        Session.load(tmp_path / "a.json")
    assert f"a.json: handles[0].{key}: " in str(caught.value) and part in str(caught.value)


def test_the_summary_is_a_handles_file(tmp_path):
    turned = replace(handle(4).oriented(TURN), orientation_weight=0.25)
    work = session()
    work.do("Place", work.edit.with_handles([turned, handle(5, 3)]))
    io.write_json(tmp_path / "h.json", {"handles": work.summary()["handles"]})
    (rows,) = io.load_handles(tmp_path / "h.json", 10).frames
    assert [(row.vertex, row.orientation, row.orientation_weight) for row in rows] == [
        (7, TURN, 0.25),
        (3, None, 1.0),
    ]


def test_a_long_session_stays_small(tmp_path):
    """A handle that does not change is written once."""
    work = session()
    many = [handle(n, n) for n in range(100)]
    work.do("Place", work.edit.with_handles(many))
    for n in range(100):
        work.do("Drag", work.edit.with_handles([handle(1, 1, weight=2.0 + n)]))
    work.save(tmp_path / "a.json")
    assert len(json.loads((tmp_path / "a.json").read_text())["handles"]) == 200


def test_what_would_be_lost(tmp_path):
    work = session()
    assert not work.changed
    work.do("Place", work.edit.with_handles([handle(1)]))
    assert work.changed
    work.undo()
    assert not work.changed
    work.redo()
    work.write_copy(tmp_path / "copy.json")
    assert work.changed
    work.save(tmp_path / "a.json")
    assert not work.changed
    work.solved(work.edit, ANSWER)
    assert not work.changed, "a pose found after saving is no change"
    work.mark_unsaved()
    assert work.changed


def test_ids_are_never_used_again():
    work = session()
    work.do("Place", work.edit.with_handles([handle(work.next_id())]))
    work.do("Delete", work.edit.without([1]))
    assert work.next_id() == 2


def test_arrays_for_the_solver():
    region = Handle(3, (1, 2), ((0.1, 0, 0), (0, 1e-9, 0)), weight=2.0, patch=(1, 2, 5))
    edit = Edit(BASE).with_handles([handle(1, kind="pin", weight=5.0), region])
    turned = handle(4).oriented(TURN).at([(1.0, 2.0, 1 / 3)], [(0.0, 0.5, 0.0)])
    edit = edit.with_handles([turned])
    assert edit.arrays() == {
        "vertices": [7, 1, 2, 7],
        "targets": [(1.0, 2.0, 1 / 3), (0.1, 0, 0), (0, 1e-9, 0), (1.0, 2.0, 1 / 3)],
        "weights": [5.0, 2.0, 2.0, 1.0],
        "kinds": ["pin", "soft", "soft", "soft"],
        "orientations": [None, None, None, TURN],
        "orientation_weights": [1.0] * 4,
        "gaps": [(0.0, 0.0, 0.0)] * 3 + [(0.0, 0.5, 0.0)],
    }
    assert set(map(len, Edit(BASE).arrays().values())) == {0}


def damaged(**changes):
    def change(data):
        data.update(changes)
        return data

    return change


@pytest.mark.parametrize(
    "change",
    [
        damaged(deformer_session=99),
        damaged(cursor=7),
        damaged(entries=[]),
        damaged(handles=[]),
        damaged(bases="x"),
        lambda data: [data],
        lambda data: {**data, "model": {}},
        lambda data: {**data, "handles": [{**data["handles"][0], "kind": "odd"}]},
        lambda data: {**data, "handles": [{**data["handles"][0], "targets": []}]},
        lambda data: {**data, "handles": [{**data["handles"][0], "targets": [[1, 2]]}]},
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, change):
    work = session()
    work.do("Place", work.edit.with_handles([handle(1)]))
    path = tmp_path / "a.json"
    work.save(path)
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(InputError, match=r"a\.json") as error:
        Session.load(path)
    assert "\n" not in str(error.value)


def places(value, path=()):
    """Paths to all values of a JSON value."""
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


def test_no_number_of_a_session_may_be_damaged(tmp_path):
    """Every number in turn; texts stay free, and what the view holds is checked by the window."""
    work = session()
    region = Handle(3, (1, 2), ((0.1, 0.0, 0.0), (0.0, 1e-9, 0.0)), patch=(1, 2, 5))
    work.do("Place", work.edit.with_handles([handle(1), region]))
    work.solved(work.edit, ANSWER)
    path = tmp_path / "a.json"
    work.save(path)
    text = path.read_text()
    numbers = 0
    for place in places(json.loads(text)):
        data = json.loads(text)
        parent = data
        for key in place[:-1]:
            parent = parent[key]
        if not place or isinstance(parent[place[-1]], str | list | dict) or place[0] == "view":
            continue
        numbers, is_flag = numbers + 1, isinstance(parent[place[-1]], bool)
        for bad in (float("inf"), float("nan"), 10**400, "1", True, [1], {}):
            if is_flag and bad is True:
                continue
            parent[place[-1]] = bad
            path.write_text(json.dumps(data))
            with pytest.raises(InputError, match=rf"a\.json: .*{place[-1]}"):
                Session.load(path)
    assert numbers > 30


@pytest.mark.parametrize(
    ("place", "bad"),
    [
        (("cursor",), -1),
        (("cursor",), 0.0),
        (("entries", 1, "base"), -1),
        (("entries", 1, "handles", 0), -1),
        (("entries", 1, "handles", 0), 1),
        (("entries", 1, "noise"), 0),
        (("handles", 0, "vertices", 0), -1),
        (("handles", 0, "vertices", 0), 1.5),
        (("handles", 0, "weight"), -1),
        (("handles", 0, "id"), 1.0),
        (("handles", 0, "kind"), ["soft"]),
        (("bases", 0, 0), 1e300),
        (("entries", 0, "label"), 3),
        (("model", "path"), None),
        (("view",), []),
    ],
)
def test_values_out_of_range_are_named(tmp_path, place, bad):
    work = session()
    work.do("Place", work.edit.with_handles([handle(1)]))
    path = tmp_path / "a.json"
    work.save(path)
    data = json.loads(path.read_text())
    parent = data
    for key in place[:-1]:
        parent = parent[key]
    parent[place[-1]] = bad
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as caught:
        Session.load(path)
    named = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)[1:]
    assert f"a.json: {named}: expected" in str(caught.value)


def test_what_is_no_session_at_all(tmp_path):
    for name, text in (("a.json", "{"), ("b.json", '{"handles": []}')):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=name):
            Session.load(tmp_path / name)
    with pytest.raises(InputError, match="does not exist"):
        Session.load(tmp_path / "c.json")


def test_gaps_turn_with_the_targets_and_do_not_move():
    apart = handle(1).at([(1.0, 0.0, 0.0)], [(0.0, 0.2, 0.0)])
    assert apart.moved(translation([5, 5, 5])).gaps[0] == pytest.approx((0.0, 0.2, 0.0))
    turned = apart.moved(lambda p: np.asarray(p) @ np.array(TURN).T)
    assert turned.gaps[0] == pytest.approx(np.array(TURN) @ [0.0, 0.2, 0.0])
    assert handle(1).at([(1.0, 0.0, 0.0)], [(0.0, 0.0, 0.0)]).gaps == ()


def test_moving_moves_all_points():
    region = Handle(3, (1, 2), ((0.1, 0, 0), (0, 1.0, 0)))
    moved = region.moved(translation([1, 1, 1]))
    np.testing.assert_allclose(moved.targets, np.array(region.targets) + 1)
    assert moved.centre == pytest.approx((1.05, 1.5, 1.0))


@pytest.mark.parametrize("size", [(788, 441), (712, 583), (209, 462), (1001, 220), (217, 900)])
def test_a_picture_of_any_size_has_a_thumbnail(editor, tmp_path, monkeypatch, size):
    """Its middle, though the borders that are cut off are no whole pixels."""
    width, height = size
    monkeypatch.setattr(editor.state.view, "grab", lambda: np.zeros((height, width, 3), np.uint8))
    save_thumbnail(editor, tmp_path / "small.png")
    with Image.open(tmp_path / "small.png") as small:
        assert small.size == SIZE
