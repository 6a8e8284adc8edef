"""The Qt window on a virtual display: docks, dialogs, and a real mouse."""

import importlib.util
import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import deformer
from deformer_app.viewer.actions import ACTIONS
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.pose_worker import replay
from deformer_app.viewer.session import ModelName, Session
from display import virtual_display
from paths import ROOT
from shapes import sequence, small_model
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture(scope="module")
def display():
    with virtual_display("xdotool") as name:
        yield name


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "tube"
    small_model().save(path)
    return path


@pytest.fixture(scope="module")
def app(display):
    before = {name: os.environ.get(name) for name in ("DISPLAY", "QT_QPA_PLATFORM")}
    os.environ.update(DISPLAY=display, QT_QPA_PLATFORM="xcb")
    from PySide6.QtWidgets import QApplication

    application = QApplication.instance() or QApplication([])
    yield application
    application.shutdown()  # before its display ends: X would end the whole process
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@pytest.fixture
def window(app, model_path, tmp_path):
    from deformer_app.viewer.qt.window import Window
    from deformer_app.viewer.settings import Settings

    settings = Settings(tmp_path / "settings")
    settings.note_tour()
    made = Window(settings)
    made.show()
    made.begin(str(model_path), None, None)
    wait_for(lambda: made.editor.activations is not None and made.editor.idle, app.processEvents)
    yield made
    made.close_unsaved()


def rest(app, window):
    wait_for(lambda: window.idle, app.processEvents)


def test_what_cannot_be_done_is_disabled_and_a_recording_changes_its_title(app, window):
    items = window.menus.items
    rest(app, window)
    assert not items["undo"].isEnabled() and not items["redo"].isEnabled()
    assert items["open-model"].isEnabled() and items["delete"].isEnabled()
    place(window, 100)
    rest(app, window)
    assert items["undo"].isEnabled()
    items["undo"].trigger()
    assert items["redo"].isEnabled() and not items["undo"].isEnabled()
    items["record"].trigger()
    assert items["record"].text() == "Stop recording" and window.recording


def place(window, *vertices):
    for vertex in vertices:
        window.editor.place(vertex, add=True)
    window.editor.commit("Place handle")


def test_every_action_has_a_menu_entry_and_no_key_is_given_twice(window):
    items = window.menus.items
    assert list(items) == [action.id for action in ACTIONS]
    keys = [item.shortcut().toString() for item in items.values()]
    keys = [key for key in keys if key]
    assert len(keys) == len(set(keys)) > 20
    assert all(item.text() for item in items.values())


def test_docks_show_what_is_selected_and_numbers_move_it(app, window):
    place(window, 100, 60)
    rest(app, window)
    panel = window.handle_panel
    assert panel.table.rowCount() == 2
    panel.table.selectRow(0)
    assert len(window.editor.selected) == 1
    rest(app, window)
    before = window.editor.edit.handle(next(iter(window.editor.selected))).centre
    panel.coordinates[1].setValue(before[1] + 0.3)
    rest(app, window)
    after = window.editor.edit.handle(next(iter(window.editor.selected))).centre
    assert after[1] == pytest.approx(before[1] + 0.3, abs=1e-4)
    assert after[0] == pytest.approx(before[0], abs=1e-4)
    assert "%" in panel.table.item(0, 3).text()


def test_a_slider_of_a_component_moves_the_mesh(app, window):
    rest(app, window)
    known = window.editor.activations
    k = int(known.order[0])
    slider = window.component_panel.sliders[k]
    assert list(window.component_panel.sliders) == known.order.tolist()
    before = window.editor.vertices.copy()
    slider.setValue(slider.maximum())
    rest(app, window)
    assert window.editor.code[k] == pytest.approx(known.high[k], abs=1e-6)
    assert np.abs(window.editor.vertices - before).max() > 0.01
    window.menus.items["undo"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.vertices, before, atol=1e-6)
    assert slider.value() < slider.maximum()


def test_the_dial_of_the_prior_decides_how_far_a_handle_is_followed(app, window):
    place(window, 115)
    x, y, z = window.editor.edit.handles[0].centre
    window.editor.set_centre([x + 0.2, y + 0.8, z + 0.6])
    off = []
    for position in (0, 1000):
        window.model_panel.prior.setValue(position)
        rest(app, window)
        off.append(float(window.editor.answer.pose.residual[0]))
    assert off[0] < 0.5 * off[1]


def test_a_mistake_is_a_line_in_the_window_and_nothing_is_lost(app, window, tmp_path):
    window.open_session(tmp_path / "missing.json")
    told = window.notices.mistake
    assert not told.isHidden() and "missing.json" in told.text
    assert window.editor.is_open
    window.escape()
    assert told.isHidden()
    place(window, 100)
    window.attempt(lambda: window.editor.load_target(tmp_path / "none.ply"))
    assert "none.ply" in told.text
    assert len(window.editor.edit.handles) == 1


def test_closing_asks_only_if_something_would_be_lost(app, window, monkeypatch, tmp_path):
    from PySide6.QtWidgets import QMessageBox

    asked = []

    def question(*arguments):
        asked.append(arguments[2])
        return answers.pop(0)

    monkeypatch.setattr(QMessageBox, "question", question)
    answers = []
    assert window.may_leave() and not asked
    place(window, 100)
    answers = [QMessageBox.StandardButton.Cancel]
    assert not window.may_leave() and len(asked) == 1
    file = tmp_path / "work.json"
    monkeypatch.setattr(window, "ask_save", lambda *_: file)
    answers = [QMessageBox.StandardButton.Save]
    assert window.may_leave() and file.is_file()
    assert window.may_leave() and len(asked) == 2
    assert window.settings.recent[0] == str(file)


def test_training_opens_its_model_and_can_be_cancelled(app, window, tmp_path):
    deformer.save_shapes(tmp_path / "shapes.npz", sequence())
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.components.setValue(3)
    dialog.epochs.setValue(100_000)
    dialog.start_button.click()
    wait_for(lambda: dialog.stage == "training", app.processEvents)
    dialog.cancel()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert "Cancelled" in dialog.status.text() and not (tmp_path / "shapes-model").exists()
    dialog.epochs.setValue(3)
    dialog.start_button.click()
    wait_for(
        lambda: dialog.ended and window.editor.is_open and not window.editor.preparing,
        app.processEvents,
    )
    assert window.editor.model.components == 3
    assert window.editor.session.model.path == str((tmp_path / "shapes-model").resolve())


def test_a_folder_of_shapes_is_offered_for_training(app, window, tmp_path, monkeypatch):
    from PySide6.QtWidgets import QMessageBox

    yes = QMessageBox.StandardButton.Yes
    monkeypatch.setattr(QMessageBox, "question", lambda *_: yes)
    folder = tmp_path / "walk"
    deformer.save_shapes(folder, sequence(3))
    window.open_model(folder)
    assert window.training.isVisible()
    assert window.training.shapes.text() == str(folder)
    assert window.training.output.text() == str(tmp_path / "walk-model")


def test_the_tour_goes_on_by_what_is_done(app, window):
    window.tour.begin()
    first = window.tour.text
    window.editor.place(100)
    window.editor.move_selected(translation([0.0, 0.1, 0.0]))
    wait_for(lambda: window.tour.text != first, app.processEvents)
    for _ in range(3):
        window.tour.go_on()
    assert window.tour.isHidden() and not window.tour.running


def test_training_on_nonsense_is_told_in_the_dialog(app, window, tmp_path):
    dialog = window.train()
    dialog.choose(tmp_path / "nothing.npz")
    dialog.start_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert "nothing.npz" in dialog.status.text()


# Where the shipped figure is in a new window, in pixels of the screen.
HAND, FEET = (797, 417), ((631, 686), (729, 697))


def test_qt_gives_back_what_it_takes(app):
    """PySide6 6.12.0 took a reference to None with every call, until Python 3.11 ended."""
    from PySide6.QtCore import QObject

    thing = QObject()
    before = sys.getrefcount(None)
    for _ in range(1000):
        thing.setObjectName("x")
    assert abs(sys.getrefcount(None) - before) < 100


def test_random_events_leave_a_consistent_session(app, model_path):
    path = ROOT / "benchmarks" / "viewer_soak.py"
    spec = importlib.util.spec_from_file_location("viewer_soak", path)
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    failures, _ = benchmark.soak(str(model_path), 400, 3, lambda line: None)
    assert not failures


class Person:
    """A program with a real mouse on it; what it did is read from its autosave."""

    def __init__(self, display, folder, *arguments):
        self.folder = folder
        self.environment = {**os.environ, "DISPLAY": display, "DEFORMER_SETTINGS": str(folder)}
        code = "from deformer_app.cli.main import main; main()"
        command = [sys.executable, "-c", code, "edit", *map(str, arguments)]
        self.program = subprocess.Popen(command, env=self.environment, stderr=subprocess.PIPE)
        self.window = None  # the number of the editor's window, once it is ready

    def xdotool(self, *words):
        command = ["xdotool", *map(str, words)]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True).stdout

    def windows(self, title):
        """Numbers of the visible windows whose title has a regular expression in it."""
        return self.xdotool("search", "--onlyvisible", "--name", title).split()

    def wait(self, condition):
        return wait_for(condition, self._alive, pause=0.05)

    def _wait_a_little(self, condition):
        """Wait for what another key may be needed for."""
        end = time.monotonic() + 5.0
        self.wait(lambda: condition() or time.monotonic() > end)

    def _alive(self):
        assert self.program.poll() is None, self.program.stderr.read().decode()

    def drag(self, start, *ways, button=1):
        self.xdotool("mousemove", *start, "mousedown", button)
        for at in ways:
            self.xdotool("mousemove", *at)
            time.sleep(0.03)
        self.xdotool("mouseup", button)

    def key(self, name):
        # There is no window manager, which would give the keys back after a dialog.
        self.xdotool("windowfocus", "--sync", self.window, "key", name)

    def be_ready(self):
        """Wait until the program is prepared for drags, as its title says."""
        self.window = self.wait(lambda: self.windows(" Deformer$"))[-1]

    def write(self, key, title, file):
        """Open a dialog by a key and type the name of a file that it writes.

        Again where keys were lost: a dialog that has the focus may not take keys yet.
        """

        def has_focus():
            return self.xdotool("getwindowfocus").split() == self.windows(title)

        while not file.is_file():
            if not self.windows(title):
                self.key(key)
            self._wait_a_little(has_focus)
            if has_focus():  # else its letters would be keys of the window
                self.xdotool("key", "ctrl+a")
                self.xdotool("type", str(file))
            if self.windows(title):  # or a question about a name of which letters were lost
                self.xdotool("key", "Return")
            self._wait_a_little(file.is_file)

    def steps(self):
        """Labels of the history up to the entry that is shown."""
        with suppress(StopIteration, FileNotFoundError):  # none yet, or gone meanwhile
            path = next(Path(self.folder).glob("autosave-*.json"))
            data = json.loads(path.read_text())
            return [entry["label"] for entry in data["entries"][: data["cursor"] + 1]]
        return []

    def end(self):
        self.program.kill()
        self.program.wait()


def test_a_person_pulls_undoes_and_finds_it_again_after_a_crash(display, model_path, tmp_path):
    (tmp_path / "settings.json").write_text('{"tour_seen": true}')
    person = Person(display, tmp_path, model_path)
    try:
        person.be_ready()
        person.drag((650, 470), (655, 440), (660, 400), (665, 380))
        person.wait(lambda: person.steps() == ["Start", "Place and drag"])
        person.drag((665, 380), (660, 400), (655, 420))
        person.wait(lambda: len(person.steps()) == 3)
        assert person.steps()[-1] in {"Place and drag", "Drag"}
        person.drag((330, 800), (380, 780), (420, 760))  # orbits: no step
        person.key("ctrl+z")
        person.wait(lambda: len(person.steps()) == 2)
        person.key("ctrl+shift+z")
        person.wait(lambda: len(person.steps()) == 3)
    finally:
        person.end()
    (left,) = tmp_path.glob("autosave-*.json")
    again = Person(display, tmp_path, model_path)

    def agreed():
        """True once the question of the dialog is answered; Return is yes."""
        for number in again.windows("^Deformer$"):
            if number != again.window:
                again.xdotool("key", "--window", number, "Return")
        return not left.exists()

    try:
        again.wait(agreed)
        again.wait(lambda: len(again.steps()) == 3)
    finally:
        again.end()


def test_a_person_poses_the_shipped_figure_and_finds_it_as_it_was_left(display, tmp_path):
    """From the first look to the next morning, by mouse and keys alone."""
    settings, file = tmp_path / "settings", tmp_path / "figure.json"
    settings.mkdir()
    (settings / "settings.json").write_text('{"tour_seen": true}')
    reference = deformer.load_model("humanoid").reference.vertices
    person = Person(display, settings)

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
        person.drag(HAND)
        person.wait(person.steps)
        for foot in FEET:
            count = len(person.steps())
            person.drag(foot)
            person.wait(lambda count=count: len(person.steps()) == count + 1)
            person.key("p")
            person.wait(lambda count=count: len(person.steps()) == count + 2)
        person.write("ctrl+shift+s", "Save session", file)
        found = {h.kind: reference[h.vertices[0]] for h in saved().edit.handles}
        assert len(saved().edit.handles) == 3
        assert found["pin"][2] < 0.15 < 0.6 < found["soft"][2], "feet are low, the hand is not"

        # An arm up: back to the side, forth again.
        before, steps = saved(), len(saved().entries)
        person.drag(HAND, *((HAND[0] + 2 * n, HAND[1] - 12 * n) for n in range(1, 11)))
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
        top = (HAND[0] + 20, HAND[1] - 120 - 83)
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

        # The first component's slider, dragged to the right.
        person.drag((1190, 473), (1210, 473), (1230, 473))
        person.wait(lambda: saved().entry.label.startswith("Component"))
        assert saved().edit.base != raised.edit.base
        person.wait(lambda: saved().entry.solution is not None)
        left = exported(person, "evening.ply")
        person.key("ctrl+q")  # nothing is lost, so nothing is asked
        wait_for(lambda: person.program.poll() is not None or person.windows("^Deformer$"))
        assert person.program.wait() == 0
    finally:
        person.end()
    model = deformer.load_model("humanoid")
    diagonal = model.reference.bounding_diagonal
    assert np.abs(replay(Session.load(file), model).vertices - left).max() < 1e-6 * diagonal
    person = Person(display, settings, "--session", file)
    try:
        person.be_ready()
        found = exported(person, "morning.ply")
        assert np.abs(found - left).max() < 1e-6 * diagonal
        assert np.abs(found - reference).max() > 0.2
        person.key("ctrl+z")
        person.wait(lambda: person.steps()[-1:] == [freed.entry.label])
    finally:
        person.end()


def test_the_plain_window_pulls_and_saves(display, model_path, tmp_path):
    """The same view and controller in a window of pyvista alone."""
    file = tmp_path / "plain.json"
    shapes = small_model()
    work = Session.begin(ModelName(str(model_path), shapes.fingerprint), shapes.codes[0])
    work.save(file)
    person = Person(display, tmp_path, "--plain", "--session", file)

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
