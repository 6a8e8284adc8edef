"""Trainings in the window: which axis is up, and what happens at the end."""

import numpy as np
import pytest

import deformer
from person import place, rest
from shapes import sequence
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def train(app, window, tmp_path):
    """Trains a small model in a dialog that is hidden or not; returns where the model is."""

    def run(hide, name="shapes"):
        deformer.save_shapes(tmp_path / f"{name}.npz", sequence(3))
        dialog = window.train()
        dialog.choose(tmp_path / f"{name}.npz")
        dialog.epochs.setValue(2)
        dialog.start_button.click()
        if hide:
            dialog.hide_button.click()
        wait_for(lambda: not dialog.training, app.processEvents)
        assert dialog.ended and not dialog.isVisible()
        return (tmp_path / f"{name}-model").resolve()

    return run


@pytest.fixture
def offer(window):
    return window._trained.offer


def button(offer, title):
    from PySide6.QtWidgets import QPushButton

    return next(b for b in offer.findChildren(QPushButton) if b.text() == title)


def test_a_training_in_the_background_ends_with_a_note_and_nothing_else(
    app, window, train, offer, answers
):
    shown = window.editor.session
    model = train(hide=True)
    assert window.editor.session is shown and not answers.asked
    assert offer.isVisible() and "shapes-model is trained" in offer.text
    assert window.settings.recent[0] == str(model)
    button(offer, "Later").click()
    assert not offer.isVisible() and window.editor.session is shown
    assert window.settings.recent[0] == str(model)


def test_the_offer_opens_the_model_and_asks_for_unsaved_work_only_then(
    app, window, train, offer, answers
):
    place(window, 100)
    rest(app, window)
    shown = window.editor.session
    model = train(hide=False)
    assert window.editor.session is shown and not answers.asked, "unsaved work stays"
    answers.append("Cancel")
    button(offer, "Open").click()
    assert window.editor.session is shown and offer.isVisible()
    answers.append("Discard")
    button(offer, "Open").click()
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    assert window.editor.session.model.path == str(model) and not offer.isVisible()


def test_a_model_that_the_user_waits_for_is_opened(app, window, train, offer):
    model = train(hide=False)
    assert window.editor.session.model.path == str(model) and not offer.isVisible()
    wait_for(lambda: not window.editor.preparing, app.processEvents)


def test_the_start_page_offers_and_lists_the_model(app, window, train, offer):
    window.close_model()
    model = train(hide=True)
    assert window.pages.currentWidget() is window.start_page and not window.editor.is_open
    assert offer.isVisible()
    assert window.start_page.recent[0].text().startswith(model.name)


def test_a_failure_in_the_background_is_told_in_the_window(app, window, tmp_path):
    dialog = window.train()
    dialog.choose(tmp_path / "nothing.npz")
    dialog.start_button.click()
    dialog.hide_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert window.notices.mistake.isVisible() and "nothing.npz" in window.notices.mistake.text


def weights(model):
    return (model / "weights.safetensors").read_bytes()


def test_the_suggested_folder_is_free(app, window, train, tmp_path):
    first = train(hide=True)
    before = weights(first)
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    assert dialog.output.text() == str(tmp_path / "shapes-model-2")
    dialog.epochs.setValue(2)
    click(dialog.start_button)
    wait_for(lambda: not dialog.training, app.processEvents)
    assert dialog.ended and weights(first) == before
    assert (tmp_path / "shapes-model-2" / "model.json").is_file()
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    assert dialog.output.text() == str(tmp_path / "shapes-model-3")


def test_a_model_is_replaced_only_if_the_user_says_so_and_its_sessions_tell_of_it(
    app, window, tmp_path, model_path, answers
):
    from PySide6.QtTest import QTest

    place(window, 100)
    rest(app, window)
    session, before = tmp_path / "work.json", weights(model_path)
    window.editor.save_session(session)
    deformer.save_shapes(tmp_path / "shapes.npz", sequence(3))
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.epochs.setValue(2)
    dialog.output.setFocus()
    dialog.output.selectAll()
    QTest.keyClicks(dialog.output, str(model_path))
    answers.append("Cancel")
    press(dialog.output, "Return")
    assert not dialog.training and dialog.isVisible() and weights(model_path) == before
    (question,) = answers.asked
    assert question.text().startswith(f"{model_path} holds a model;")
    assert question.defaultButton().text() == "Cancel", "Enter replaces nothing"
    answers.append("Replace")
    click(dialog.start_button)
    assert dialog.training and len(answers.asked) == 2
    wait_for(lambda: not dialog.training, app.processEvents)
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    assert weights(model_path) != before
    window.open_session(session)
    told = window.notices.mistake.text
    assert str(session) in told and "trained anew or changed" in told and "open that" not in told


@pytest.fixture
def lying(tmp_path):
    """A file of tubes along z, which lie in the window if y is up."""
    shapes = sequence(3)
    turned = deformer.MeshSequence(shapes.vertices[..., [1, 2, 0]], shapes.faces)
    deformer.save_shapes(tmp_path / "lying.npz", turned)
    return tmp_path / "lying.npz"


def drawn(dialog):
    """Height and width of what the picture of the first shape shows, in pixels."""
    image = dialog.up.picture.pixmap().toImage()
    inside = np.array(
        [
            [image.pixelColor(x, y).alpha() > 0 for x in range(image.width())]
            for y in range(image.height())
        ]
    )
    return np.ptp(np.flatnonzero(inside.any(axis=1))), np.ptp(np.flatnonzero(inside.any(axis=0)))


def test_the_first_shape_stands_in_the_dialog_and_in_the_trained_model(app, window, lying):
    dialog = window.train()
    dialog.choose(lying)
    wait_for(lambda: not dialog.up.looking, app.processEvents)
    assert dialog.up.chosen == "z"
    height, width = drawn(dialog)
    assert height > 1.5 * width
    dialog.up.axis.setFocus()
    for key, axis, stands in (("Up", "y", False), ("Down", "z", True)):
        press(dialog.up.axis, key)
        assert dialog.up.chosen == axis
        height, width = drawn(dialog)
        assert (height > width) == stands
    dialog.epochs.setValue(2)
    dialog.start_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    assert window.editor.model.summary["up"] == "z"
    low, high = np.ptp(window.editor.model.reference.vertices, axis=0)[[0, 2]]
    assert window.editor.state.viewpoint.up == "z" and high > low


def test_a_training_that_starts_before_the_shape_is_shown_guesses_alike(app, window, lying):
    dialog = window.train()
    dialog.choose(lying)
    dialog.epochs.setValue(2)
    assert dialog.up.chosen is None
    dialog.start_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    assert window.editor.model.summary["up"] == "z"


def test_shapes_that_cannot_be_read_are_told_when_their_field_is_left(
    app, window, hand, lying, tmp_path
):
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QLabel

    dialog = window.train()
    (tmp_path / "empty").mkdir()
    wait_for(lambda: dialog.windowHandle().isExposed(), app.processEvents)
    hand("windowfocus", "--sync", str(int(dialog.winId())))

    def told(path):
        """Texts beside the picture once a path has been typed."""
        dialog.shapes.setFocus()
        wait_for(dialog.shapes.hasFocus, app.processEvents)
        dialog.shapes.selectAll()
        QTest.keyClicks(dialog.shapes, str(path))
        press(dialog.shapes, "Tab")
        wait_for(lambda: not dialog.up.looking, app.processEvents)
        return " ".join(label.text() for label in dialog.up.findChildren(QLabel))

    assert "The first shape" in told(lying)
    for name, reason in (("empty", "No mesh files"), ("missing", "Does not exist")):
        text = told(tmp_path / name)
        assert reason in text and "The first shape" not in text
        assert dialog.up.picture.pixmap().isNull()
    lying.rename(tmp_path / "empty" / "lying.npz")
    assert "The first shape" in told(tmp_path / "empty" / "lying.npz")
    (tmp_path / "empty" / "lying.npz").rename(tmp_path / "missing")
    assert "Does not exist" not in told(tmp_path / "missing"), "it is looked at again"


def press(widget, name):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    QTest.keyClick(widget, getattr(Qt.Key, f"Key_{name}"))


def click(button):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def test_a_shape_that_is_loaded_while_the_dialog_is_hidden_is_drawn_when_it_is_shown(
    app, window, tmp_path
):
    deformer.save_shapes(tmp_path / "shapes.npz", sequence(3))
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.hide()
    wait_for(lambda: not dialog.up.looking, app.processEvents)
    assert dialog.up.picture.pixmap().isNull() and dialog.up._drawing is None
    dialog.show()
    wait_for(lambda: not dialog.up.picture.pixmap().isNull(), app.processEvents)
    dialog.hide()
    assert dialog.up._drawing is None, "nobody else would free it"
