"""The brush: how large it is, how it shows, and the patches that it paints."""

import numpy as np
import pytest

import deformer
from deformer_app.rendering.palette import KINDS, REGION, SELECTED
from deformer_app.viewer.changes import NoticeGiven
from deformer_app.viewer.region_brush import RegionBrush
from number_fields import type_centre
from off_screen_editor import click, drag, event, finish, seen, texts


@pytest.fixture
def brush_lines(editor):
    """The segments of the brush's border that are drawn, as points (n, 3)."""

    def lines():
        strokes = editor.state.view.overlays._brush
        if not strokes.actor.GetVisibility():
            return np.empty((0, 3))
        data = strokes.actor.GetMapper().GetInput()
        return np.array([data.GetPoint(n) for n in range(data.GetNumberOfPoints())])

    return lines


def test_the_first_size_of_the_brush_is_a_few_dozen_vertices_of_a_limb():
    model = deformer.load_model("humanoid")
    brush = RegionBrush()
    brush.fit(model)
    counts = [
        len(brush.disc(model, vertex)) for vertex in range(0, len(model.reference.vertices), 97)
    ]
    assert 12 <= np.median(counts) <= 80
    assert max(counts) < 0.1 * len(model.reference.vertices)


def test_the_border_of_the_brush_is_a_circle_along_the_surface(editor):
    brush, model = editor.stage.brush, editor.model
    brush.radius = 0.12
    lines = brush.outline(model, 60, model.reference.vertices)
    ends = np.concatenate(lines)
    inside = set(brush.disc(model, 60))
    crossing = [f for f in model.reference.faces if 0 < len(inside.intersection(f.tolist())) < 3]
    assert len(lines) == len(crossing) > 3
    # Every point of it is the end of two segments: the line is closed.
    keys, times = np.unique(np.round(ends, 9), axis=0, return_counts=True)
    assert (times == 2).all() and len(keys) == len(lines)


def test_the_brush_is_shown_before_and_while_it_paints(editor, brush_lines):
    assert not len(brush_lines())
    _, at = seen(editor, 0.5)
    event(editor, "MouseMove", at)
    assert not len(brush_lines()), "it is not the tool"
    editor.state.set_tool("paint")
    event(editor, "MouseMove", at + 3)
    finish(editor)
    before = brush_lines()
    assert len(before)
    event(editor, "MouseMove", (5, 5))
    assert not len(brush_lines())
    drag(editor, at, np.add(at, (40, 0)), release=False)
    assert len(brush_lines()) and (brush_lines() != before).any()
    (patch,) = editor.state.view.surface.patches.shown
    assert patch.colour == REGION and len(patch.vertices) >= 3
    event(editor, "LeftButtonRelease", np.add(at, (40, 0)))
    finish(editor)
    assert not len(brush_lines())


def test_its_size_is_shown_while_it_changes(editor, brush_lines, heard):
    editor.stage.resize_brush(1.25)
    size = editor.stage.brush.radius * editor.model.reference.bounding_diagonal
    assert texts(heard, NoticeGiven) == [f"Brush  {size:.3g} units"]
    editor.state.set_tool("paint")
    vertex, at = seen(editor, 0.5)
    event(editor, "MouseMove", at)
    small = brush_lines()
    editor.stage.resize_brush(2.0)
    count = len(editor.stage.brush.disc(editor.model, vertex))
    label = editor.state.view.overlays.label
    assert label.text == f"Brush  {2 * size:.3g} units   {count} vertices"
    assert np.ptp(brush_lines(), axis=0).max() > np.ptp(small, axis=0).max()
    event(editor, "MouseMove", (5, 5))
    assert label.text == ""


def paint(editor, share):
    editor.state.set_tool("paint")
    editor.stage.brush.radius = 0.12
    _, at = seen(editor, share)
    drag(editor, at, np.add(at, (4, 0)), steps=2)
    return editor.edit.handles[-1]


def test_a_painted_patch_shows_as_long_as_its_handle_exists(editor):
    patches = editor.state.view.surface.patches
    first = paint(editor, 0.8)
    second = paint(editor, 0.2)
    assert [(p.vertices, p.colour) for p in patches.shown] == [
        (first.patch, KINDS["soft"]), (second.patch, SELECTED)]  # fmt: skip
    editor.handles.select([first.id])
    editor.handles.set_kind("exact")
    editor.handles.select([second.id])
    finish(editor)
    assert [p.colour for p in patches.shown] == [KINDS["exact"], SELECTED]
    mesh = patches._mesh
    editor.handles.delete()
    finish(editor)
    assert [p.vertices for p in patches.shown] == [first.patch] and patches._mesh is not mesh
    editor.undo()
    finish(editor)
    assert len(patches.shown) == 2
    editor.handles.clear()
    finish(editor)
    assert patches.shown == () and patches._mesh is None


def test_a_patch_moves_with_the_surface(editor):
    region = paint(editor, 0.9)
    type_centre(editor, np.add(region.centre, (0.0, 0.2, 0.1)))
    finish(editor)
    drawn = np.asarray(editor.state.view.surface.patches._mesh.points)
    np.testing.assert_allclose(drawn[list(region.patch)], editor.vertices[list(region.patch)],
                               atol=1e-5)  # fmt: skip


def test_escape_paints_nothing(editor):
    editor.state.set_tool("paint")
    _, at = seen(editor, 0.5)
    drag(editor, at, np.add(at, (20, 0)), release=False)
    assert editor.state.view.surface.patches.shown
    editor.controller.cancel()
    finish(editor)
    assert editor.edit.handles == () and editor.state.view.surface.patches.shown == ()


def test_a_brush_smaller_than_a_face_still_paints_a_vertex(editor):
    editor.stage.brush.radius = 0.0051
    editor.state.set_tool("paint")
    vertex, at = seen(editor, 0.5)
    click(editor, at)
    assert editor.edit.handles[0].patch == (vertex,)
