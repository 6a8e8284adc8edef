"""What the viewer exports gives its pose again: in `deformer fit`, as a session, in the viewer."""

from dataclasses import replace

import numpy as np
import pytest

import deformer
from deformer import InputError, io
from deformer_app.cli import fit as fitting
from deformer_app.viewer import handle_changes
from deformer_app.viewer.changes import NoticeGiven
from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.exports import (
    export_handles,
    export_pose,
    export_script,
    handles_file,
    save_screenshot,
)
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.handle_rows import handles_of_rows
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.pose_commands import export_poses, save_pose
from deformer_app.viewer.pose_worker import PoseWorker, Request, replay
from deformer_app.viewer.session import ModelName, Session
from off_screen_editor import finish, texts
from shapes import small_model

WANDERING = np.cumsum(np.random.default_rng(3).normal(size=(25, 3)), axis=0) * 0.03


class Person:
    """Edits a session as the viewer's commands do, with every pose on the way to rest."""

    def __init__(self, model):
        self.model, self.worker = model, PoseWorker(model)
        name = ModelName("m", model.fingerprint)
        self.session = Session.begin(name, start_codes(model)["Reference"])
        self.pose = self.worker.final_pose(self.edit)

    @property
    def edit(self):
        return self.session.edit

    def on_surface(self, handle):
        at = list(handle.vertices)
        gaps = deformer.surface_gaps(self.model, self.pose, at)
        return handle.at(self.pose.vertices[at], gaps)

    def do(self, edit, solution=None):
        self.session.do("step", edit)
        *_, answer = self.worker(Request(self.edit, solution))
        self.session.solved(self.edit, answer.solution)
        self.pose = answer.pose

    def show(self, entry):
        *_, answer = self.worker(Request(entry.edit, entry.solution))
        self.pose = answer.pose

    def place(self, vertex, kind="soft"):
        number = self.session.next_id()
        handle = Handle(number, (vertex,), ((0.0, 0.0, 0.0),), kind)
        self.do(self.edit.with_handles([self.on_surface(handle)]))
        return number

    def paint(self, vertices):
        number = self.session.next_id()
        region = handle_changes.region_handle(number, vertices, self.model.reference)
        self.do(self.edit.with_handles([self.on_surface(region)]))
        return number

    def drag(self, number, path):
        """Drag a handle along a path (n, 3); of every pose but the last only the first is seen."""
        handle = self.edit.handle(number)
        steps = [self.edit.with_handles([handle.moved(translation(at))]) for at in path]
        for edit in steps[:-1]:
            next(iter(self.worker(Request(edit, moving=True))))
        self.do(steps[-1])

    def kind(self, number, kind):
        handles = [self.edit.handle(number)]
        changed = handle_changes.with_kind(handles, kind, self.pose.vertices)
        self.do(self.edit.with_handles(changed))


def soft(person):
    person.drag(person.place(100), [[0.1, 0.3, 0.2]])


def weights(person):
    for vertex, weight in ((60, 0.2), (110, 7.0)):
        person.drag(person.place(vertex), [[0.1, 0.3, 0.2]])
        last = person.edit.handles[-1]
        person.do(person.edit.with_handles([replace(last, weight=weight)]))


def exact_and_pin(person):
    person.drag(person.place(100), [[0.1, 0.3, 0.2]])
    person.kind(1, "exact")
    person.drag(person.place(40), [[0.0, -0.2, 0.1]])
    person.kind(2, "pin")
    person.drag(person.place(70), [[0.0, 0.1, 0.0]])


def regions(person):
    person.drag(person.paint(range(96, 120)), [[0.1, 0.3, 0.2]])
    # One of its vertices is also a handle on its own.
    person.drag(person.place(person.edit.handles[0].vertices[0]), [[0.0, 0.1, 0.0]])
    person.kind(1, "pin")


def orientations(person):
    number = person.place(100)
    handle = person.edit.handle(number)
    (R,) = deformer.local_rotations(person.model, handle.vertices, person.pose.vertices)
    turn = deformer.log_to_rotation(np.array([0.0, 0.4, 0.2]))
    turned = replace(handle.oriented(turn @ R), orientation_weight=2.0)
    person.do(person.edit.with_handles([turned]))


def sliders(person):
    base = np.array(person.edit.base) + np.linspace(-0.5, 0.5, person.model.components)
    person.do(replace(person.edit, base=tuple(base.tolist())))
    soft(person)


def start_from(person):
    code = start_codes(person.model)["Shape 5"]
    person.do(Edit(tuple(np.asarray(code).tolist())))
    soft(person)


def strength(person):
    soft(person)
    person.do(replace(person.edit, noise=0.05))


def body_moves(person):
    person.do(replace(person.edit, body="moves"))
    soft(person)


def body_stays(person):
    soft(person)
    person.do(replace(person.edit, body="stays"))


def undo_and_redo(person):
    exact_and_pin(person)
    for _ in range(4):
        person.show(person.session.undo())
    person.show(person.session.redo())


def wandering(person):
    person.place(8)
    person.kind(1, "pin")
    person.drag(person.place(115), WANDERING)


def on_a_floor(person):
    """A part is pulled under the floor, step by step: the contacts have a history."""
    height = float(person.pose.vertices[:, 1].min()) - 0.02
    person.do(replace(person.edit, floor=height, body="stays"))
    person.place(4)
    step = 0.04 * person.model.reference.bounding_diagonal * np.array([0.2, -1.0, 0.0])
    person.drag(person.place(115), np.outer(np.arange(1, 9), step))
    assert person.session.entry.solution.contacts


@pytest.mark.parametrize(
    "story",
    [
        soft,
        weights,
        exact_and_pin,
        regions,
        orientations,
        sliders,
        start_from,
        strength,
        body_moves,
        body_stays,
        undo_and_redo,
        wandering,
        on_a_floor,
    ],
)
def test_fit_makes_the_same_pose(tmp_path, story):
    model = small_model()
    person = Person(model)
    story(person)
    V, near = len(model.reference.vertices), 1e-6 * model.reference.bounding_diagonal
    assert np.abs(person.pose.vertices - model.reference.vertices).max() > 1000 * near
    io.write_json(tmp_path / "h.json", handles_file(person.session))
    file = io.load_handles(tmp_path / "h.json", V, model.reference.faces, model.components)
    vertices, record = fitting.pose(model, file, False, fitting.chosen_noise(None, file))
    assert np.abs(vertices - person.pose.vertices).max() < near
    np.testing.assert_allclose(record["z"], person.pose.z, atol=1e-9)
    person.session.save(tmp_path / "s.json")
    again = replay(Session.load(tmp_path / "s.json"), model)
    assert np.abs(again.vertices - person.pose.vertices).max() < near
    # What `deformer edit` prints is a handles file, too.
    io.write_json(tmp_path / "edited.json", person.session.summary())
    assert io.load_handles(tmp_path / "edited.json", V, components=model.components) == file
    # And all of it can be loaded into the viewer.
    handles = handles_of_rows("h.json", file, 1)
    assert [replace(h, id=0) for h in handles] == [replace(h, id=0) for h in person.edit.handles]


def test_a_start_is_where_the_solver_begins(tmp_path):
    """With a moved handle the pose is another one, and at least as good as a cold solve's."""
    model = small_model()
    person = Person(model)
    wandering(person)
    data = handles_file(person.session)
    data["handles"][1]["position"] = (np.array(data["handles"][1]["position"]) + 0.1).tolist()
    io.write_json(tmp_path / "h.json", data)
    V = len(model.reference.vertices)
    file = io.load_handles(tmp_path / "h.json", V, None, model.components)
    vertices, _ = fitting.pose(model, file, False, None)
    assert np.abs(vertices - person.pose.vertices).max() > 0.02
    rows, prior = file.frames[0], file.prior
    solver = deformer.HandleSolver(model, noise=prior.noise, freedom=prior.body)
    solver.set_prior(mean=prior.mean)
    solver.set_handles(
        [row.vertex for row in rows],
        [row.position for row in rows],
        kinds=[row.kind for row in rows],
        gaps=[row.gap for row in rows],
    )
    cold = solver.solve()
    solver.restore(file.start.z, file.start.rotation, file.start.translation)
    assert deformer.solve_to_rest(solver).energy <= cold.energy * 1.01 + 1e-9


@pytest.mark.parametrize(
    ("row", "part"),
    [
        ({"weight": 2.0}, r"h\.json: handles\[1\]: its weight is 2.0, expected 1.0"),
        ({"kind": "pin"}, r"handles\[1\]: its kind is 'pin', expected 'soft'"),
        ({"offset": 0.1}, r"handles\[1\]: has an offset"),
    ],
)
def test_a_region_is_one_handle(tmp_path, row, part):
    rows = [{"vertex": v, "position": [0, 0, 0], "region": 0} for v in (1, 2)]
    rows[1] |= row
    io.write_json(tmp_path / "h.json", {"handles": rows, "regions": [[1, 2, 3]]})
    with pytest.raises(InputError, match=part):
        handles_of_rows("h.json", io.load_handles(tmp_path / "h.json", 5), 1)


@pytest.mark.parametrize(
    "export, name",
    [
        (export_pose, "pose.ply"),
        (export_handles, "handles.json"),
        (export_script, "pose.py"),
        (export_poses, "poses.json"),
        (save_screenshot, "picture.png"),
    ],
)
def test_an_export_says_what_it_has_written(editor, heard, tmp_path, export, name):
    editor.handles.place(100)
    editor.commit("Place")
    finish(editor)
    save_pose(editor)
    file = tmp_path / name
    export(editor, file)
    assert file.is_file()
    assert texts(heard, NoticeGiven)[-1] == f"Wrote {file}"
