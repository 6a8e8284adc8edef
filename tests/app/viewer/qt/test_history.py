"""The list of the history under a real mouse and real keys."""

import pytest

from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def history(app, window, hand):
    """The dialog, over a window with three steps, opened by its key."""
    for vertex in (0, 60, 100):
        place(window, vertex)
    rest(app, window)
    hand("key", "ctrl+h")
    wait_for(lambda: window._history is not None and window._history.isVisible(), app.processEvents)
    hand("windowfocus", "--sync", str(int(window._history.winId())))
    wait_for(window._history.steps.hasFocus, app.processEvents)
    return window._history


def row(history, number):
    """Words for xdotool: a click on a row."""
    steps = history.steps
    at = steps.viewport().mapToGlobal(steps.visualItemRect(steps.item(number)).center())
    return "mousemove", str(at.x()), str(at.y()), "click", "1"


def texts(history):
    return [history.steps.item(n).text() for n in range(history.steps.count())]


def test_a_step_that_is_chosen_is_shown_as_undo_and_redo_show_it(app, window, hand, history):
    editor = window.editor
    assert texts(history) == ["0  Start", *(f"{n}  Place handle" for n in (1, 2, 3))]
    assert history.steps.currentRow() == editor.session.cursor == 3
    seen = []
    for _ in range(3):
        window.act("undo")
        rest(app, window)
        seen.append((editor.edit, editor.vertices.copy()))
        assert history.steps.currentRow() == editor.session.cursor, "it follows"
    for number, (edit, vertices) in zip((2, 1, 0), seen, strict=True):
        hand(*row(history, number))
        rest(app, window)
        assert editor.edit == edit and (editor.vertices == vertices).all()
        assert len(editor.session.entries) == 4
    hand("key", "Down", "key", "Down")
    rest(app, window)
    assert editor.session.cursor == 2
    hand("key", "ctrl+z")
    rest(app, window)
    assert editor.session.cursor == history.steps.currentRow() == 1
    hand("key", "Return")
    wait_for(lambda: not history.isVisible(), app.processEvents)
    assert editor.session.cursor == 1


def test_it_follows_new_steps_in_place_of_those_undone(app, window, hand, history):
    from PySide6.QtCore import Qt

    def grey():
        items = [history.steps.item(n) for n in range(history.steps.count())]
        role = Qt.ItemDataRole.ForegroundRole
        return [n for n, item in enumerate(items) if item.data(role) is not None]

    hand(*row(history, 1))
    assert grey() == [2, 3]
    place(window, 20)
    rest(app, window)
    assert texts(history) == ["0  Start", "1  Place handle", "2  Place handle"]
    assert history.steps.currentRow() == 2 and not grey()
    window.editor.prior.reset()
    rest(app, window)
    assert texts(history)[-1] == "3  Start from reference" and not grey()
    hand("key", "ctrl+h")
    wait_for(lambda: not history.isVisible(), app.processEvents)


def test_a_step_that_is_being_made_is_not_left(app, window, hand, history):
    editor = window.editor
    editor.prior.set_noise(0.5 * editor.edit.noise)
    hand(*row(history, 1))
    assert editor.session.under_way and editor.session.cursor == 3
    assert history.steps.currentRow() == 3
    editor.commit("Strength of the prior")
    assert texts(history)[-1] == "4  Strength of the prior" and history.steps.currentRow() == 4
    window.editor.close_model()
    assert not history.isVisible()


@pytest.mark.parametrize("dark", [False, True])
def test_labels_can_be_read_in_both_themes(app, window, hand, history, dark):
    from contrast import contrast

    hand(*row(history, 2))
    window.choose_theme(not dark)
    rest(app, window)
    window.choose_theme(dark)
    rest(app, window)
    app.processEvents()
    steps = history.steps
    image = steps.viewport().grab().toImage()

    def ink(number):
        """The strongest contrast of a row's pixels to its ground."""
        area = steps.visualItemRect(steps.item(number))
        ground = image.pixelColor(area.right() - 2, area.center().y()).getRgb()[:3]
        pixels = {
            image.pixelColor(x, y).getRgb()[:3]
            for x in range(area.left(), area.left() + 100)
            for y in range(area.top(), area.bottom())
        }
        return max(contrast(ground, pixel) for pixel in pixels)

    # Thin strokes are blended with their ground.
    assert ink(0) > 4.5 and ink(2) > 3.0 and 1.8 < ink(3) < ink(0)


def test_a_long_history_is_listed_at_once(app, window, hand, history):
    """Rows that are there stay: of 800 steps, one more makes one row."""
    from dataclasses import replace

    editor, model = window.editor, history.steps.model()
    start = editor.edit
    for n in range(800):
        editor.session.do(f"Step {n}", replace(start, noise=start.noise * (2 + n)))
    history._fill()
    rows = []
    model.rowsInserted.connect(lambda _, first, last: rows.extend(range(first, last + 1)))
    model.rowsRemoved.connect(lambda _, first, last: rows.extend(range(first, last + 1)))
    coloured = []
    model.dataChanged.connect(lambda first, last, roles: coloured.append(first.row()))
    place(window, 20)
    rest(app, window)
    assert rows == [804] and set(coloured) <= {803, 804}
    hand("key", "Home")
    rest(app, window)
    assert editor.session.cursor == 0 and len(editor.session.entries) == 805
