"""Cameras, the orientation cube, the reference picture and the script, by keys and mouse."""

import numpy as np
import pytest
from PIL import Image

from deformer_app.viewer.view_cube import centre
from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def test_saved_cameras_come_back_by_their_keys_and_are_forgotten(app, window, hand, monkeypatch):
    editor, names = window.editor, iter(["front & centre", "above"])
    monkeypatch.setattr(window, "ask_text", lambda *_: next(names))
    cameras = []
    for azimuth, elevation in ((0, 0), (30, 60)):
        editor.picture.frame(azimuth, elevation)
        cameras.append(editor.state.camera)
        hand("key", "alt+0")
        wait_for(lambda: len(editor.state.cameras.names) == len(cameras), app.processEvents)
    rest(app, window)
    assert window.isWindowModified()
    for n in (0, 1, 0):
        hand("key", f"alt+{n + 1}")
        wait_for(lambda n=n: editor.state.camera == cameras[n], app.processEvents)
    menu = window.menus.cameras
    assert [a.text() for a in menu.actions()[:2]] == ["front && centre", "above"]
    menu.actions()[-1].menu().actions()[0].trigger()
    rest(app, window)
    assert editor.state.cameras.names == ["above"]
    hand("key", "alt+1")
    wait_for(lambda: editor.state.camera == cameras[1], app.processEvents)


def test_a_session_keeps_the_cameras(app, window, tmp_path):
    editor = window.editor
    editor.state.viewpoint.toggle_orthographic()
    editor.state.cameras.save("one", editor.state.camera)
    camera = editor.state.camera
    editor.save_session(tmp_path / "s.json")
    editor.state.cameras.remove("one")
    editor.open_session(tmp_path / "s.json")
    assert editor.state.cameras["one"] == camera


def test_a_click_on_the_cube_looks_from_that_side(app, window, hand):
    editor, frame = window.editor, window.editor.state.view.frame
    editor.picture.frame(20, 10)
    rest(app, window)
    hand(np.floor(centre(editor.stage.size)), "click", "1")
    wait_for(
        lambda: np.allclose(frame @ editor.state.camera.axes()[2], [0, 0, 1]), app.processEvents
    )
    assert editor.edit.handles == ()


def test_the_key_o_changes_the_projection(app, window, hand):
    state = window.editor.state
    for flat in (True, False):
        hand("key", "o")
        wait_for(lambda flat=flat: state.camera.is_orthographic == flat, app.processEvents)


def test_the_script_is_on_the_clipboard(app, window, hand):
    place(window, 100)
    rest(app, window)
    app.clipboard().setText("")
    hand("key", "ctrl+shift+c")
    wait_for(lambda: "set_handles" in app.clipboard().text(), app.processEvents)
    assert "vertices=[100]" in app.clipboard().text()


def test_the_dock_places_the_reference_picture(app, window, tmp_path):
    from deformer_app.viewer.qt.picture_panel import PicturePanel
    from deformer_app.viewer.qt.slider import STEPS

    folder = tmp_path / "frames"
    folder.mkdir()
    for n in range(5):
        Image.new("RGB", (8, 8), (50 * n, 0, 0)).save(folder / f"{n}.png")
    panel, reference = window.docks.panel(PicturePanel), window.editor.state.reference_picture
    rest(app, window)
    assert not panel.opacity.isEnabled()
    panel._open(folder)
    wait_for(panel.time.isEnabled, app.processEvents)
    panel.opacity.setValue(STEPS // 4)
    panel.numbers["x"].setValue(0.3)
    panel.in_front.click()
    panel.time.setValue(STEPS)
    wait_for(lambda: reference.frame == 4, app.processEvents)
    rest(app, window)
    found = reference.placement
    assert (found.opacity, found.x, found.in_front) == (0.25, 0.3, True)
    assert window.isWindowModified()
    window.editor.undo()  # of no concern to it
    panel._close()
    rest(app, window)
    assert not panel.opacity.isEnabled() and not window.editor.state.view.plane.is_shown


def test_a_file_that_is_no_picture_is_told_in_the_window(app, window, tmp_path):
    from deformer_app.viewer.qt.picture_panel import PicturePanel

    (tmp_path / "a.png").write_bytes(b"no picture")
    window.docks.panel(PicturePanel)._open(tmp_path / "a.png")
    wait_for(window.notices.mistake.isVisible, app.processEvents)
    assert window.editor.state.reference_picture.footage is None
