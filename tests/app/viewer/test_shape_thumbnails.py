"""Small pictures of shapes: what they show, and when they are drawn."""

import numpy as np
import pytest
import pyvista as pv

from deformer import InputError
from deformer_app.rendering.offscreen import off_screen
from deformer_app.viewer.changes import MistakeMade
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.shape_thumbnails import SIDE, Subject, Thumbnails
from off_screen_editor import finish, texts


@pytest.fixture
def made():
    """Plotters that were made."""
    return []


@pytest.fixture
def thumbnails(editor, made):
    def plotter(size):
        with off_screen():
            made.append(pv.Plotter(off_screen=True, window_size=list(size), lighting="none"))
        return made[-1]

    found = Thumbnails(editor, plotter)
    yield found
    found.close()


def codes(editor, *rows):
    return tuple(tuple(editor.model.codes[row].tolist()) for row in rows)


def test_pictures_are_drawn_once_and_tell_when_they_are_there(editor, thumbnails, made):
    told = []
    thumbnails.on_drawn.append(told.append)
    subject = Subject(codes(editor, 0, 5))
    assert thumbnails.pictures(subject) is None and thumbnails.waiting == 1
    finish(editor)
    first, second = thumbnails.pictures(subject)
    assert told == [subject] and thumbnails.waiting == 0 and len(made) == 1
    assert first.shape == (SIDE, SIDE, 4) and first.dtype == np.uint8
    # A shape before nothing: opaque inside, transparent in the corners.
    assert first[..., 3].max() == 255 and not first[[0, 0, -1, -1], [0, -1, 0, -1], 3].any()
    assert (first[..., 3] > 0).mean() > 0.02
    assert np.abs(first.astype(int) - second).max() > 50, "different shapes look different"
    assert thumbnails.pictures(subject)[0] is first and not editor.busy


def extent(picture):
    """Height and width in pixels of what is not transparent, and its middle."""
    shown = picture[..., 3] > 100
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    size = np.array([np.ptp(rows) + 1, np.ptp(columns) + 1])
    return size, np.array([rows.mean(), columns.mean()])


def test_shapes_that_stand_apart_fill_their_pictures_at_one_scale(editor, thumbnails, monkeypatch):
    shapes = editor.model.reference.vertices * np.array([1.0, 0.5])[:, None, None]
    apart = shapes + np.array([[[0.0, 0.0, 0.0]], [[0.0, 3.0, 5.0]]])
    monkeypatch.setattr(type(editor.model), "decode", lambda model, codes: apart[: len(codes)])
    subject = Subject(codes(editor, 0, 5))
    thumbnails.pictures(subject)
    finish(editor)
    (large, first), (small, second) = map(extent, thumbnails.pictures(subject))
    assert large.max() > 0.9 * SIDE
    np.testing.assert_allclose(small, large / 2, atol=4)
    np.testing.assert_allclose([first, second], SIDE / 2, atol=4)


def test_a_component_is_shown_where_it_acts(editor, thumbnails):
    k = int(editor.activations.order[0])
    (code,) = codes(editor, 0)
    whole, part = Subject((code,)), Subject((code,), k)
    for subject in (whole, part):
        thumbnails.pictures(subject)
    finish(editor)
    areas = [(thumbnails.pictures(s)[0][..., 3] > 0).mean() for s in (whole, part)]
    assert areas[1] > areas[0], "nearer, so larger"


def test_the_theme_changes_the_pictures_and_the_old_ones_are_shown_until_then(editor, thumbnails):
    subject = Subject(codes(editor, 0))
    thumbnails.pictures(subject)
    finish(editor)
    light = thumbnails.pictures(subject)[0]
    editor.picture.change_look(dark=True)
    assert thumbnails.pictures(subject)[0] is light and thumbnails.waiting == 1
    assert thumbnails.pictures(Subject(codes(editor, 5))) is None
    finish(editor)
    assert (thumbnails.pictures(subject)[0] != light).any()


def test_nothing_is_drawn_while_the_user_drags(editor, thumbnails, made):
    editor.handles.place(100)
    editor.handles.move_selected(translation([0.0, 0.1, 0.0]))
    thumbnails.pictures(Subject(codes(editor, 0)))
    for _ in range(300):
        editor.tick()
    assert thumbnails.waiting == 1 and not made
    editor.commit("Drag")
    finish(editor)
    assert thumbnails.waiting == 0 and len(made) == 1


def test_another_model_s_requests_are_dropped(editor, thumbnails, tmp_path):
    from dataclasses import replace

    model = editor.model
    replace(model, codes=1.01 * model.codes).save(tmp_path / "other")
    subject = Subject(codes(editor, 0))
    thumbnails.pictures(subject)
    editor.open_model(tmp_path / "other")
    finish(editor)
    assert thumbnails.waiting == 0 and thumbnails.pictures(subject) is None


def test_a_machine_that_cannot_draw_is_told_once(editor, heard):
    def fails(size):
        raise InputError("pictures: no way to draw")

    thumbnails = Thumbnails(editor, fails)
    for row in range(3):
        thumbnails.pictures(Subject(codes(editor, row)))
        finish(editor)
    assert texts(heard, MistakeMade) == ["pictures: no way to draw"]
    assert thumbnails.waiting == 0


def test_of_many_requests_the_oldest_are_dropped(editor, thumbnails):
    rng = np.random.default_rng(0)
    subjects = [Subject((tuple(z.tolist()),)) for z in rng.normal(size=(70, 6))]
    for subject in subjects:
        thumbnails.pictures(subject)
    assert thumbnails.waiting == 64
    finish(editor)
    found = [thumbnails.pictures(subject) is not None for subject in subjects]
    assert found == [False] * 6 + [True] * 64
