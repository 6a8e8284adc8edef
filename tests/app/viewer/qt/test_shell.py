"""The start page, the theme, notices, drops, and what closing asks."""

import errno
import gc
import json
import shutil

import pytest
from PIL import Image

import deformer
from deformer_app.viewer.actions import ACTIONS
from deformer_app.viewer.pose_commands import export_poses, save_pose
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from off_screen_editor import seen
from person import place, rest
from shapes import sequence
from waiting import wait_for
from windows import new_window

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def bare(app, tmp_path):
    """A window on its start page."""
    settings = Settings(tmp_path / "settings")
    settings.note_tour()
    settings.note_dark(False)
    with new_window(app, settings) as made:
        made.begin(None, None, None)
        app.processEvents()
        yield made


def ready(app, window):
    wait_for(
        lambda: window.editor.activations is not None and window.editor.idle, app.processEvents
    )


def texts(widget):
    """Texts of the labels in a widget."""
    from PySide6.QtWidgets import QLabel

    return [label.text() for label in widget.findChildren(QLabel)]


def drop(app, window, *paths):
    """A drag that enters the window and is dropped in it, as Qt delivers one."""
    from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
    from PySide6.QtGui import QDragEnterEvent, QDropEvent

    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    rest = Qt.DropAction.CopyAction, data, Qt.MouseButton.LeftButton, Qt.KeyboardModifier(0)
    entered = QDragEnterEvent(QPoint(50, 50), *rest)
    app.sendEvent(window, entered)
    assert entered.isAccepted()
    app.sendEvent(window, QDropEvent(QPointF(50, 50), *rest))


def test_the_start_page_opens_models_and_close_returns_to_it(app, bare, model_path):
    from PySide6.QtWidgets import QDockWidget

    from deformer_app.viewer.qt.docks import DOCKS

    docks = bare.findChildren(QDockWidget)
    assert bare.pages.currentWidget() is bare.start_page
    assert not any(dock.isVisible() for dock in docks)
    assert [card.text() for card in bare.start_page.models] == deformer.shipped_models()
    assert not bare.menus.items["save"].isEnabled() and bare.menus.items["train"].isEnabled()
    bare.open_model(model_path)
    ready(app, bare)
    assert bare.pages.currentWidget() is not bare.start_page
    visible = {dock.windowTitle() for dock in docks if dock.isVisible()}
    assert visible == {entry.title for entry in DOCKS if entry.shown}
    bare.menus.items["close-model"].trigger()
    assert bare.pages.currentWidget() is bare.start_page and not bare.editor.is_open
    (card,) = bare.start_page.recent
    assert card.text().startswith(model_path.name)
    card.click()
    ready(app, bare)
    assert bare.editor.session.model.path == str(model_path)


def test_a_window_that_its_frame_brings_beyond_the_screen_is_moved_and_shrunk(app, bare):
    free = bare.screen().availableGeometry()
    bare.hide()
    bare.setGeometry(free.x() + 40, free.y() + 30, free.width(), free.height())
    bare.show()
    wait_for(lambda: free.contains(bare.frameGeometry()), app.processEvents)
    assert bare.width() > 0.9 * free.width()


def test_the_start_page_comes_back_as_often_as_a_model_is_closed(app, bare, model_path, capfd):
    for _ in range(3):
        bare.open_model(model_path)
        ready(app, bare)
        bare.menus.items["close-model"].trigger()
        rest_of_start_page(app, bare)
        assert bare.pages.currentWidget() is bare.start_page
        assert len(bare.start_page.recent) == 1
        assert bare.start_page.recent[0].isVisible()
    assert "Traceback" not in capfd.readouterr().err


def rest_of_start_page(app, window):
    """Draw what the docks still show, and delete what was replaced."""
    from PySide6.QtCore import QEvent

    app.processEvents()
    app.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    for dock in window.docks.toggles:
        assert not dock.isChecked()
    window.grab()
    app.processEvents()


def test_a_session_whose_model_has_moved_asks_where_it_is(
    app, bare, model_path, tmp_path, monkeypatch
):
    bare.open_model(model_path)
    ready(app, bare)
    bare.editor.save_session(tmp_path / "pose.json")
    there = tmp_path / "elsewhere"
    shutil.copytree(model_path, there)
    data = json.loads((tmp_path / "pose.json").read_text())
    data["model"]["path"] = str(tmp_path / "gone")
    (tmp_path / "pose.json").write_text(json.dumps(data))
    asked = []
    monkeypatch.setattr(bare, "ask_folder", lambda title: asked.append(title) or there)
    bare.open_session(tmp_path / "pose.json")
    ready(app, bare)
    assert len(asked) == 1 and "pose.json" in asked[0] and "gone" in asked[0]
    assert bare.editor.session.model.path == str(there)
    bare.save(False)
    bare.open_session(tmp_path / "pose.json")
    assert len(asked) == 1


@pytest.fixture
def own_font(app):
    """The font that the program has, instead of Qt's own."""
    from deformer_app.viewer.qt.start import program_font

    before = app.font()
    app.setFont(program_font())
    yield
    app.setFont(before)


def test_the_help_names_every_key_and_fits_the_screen(app, own_font, bare):
    from PySide6.QtWidgets import QLabel, QScrollArea

    bare.help()
    dialog = next(w for w in app.topLevelWidgets() if w.windowTitle() == "Keys and mouse")
    text = " ".join(label.text() for label in dialog.findChildren(QLabel))
    keys = {a.id: " or ".join(a.keys) for a in ACTIONS if a.keys}
    assert [name for name, key in keys.items() if f"<b>{key}</b>" not in text] == []
    assert dialog.width() <= dialog.screen().availableSize().width()
    assert dialog.height() <= dialog.screen().availableSize().height()
    app.processEvents()
    area = dialog.findChild(QScrollArea)
    assert area.widget().width() <= area.viewport().width(), "nothing is cut off sideways"


@pytest.mark.parametrize("key", ["Escape", "F1"])
def test_keys_close_the_help(app, bare, model_path, key):
    """Though they are those of actions, too, where a model is open."""
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    bare.open_model(model_path)
    ready(app, bare)
    bare.help()
    dialog = next(w for w in app.topLevelWidgets() if w.windowTitle() == "Keys and mouse")
    dialog.activateWindow()
    wait_for(dialog.isActiveWindow, app.processEvents)
    QTest.keyClick(dialog, getattr(Qt.Key, f"Key_{key}"))
    wait_for(lambda: not dialog.isVisible(), app.processEvents)


@pytest.mark.parametrize("key", ["Return", "Escape"])
def test_a_field_gives_the_keys_back_to_the_picture(app, bare, model_path, key):
    """What is typed after Enter or Esc are keys of actions, not digits of a field."""
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    from deformer_app.viewer.qt.handle_panel import HandlePanel

    bare.open_model(model_path)
    ready(app, bare)
    bare.activateWindow()
    place(bare, 100)
    ready(app, bare)
    field = bare.docks.panel(HandlePanel).coordinates[2]
    before = field.value()
    field.setFocus()
    wait_for(field.hasFocus, app.processEvents)
    QTest.keyClick(field, getattr(Qt.Key, f"Key_{key}"))
    wait_for(lambda: not field.hasFocus(), app.processEvents)
    QTest.keyClick(app.focusWidget(), Qt.Key.Key_2)
    assert field.value() == before
    assert bare.editor.state.manipulator.mode == "rotate"


def test_the_space_bar_acts_on_the_picture_after_clicks_on_buttons(app, bare, model_path):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QPushButton

    from deformer_app.viewer.qt.handle_panel import HandlePanel

    def click(button):
        QTest.mouseClick(button, Qt.MouseButton.LeftButton)
        wait_for(bare.plotter.hasFocus, app.processEvents)

    def press_space():
        QTest.keyClick(app.focusWidget(), Qt.Key.Key_Space)

    bare.activateWindow()
    click(next(card for card in bare.start_page.models if card.text() == "humanoid"))
    ready(app, bare)
    editor = bare.editor
    buttons = bare.docks.panel(HandlePanel).findChildren(QPushButton)
    click(next(button for button in buttons if button.text() == "Suggest"))
    ready(app, bare)
    press_space()
    assert editor.timeline.playing and not editor.edit.handles, "it does not suggest again"
    press_space()
    assert not editor.timeline.playing
    bare.begin_tour()
    following, end, _ = bare.tour.findChildren(QPushButton)
    click(following)
    click(end)
    assert not bare.tour.running
    press_space()
    assert editor.timeline.playing
    press_space()


def test_a_tile_says_at_once_that_its_model_is_being_opened(app, bare, monkeypatch):
    from PySide6.QtCore import QEvent, QObject, Qt
    from PySide6.QtTest import QTest

    painted, seen, mark = [], [], bare.busy_mark

    class Paints(QObject):
        def eventFilter(self, _, event):
            if event.type() == QEvent.Type.Paint:
                painted.append(mark.text())
            return False

    paints = Paints()
    mark.installEventFilter(paints)

    def opened(model, session=None, loaded=None):
        # No events are handled here: what has not been painted would not be seen.
        seen.append((mark.isVisible(), painted[-1:], app.overrideCursor() is not None))
        raise deformer.InputError("stop here")

    monkeypatch.setattr(bare.editor, "open_model", opened)
    card = next(card for card in bare.start_page.models if card.text() == "humanoid")
    QTest.mouseClick(card, Qt.MouseButton.LeftButton)
    assert seen == [(True, ["Opening humanoid …"], True)]
    assert not mark.isVisible() and app.overrideCursor() is None


def test_the_tour_begins_with_the_first_model(app, tmp_path, model_path):
    with new_window(app, Settings(tmp_path / "settings")) as made:
        made.begin(None, None, None)
        assert not made.tour.running
        made.open_model(model_path)
        assert made.tour.running and made.settings.tour_seen


def test_the_tour_waits_for_the_solver(app, window, monkeypatch):
    editor = type(window.editor)
    with monkeypatch.context() as patch:
        patch.setattr(editor, "preparing", property(lambda _: True))
        window.tour.begin()
        assert window.tour.running and "Press" not in window.tour.text
        assert "when the solver is ready" in window.tour.text
    wait_for(lambda: window.tour.text.startswith("<b>1 of"), app.processEvents)
    window.tour.end()
    assert not window.tour.running


def test_recent_sessions_have_a_picture_model_and_time(app, window, tmp_path, monkeypatch):
    from PySide6.QtGui import QPixmap

    file = tmp_path / "work.json"
    place(window, 100)
    rest(app, window)
    monkeypatch.setattr(window, "ask_save", lambda *_: file)
    assert window.save(False)
    picture = QPixmap(str(window.settings.thumbnail(str(file))))
    assert not picture.isNull() and picture.toImage().allGray() is False
    window.close_model()
    first = window.start_page.recent[0]
    assert first.text() == "work.json\ntube, just now"


def test_what_is_dropped_opens(app, bare, model_path, tmp_path):
    drop(app, bare, model_path)
    ready(app, bare)
    assert bare.editor.session.model.path == str(model_path)
    handles = tmp_path / "handles.json"
    handles.write_text(json.dumps({"handles": [{"vertex": 17, "position": [0.0, 0.5, 0.0]}]}))
    drop(app, bare, handles)
    assert [handle.vertices for handle in bare.editor.edit.handles] == [(17,)]
    save_pose(bare.editor, "up")
    export_poses(bare.editor, tmp_path / "poses.json")
    drop(app, bare, tmp_path / "poses.json")
    Image.new("RGB", (8, 6)).save(tmp_path / "view.png")
    drop(app, bare, tmp_path / "view.png")
    assert bare.editor.state.reference_picture.footage.path == str(tmp_path / "view.png")
    assert [pose.name for pose in bare.editor.session.shelf.poses] == ["up", "up 2"]
    file = tmp_path / "work.json"
    bare.editor.save_session(file)
    bare.editor.prior.reset()
    bare.editor.session.save(tmp_path / "other.json")
    drop(app, bare, file)
    assert len(bare.editor.edit.handles) == 1
    shapes = tmp_path / "walk"
    deformer.save_shapes(shapes, sequence(3))
    drop(app, bare, shapes)
    assert bare.training.isVisible() and bare.training.shapes.text() == str(shapes)


@pytest.mark.parametrize("dropped", [True, False])
def test_a_reference_picture_opens_its_dock(app, window, tmp_path, monkeypatch, dropped):
    from PySide6.QtWidgets import QDockWidget

    def load(name):
        path = tmp_path / name
        Image.new("RGB", (8, 6)).save(path)
        if dropped:
            drop(app, window, path)
        else:
            monkeypatch.setattr(window, "ask_open", lambda *_: path)
            window.act("reference-picture")

    dock = window.findChild(QDockWidget, "Reference")
    assert not dock.isVisible() and not window.editor.session.changed
    load("front.png")
    wait_for(dock.isVisible, app.processEvents)
    assert window.editor.session.changed, "the session has the picture's path, too"
    dock.close()
    window.editor.prior.reset()
    window.editor.save_session(tmp_path / "work.json")
    drop(app, window, tmp_path / "work.json")
    rest(app, window)
    assert not dock.isVisible(), "nothing was loaded by the user, and the dock was closed"
    load("side.png")
    wait_for(dock.isVisible, app.processEvents)


def test_what_cannot_be_dropped_is_told(app, bare, tmp_path):
    files = tmp_path / "walk"
    deformer.save_shapes(files, sequence(3))
    one, two, _ = sorted(files.glob("*.ply"))
    drop(app, bare, one)
    told = bare.notices.mistake.text
    assert "mesh can be used with a model only; open the model first; to train one, drop" in told
    (offer,) = (text for text in texts(bare.start_page) if "drop here" in text)
    assert not any(word in offer for word in ("mesh", "handles", "poses", "picture"))
    Image.new("RGB", (8, 6)).save(tmp_path / "view.png")
    drop(app, bare, tmp_path / "view.png")
    assert (
        "picture can be used with a model only; open the model first" in bare.notices.mistake.text
    )
    drop(app, bare, one, two)
    assert "drop one file" in bare.notices.mistake.text


def test_a_closed_window_keeps_no_surface_that_qt_deletes(app, tmp_path):
    """PySide takes the next object at its address for it: a button was found to be a surface."""
    from PySide6.QtGui import QSurface

    def surfaces():
        return [one for one in gc.get_objects() if type(one) is QSurface]

    before = len(surfaces())
    with new_window(app, Settings(tmp_path / "settings")) as made:
        made.plotter.render()
        wait_for(lambda: len(surfaces()) > before, app.processEvents)
        gc.disable()
    try:
        assert len(surfaces()) == before
    finally:
        gc.enable()


def test_the_theme_stays_between_starts_and_sessions_do_not_change_it(app, bare, model_path):
    from deformer_app.rendering.palette import DARK, LIGHT

    def shown():
        return app.palette().window().color().name()

    assert shown() == LIGHT.widget("Window")
    bare.menus.items["dark"].trigger()
    assert shown() == DARK.widget("Window") and bare.editor.state.view.theme is DARK
    bare.open_model(model_path)
    assert bare.editor.state.look.dark
    session = Session.begin(bare.editor.session.model, bare.editor.edit.base)
    session.view = {"look": {"dark": False}}
    bare.files.open(str(model_path), session, None)
    assert bare.editor.state.look.dark and shown() == DARK.widget("Window")
    with new_window(app, Settings(bare.settings.folder)) as again:
        assert again.theme.is_dark
        again.choose_theme(False)
        assert shown() == LIGHT.widget("Window")


def test_notes_go_before_mistakes_which_are_closed_one_by_one(app, window, monkeypatch):
    from deformer_app.viewer.qt import notices

    assert notices.reading_time("x" * 100) > notices.reading_time("x")
    told = window.notices
    told.show_mistake("first")
    told.show_mistake("second")
    monkeypatch.setattr(notices, "_TO_FIND", 1)
    monkeypatch.setattr(notices, "_TO_READ", 0)
    window.editor.note("done")
    assert told.note.text == "done"
    wait_for(told.note.isHidden, app.processEvents)
    assert told.mistake.text == "second" and told.mistake.isVisible()
    told.keep_clear(True, None)
    assert not told.isVisible()
    told.keep_clear(False, None)
    assert told.isVisible()
    window.escape()
    assert told.mistake.text == "first"
    window.escape()
    assert told.mistake.isHidden()


def test_files_whose_names_look_like_html_are_told_as_they_are(app, window):
    from PySide6.QtWidgets import QLabel

    told = window.notices
    for strip, show in ((told.note, told.show_note), (told.mistake, told.show_mistake)):
        label = strip.findChild(QLabel)
        label.setWordWrap(False)  # its width is then that of its text
        show("Wrote pose.ply")
        short = label.sizeHint().width()
        show("Wrote <i>pose.ply</i>")
        assert label.sizeHint().width() > short + 10


def test_mistakes_go_by_themselves_all_of_them(app, window, monkeypatch):
    from deformer_app.viewer.qt import notices

    monkeypatch.setattr(notices, "_TO_FIND", 1)
    monkeypatch.setattr(notices, "_TO_READ", 0)
    told = window.notices
    told.show_mistake("first")
    told.show_mistake("second")
    assert told.mistake.text == "second"
    wait_for(told.mistake.isHidden, app.processEvents)
    assert told.mistake.text == "first", "each had its time"


def test_what_was_told_goes_with_the_next_success_but_not_with_a_mistake(app, window, tmp_path):
    told = window.notices
    told.show_mistake("old")
    told.show_note("also old")
    window.open_session(tmp_path / "none.json")
    assert "none.json" in told.mistake.text and not told.note.isHidden()
    window.act("frame")
    assert told.mistake.isHidden() and told.note.isHidden()
    window.attempt(lambda: window.open_session(tmp_path / "none.json"))
    assert not told.mistake.isHidden(), "the function that was called inside has failed"
    window.act("live-mirror")
    wait_for(lambda: "Both sides" in told.note.text, app.processEvents)
    assert told.mistake.isHidden() and not told.note.isHidden(), "a note of the success stays"


def test_notices_lie_at_the_top_where_the_user_does_not_work(app, window):
    told, (width, height) = window.notices, window.plotter.size().toTuple()
    told.show_mistake("something")
    for x, y in ((0.5, 0.9), (0.2, 0.1), (0.5, 0.1), (0.8, 0.1)):
        told.keep_clear(False, (x * width, y * height))
        place = told.geometry()
        assert place.bottom() < height / 3
        assert y > 0.5 or not place.left() <= x * width <= place.right()
        assert place.left() >= 0 and place.right() < width - notices_cube()


def notices_cube():
    from deformer_app.viewer.view_cube import LEFT

    return LEFT


def test_notices_and_the_tour_are_readable_in_a_small_window(app, window):
    """Lines of four words or more, and nothing cut; at 800 × 560 the picture is 250 wide."""
    from PySide6.QtWidgets import QLabel, QPushButton

    window.resize(800, 560)
    rest(app, window)
    told, letter = window.notices, window.fontMetrics().averageCharWidth()
    told.show_mistake(
        "handles.json: handle 3 has vertex 9999, expected 0 to 3399; take one of them"
    )
    window.tour.begin()
    wait_for(lambda: window.tour.text.startswith("<b>1 of"), app.processEvents)
    app.processEvents()
    for strip in (told.mistake, window.tour):
        label = strip.findChild(QLabel)
        assert label.width() > 24 * letter
        assert label.height() >= label.heightForWidth(label.width())
        for button in strip.findChildren(QPushButton):
            assert button.width() >= button.minimumSizeHint().width()
    window.resize(1280, 720)
    wait_for(lambda: window.tour.height() < 60, app.processEvents)  # one line


def test_mistakes_are_seen_on_the_start_page(app, bare, tmp_path, model_path):
    damaged = tmp_path / "damaged.json"
    damaged.write_text("{")
    told = bare.notices
    for tell in (
        lambda: bare.open_session(damaged),
        lambda: bare.open_model(damaged),
        lambda: drop(app, bare, damaged),
    ):
        tell()
        app.processEvents()
        assert told.mistake.isVisible() and "damaged.json" in told.mistake.text
        at = told.mistake.mapTo(bare, told.mistake.rect().center())
        assert told.isAncestorOf(bare.childAt(at)), "nothing lies upon it"
        told.hide_mistake()
    bare.open_model(model_path)
    ready(app, bare)
    told.show_mistake("here as well")
    app.processEvents()
    assert told.mistake.isVisible() and told.geometry().bottom() < bare.plotter.height() / 2
    bare.close_model()
    app.processEvents()
    at = told.mistake.mapTo(bare, told.mistake.rect().center())
    assert told.mistake.isVisible() and told.isAncestorOf(bare.childAt(at))


def test_the_window_fits_a_small_screen(app, window):
    hint = window.minimumSizeHint()
    assert hint.width() <= 1024 and hint.height() <= 640


def test_every_action_with_an_icon_has_its_drawing_and_tips_name_keys(window):
    from deformer_app.viewer.qt import icons

    assert set(icons.OF_ACTIONS) <= {action.id for action in ACTIONS}
    for name in icons.OF_ACTIONS.values():
        assert (icons._FOLDER / f"{name}.svg").is_file(), name
    for action in ACTIONS:
        item = window.menus.items[action.id]
        assert not action.key or action.key in item.toolTip()
        assert item.icon().isNull() == (action.id not in icons.OF_ACTIONS)


def test_tab_reaches_tool_bar_and_panels(window):
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QToolBar

    from deformer_app.viewer.qt.handle_panel import HandlePanel
    from deformer_app.viewer.qt.model_panel import ModelPanel

    bar = window.findChild(QToolBar)
    first = bar.widgetForAction(window.menus.items["gizmo-move"])
    reached, widget = [first], first.nextInFocusChain()
    while widget is not first:
        if widget.focusPolicy() & Qt.FocusPolicy.TabFocus and widget.isVisible():
            reached.append(widget)
        widget = widget.nextInFocusChain()
    panel = window.docks.panel(HandlePanel)
    assert {window.docks.panel(ModelPanel).prior, panel.table, *panel.coordinates} <= set(reached)
    assert not panel.table.tabKeyNavigation(), "Tab leaves the table"
    assert bar.widgetForAction(window.menus.items["frame"]) in reached


def test_a_picture_with_another_ending_is_told(app, window, tmp_path):
    from deformer_app.viewer.exports import save_screenshot

    file = tmp_path / "deformer.pgn"
    window.attempt(lambda: save_screenshot(window.editor, file))
    assert ".pgn" in window.notices.mistake.text and ".png" in window.notices.mistake.text
    assert not file.exists()


def test_enter_starts_the_training_and_closing_asks_about_it(app, window, tmp_path, answers):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    deformer.save_shapes(tmp_path / "shapes.npz", sequence())
    dialog = window.train()
    dialog.shapes.setText(str(tmp_path / "shapes.npz"))
    dialog.shapes.setFocus()
    dialog.components.setValue(3)
    dialog.epochs.setValue(100_000)
    QTest.keyClick(dialog.shapes, Qt.Key.Key_Return)
    assert dialog.output.text() == str(tmp_path / "shapes-model")
    wait_for(lambda: dialog.stage == "training", app.processEvents)
    answers.append("Go on training")
    window.close()
    assert window.isVisible() and dialog.training and "being trained" in answers.asked[0].text()
    answers.append("Stop, keep for resuming")
    assert dialog.may_stop()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert deformer.has_checkpoint(tmp_path / "shapes-model.checkpoint")
    assert not (tmp_path / "shapes-model").exists()
    answers.append("Resume")
    dialog.start_button.click()
    assert dialog.focusWidget() is dialog.hide_button
    QTest.keyClick(dialog.hide_button, Qt.Key.Key_Return)
    assert not dialog.isVisible() and dialog.training, "Return presses the button with the focus"
    wait_for(lambda: dialog.stage == "training", app.processEvents)
    dialog.cancel()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert not deformer.has_checkpoint(tmp_path / "shapes-model.checkpoint")


def test_the_offer_after_a_crash_names_model_and_shows_the_picture(app, window, answers):
    place(window, 100)
    rest(app, window)
    left = window.files.autosave.write()
    answers.append("Later")  # what Esc says
    assert not window.files.restore(left) and left.exists()
    answers.append("Discard")
    assert not window.files.restore(left)
    box = answers.asked[-1]
    text, width = box.informativeText(), box.iconPixmap().width()
    assert "tube, 1 step" in text and "just now" in text and width > 100
    assert not left.exists() and not left.with_suffix(".png").exists()


def test_a_restored_session_goes_on_to_the_file_that_it_was_saved_in(
    app, window, model_path, tmp_path, monkeypatch, answers
):
    file = tmp_path / "work.json"
    monkeypatch.setattr(window, "ask_save", lambda *_: file)
    place(window, 100)
    assert window.save(False)
    place(window, 60)
    left = window.settings.folder / "autosave-9.json"
    shutil.move(window.files.autosave.write(), left)
    answers.append("Open")
    monkeypatch.setattr(window, "ask_save", None)  # it is not asked for
    assert window.files.restore(left) and not left.exists()
    assert "Session work.json" in answers.asked[0].informativeText()
    rest(app, window)
    assert window.windowTitle().startswith("work.json") and window.isWindowModified()
    assert window.settings.autosave.exists(), "what was restored is not lost by another crash"
    window.menus.items["save"].trigger()
    rest(app, window)
    assert len(Session.load(file).edit.handles) == 2 and not window.isWindowModified()
    assert Session.load(file).saved_as == ""


def test_what_the_system_refuses_is_told_with_a_remedy(window):
    def refuse():
        raise PermissionError(errno.EACCES, "Permission denied", "work.json")

    assert not window.attempt(refuse)
    assert window.notices.mistake.text.startswith("work.json: Permission denied; change its")


def test_an_autosave_that_cannot_be_opened_is_kept(app, window, answers):
    left = window.settings.folder / "autosave-9.json"
    left.write_text("{")
    answers.append("Open")
    assert not window.files.restore(left)
    assert left.exists() and "autosave-9.json" in window.notices.mistake.text


def test_changes_are_saved_however_fast_they_follow_each_other(app, window):
    """A crash loses neither the first handle nor what is changed without a pause."""
    from deformer_app.viewer.gizmo import translation

    place(window, 100)
    rest(app, window)
    autosave, editor = window.settings.autosave, window.editor

    def step():
        editor.handles.move_selected(translation([0.0, 1e-4, 0.0]))
        editor.commit("Move")
        app.processEvents()

    wait_for(autosave.exists, step)
    first = len(Session.load(autosave).entries)
    wait_for(lambda: len(Session.load(autosave).entries) > first, step)


def test_a_crash_offers_nothing_once_the_session_is_as_saved(
    app, window, tmp_path, monkeypatch, hand
):
    autosave, editor = window.settings.autosave, window.editor
    for vertex in (100, 60, 20):
        place(window, vertex)
    rest(app, window)
    monkeypatch.setattr(window, "ask_save", lambda *_: tmp_path / "work.json")
    assert window.save(False) and not autosave.exists()
    for _ in range(3):
        hand("key", "ctrl+z")
    wait_for(autosave.exists, app.processEvents)
    assert window.isWindowModified()
    for _ in range(3):
        hand("key", "ctrl+shift+z")
    rest(app, window)
    assert len(editor.edit.handles) == 3 and not window.isWindowModified()
    wait_for(lambda: not autosave.exists(), app.processEvents)
    assert not autosave.with_suffix(".png").exists()
    hand("key", "ctrl+z")
    wait_for(autosave.exists, app.processEvents)


def test_the_right_button_has_a_menu_for_what_is_under_it(app, window):
    from deformer_app.viewer.changes import MenuAsked
    from deformer_app.viewer.stage import Hover

    def titles(hover):
        window._hear(MenuAsked((30.0, 40.0), hover))
        app.processEvents()
        menu = window.context_menu.shown
        assert menu.isVisible()
        found = {item.text().lstrip("\u2009"): item for item in menu.actions() if item.text()}
        return menu, found

    menu, found = titles(Hover(vertex=100))
    found["Pin here"].trigger()
    menu.close()
    (handle,) = window.editor.edit.handles
    assert handle.vertices[0] == 100 and 100 in handle.patch and handle.kind == "pin"
    window.editor.handles.select([])
    menu, found = titles(Hover(handle=handle.id))
    assert window.editor.handles.selected == {handle.id}
    found["Soft"].trigger()
    menu.close()
    assert window.editor.edit.handles[0].kind == "soft"
    menu, found = titles(Hover())
    assert {"Front", window.menus.items["frame"].text(), "Wireframe"} <= set(found)
    colours = {item.text(): item for item in found["Colour by"].menu().actions()}
    assert "Error against the target" not in colours, "there is no target"
    colours["Stretch"].trigger()
    assert window.editor.state.look.colour == "stretch"
    menu.close()


@pytest.mark.parametrize("title, label", [("Pin here", "Make pin"), ("Place handle",) * 2])
def test_an_item_of_the_menu_of_the_surface_is_one_step(app, window, hand, title, label):
    editor = window.editor
    hand(seen(editor, 0.6)[1], "click", "3")
    menu = wait_for(lambda: window.context_menu.shown, app.processEvents)
    item = next(one for one in menu.actions() if one.text().strip("\u2009") == title)
    at = menu.mapToGlobal(menu.actionGeometry(item).center())
    hand(window.plotter.mapFromGlobal(at).toTuple(), "click", "1")
    wait_for(lambda: editor.edit.handles, app.processEvents)
    rest(app, window)
    assert [entry.label for entry in editor.session.entries] == ["Start", label]
    hand("key", "ctrl+z")
    wait_for(lambda: not editor.edit.handles, app.processEvents)
    assert not editor.session.can_undo


@pytest.fixture
def unsaved(app, window):
    """A window with work that no file has."""
    place(window, 100)
    rest(app, window)
    assert window.files.unsaved
    return window


def test_what_cannot_be_opened_is_told_without_a_question(
    app, unsaved, tmp_path, monkeypatch, answers
):
    """Nothing is asked, for `answers` is empty, and nothing is lost."""
    window = unsaved
    damaged, foreign, gone = (tmp_path / f"{n}.json" for n in ("damaged", "foreign", "gone"))
    damaged.write_text('{"deformer_session": 1')
    window.editor.session.save(foreign)
    data = json.loads(foreign.read_text())
    foreign.write_text(json.dumps({**data, "model": {**data["model"], "fingerprint": "x"}}))
    handles = tmp_path / "handles.json"
    handles.write_text(json.dumps({"handles": [{"vertex": 17, "position": [0.0, 0.5, 0.0]}]}))
    model = tmp_path / "model"
    model.mkdir()
    (model / "model.json").write_text("{}")
    place(window, 60)
    rest(app, window)
    steps = list(window.editor.session.entries)
    for path in (damaged, foreign, handles, gone):
        monkeypatch.setattr(window, "ask_open", lambda *_, path=path: path)
        window.act("open-session")
        assert path.name in window.notices.mistake.text
    drop(app, window, damaged)
    assert "damaged.json" in window.notices.mistake.text
    monkeypatch.setattr(window, "ask_folder", lambda *_: model)
    window.act("open-model")
    assert "model" in window.notices.mistake.text
    assert answers.asked == [] and window.files.unsaved
    assert window.editor.session.entries == steps


def test_a_session_that_can_be_opened_is_asked_about_and_cancel_keeps_all(
    app, unsaved, tmp_path, answers
):
    window, steps = unsaved, list(unsaved.editor.session.entries)
    window.editor.session.save(tmp_path / "other.json")
    place(window, 60)
    rest(app, window)
    answers.append("Cancel")
    window.open_session(tmp_path / "other.json")
    assert len(answers.asked) == 1 and len(window.editor.session.entries) == len(steps) + 1
    answers.append("Discard")
    window.open_session(tmp_path / "other.json")
    ready(app, window)
    assert len(window.editor.session.entries) == len(steps)
    answers.append("Cancel")
    place(window, 60)
    rest(app, window)
    window.open_model(window.editor.session.model.path)
    assert len(answers.asked) == 3 and len(window.editor.session.entries) == len(steps) + 1


def test_opening_the_own_file_again_has_what_the_question_has_saved(
    app, unsaved, tmp_path, monkeypatch, answers
):
    window, file = unsaved, tmp_path / "work.json"
    monkeypatch.setattr(window, "ask_save", lambda *_: file)
    assert window.save(False)
    place(window, 60)
    rest(app, window)
    answers.append("Save")
    window.open_session(file)
    ready(app, window)
    assert [h.vertices for h in window.editor.edit.handles] == [(100,), (60,)]
