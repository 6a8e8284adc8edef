"""Programs at work, each in a process and on a display of its own: real or random events."""

import os
import subprocess
import sys

import numpy as np
import pytest

import deformer
from deformer_app.viewer.pose_worker import replay
from deformer_app.viewer.session import ModelName, Session
from display import virtual_display
from paths import ROOT
from person import Person
from shapes import small_model
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')

SOAK = """
import sys
from viewer_soak import soak
failures, _ = soak(sys.argv[1], 150, 3, lambda line: None)
for failure in failures:
    print(failure)
sys.stdout.flush()
import os
os._exit(len(failures) > 0)  # without waiting for the threads and windows of three libraries
"""


@pytest.fixture
def screen():
    """A display without other windows, which could take the mouse or the keys."""
    with virtual_display("xdotool") as name:
        yield name


def test_random_events_leave_a_consistent_session(screen, model_path, tmp_path):
    path = os.pathsep.join([str(ROOT / "benchmarks"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "DISPLAY": screen, "QT_QPA_PLATFORM": "xcb", "PYTHONPATH": path}
    environment["DEFORMER_SETTINGS"] = str(tmp_path)
    command = [sys.executable, "-c", SOAK, str(model_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_person_pulls_undoes_and_finds_it_again_after_a_crash(screen, model_path, tmp_path):
    (tmp_path / "settings.json").write_text('{"tour_seen": true}')
    person = Person(screen, tmp_path, model_path)
    try:
        person.be_ready()
        seen = np.array(person.sees("vertices"))
        middle = seen[np.linalg.norm(seen - seen.mean(axis=0), axis=1).argmin()]
        person.drag(*([middle[0] + n, middle[1] - 6 * n] for n in (0, 5, 10, 15)))
        person.wait(lambda: person.steps() == ["Start", "Place and drag"])
        person.drag(*([middle[0] + n, middle[1] - 6 * n] for n in (15, 10, 5)))
        person.wait(lambda: len(person.steps()) == 3)
        assert person.steps()[-1] in {"Place and drag", "Drag"}
        left, top, _, height = person.sees("picture")
        corner = [left + 20, top + height - 20]
        person.drag(corner, *([corner[0] + n, corner[1] - n] for n in (20, 50)))  # orbits: no step
        person.key("ctrl+z")
        person.wait(lambda: len(person.steps()) == 2)
        person.key("ctrl+shift+z")
        person.wait(lambda: len(person.steps()) == 3)
    finally:
        person.end()
    (left,) = tmp_path.glob("autosave-*.json")
    again = Person(screen, tmp_path, model_path)

    def agreed():
        """True once the question of the dialog is answered; Return is yes."""
        for number in again.windows("^Deformer$"):
            if number != again.window:
                again.xdotool("key", "--window", number, "Return")
        return not left.exists()

    try:
        again.wait(agreed)
        again.wait(lambda: len(again.steps()) == 3)
        again.wait(lambda: again.windows(r"\* – Deformer$"))  # no file of the user's has it
    finally:
        again.end()


def test_a_person_poses_the_shipped_figure_and_finds_it_as_it_was_left(screen, tmp_path):
    """From the first look to the next morning, by mouse and keys alone."""
    settings, file = tmp_path / "settings", tmp_path / "figure.json"
    settings.mkdir()
    (settings / "settings.json").write_text('{"tour_seen": true}')
    model = deformer.load_model("humanoid")
    reference, components = model.reference.vertices, set(model.component_names.values())
    low = np.flatnonzero(reference[:, 2] < 0.1)
    sides = [low[reference[low, 0] * side > 0] for side in (-1, 1)]
    toes = [int(side[reference[side, 1].argmin()]) for side in sides]  # it looks along −y
    fingertip = int(reference[:, 0].argmax())
    person = Person(screen, settings, "humanoid")

    def saved():
        """The session as it is now: keys come after all that was done before them."""
        file.unlink(missing_ok=True)
        person.key("ctrl+s")
        person.wait(file.is_file)
        return Session.load(file)

    def exported(person, name):
        path = tmp_path / name
        person.write("ctrl+e", "Export pose", path)
        return deformer.load_mesh(path).vertices

    try:
        # Three handles: a hand, and both feet pinned.
        person.be_ready()
        person.drag(person.sees("vertices")[fingertip])
        person.wait(person.steps)
        for toe in toes:
            count = len(person.steps())
            person.drag(person.sees("vertices")[toe])
            person.wait(lambda count=count: len(person.steps()) == count + 1)
            person.key("p")
            person.wait(lambda count=count: len(person.steps()) == count + 2)
        person.write("ctrl+shift+s", "Save session", file)
        found = {h.kind: reference[h.vertices[0]] for h in saved().edit.handles}
        assert len(saved().edit.handles) == 3
        assert found["pin"][2] < 0.15 < 0.6 < found["soft"][2], "feet are low, the hand is not"

        # An arm up: back to the side, forth again.
        before, steps = saved(), len(saved().entries)
        x, y = person.sees("vertices")[fingertip]
        person.drag((x, y), *((x + 2 * n, y - 12 * n) for n in range(1, 11)))
        person.wait(lambda: len(saved().entries) == steps + 1)
        raised = saved()
        soft = [next(h for h in s.edit.handles if h.kind == "soft") for s in (before, raised)]
        assert soft[1].targets[0][2] > soft[0].targets[0][2] + 0.2
        person.key("ctrl+z")
        person.wait(lambda: saved().edit == before.edit)
        person.key("ctrl+shift+z")
        person.wait(lambda: saved().edit == raised.edit)

        # The hand turned in its place, by the top of a ring: back, forth, and free again.
        hand = soft[1].id
        top = (x + 20, y - 120 - 83)
        person.key("2")
        person.drag(top, *((top[0] + 6 * n, top[1]) for n in range(1, 8)))
        person.wait(lambda: saved().entry.label == "Rotate")
        assert saved().edit.handle(hand).orientation is not None
        assert saved().edit.handle(hand).targets == soft[1].targets
        person.key("ctrl+z")
        person.wait(lambda: saved().edit == raised.edit)
        person.key("ctrl+shift+z")
        person.wait(lambda: saved().entry.label == "Rotate")
        person.key("t")
        person.wait(lambda: saved().entry.label == "Turn freely")
        freed = saved()
        assert freed.edit == raised.edit
        person.key("1")

        # The slider of the first row of components, dragged to the right.
        x, y = person.sees("slider")
        person.drag((x, y), (x + 20, y), (x + 40, y))
        person.wait(lambda: saved().entry.label in components)
        assert saved().edit.base != raised.edit.base
        # What is exported is the pose at rest, so the session must have that one, too.
        person.wait(lambda: (solved := saved().entry.solution) is not None and solved.final)
        left = exported(person, "evening.ply")
        person.key("ctrl+q")  # nothing is lost, so nothing is asked
        wait_for(lambda: person.program.poll() is not None or person.windows("^Deformer$"))
        assert person.program.wait() == 0
    finally:
        person.end()
    diagonal = model.reference.bounding_diagonal
    assert np.abs(replay(Session.load(file), model).vertices - left).max() < 1e-6 * diagonal
    person = Person(screen, settings, "--session", file)
    try:
        person.be_ready()
        found = exported(person, "morning.ply")
        assert np.abs(found - left).max() < 1e-6 * diagonal
        assert np.abs(found - reference).max() > 0.2
        person.key("ctrl+z")
        person.wait(lambda: person.steps()[-1:] == [freed.entry.label])
    finally:
        person.end()


def test_the_plain_window_pulls_and_saves(screen, model_path, tmp_path):
    """The same view and controller in a window of pyvista alone."""
    file = tmp_path / "plain.json"
    shapes = small_model()
    work = Session.begin(ModelName(str(model_path), shapes.fingerprint), shapes.codes[0])
    work.save(file)
    person = Person(screen, tmp_path, "--plain", "--session", file)
    try:
        person.be_ready()
        person.drag((550, 425), (555, 400), (560, 380), (565, 360))
        file.unlink()
        person.key("ctrl+s")
        person.wait(file.is_file)
        labels = [entry.label for entry in Session.load(file).entries]
        assert labels == ["Start", "Place and drag"]
    finally:
        person.end()
