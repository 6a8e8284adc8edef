"""The present state as a Python script: a fresh process makes the same pose."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from deformer import InputError, load_mesh
from deformer_app.viewer.script import python_script
from number_fields import type_centre
from off_screen_editor import finish


def run(text, folder):
    (folder / "pose.py").write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "pose.py"], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return load_mesh(folder / "pose.obj").vertices


def pull(editor, vertex, shift, kind="soft"):
    editor.handles.select([editor.handles.place(vertex)])
    editor.commit("Place handle")
    type_centre(editor, np.array(editor.edit.handles[-1].centre) + shift)
    editor.handles.set_kind(kind)
    finish(editor)


def test_handles_of_all_kinds_and_the_prior_give_the_pose_that_is_shown(editor, tmp_path):
    count = len(editor.model.reference.vertices)
    size = editor.model.reference.bounding_diagonal
    pull(editor, 3, [0.0, 0.0, 0.0], "pin")
    pull(editor, count // 2, [0.0, 0.1 * size, 0.0])
    editor.handles.set_weight(2.5)
    editor.commit("Weight")
    pull(editor, count - 5, [0.0, 0.1 * size, 0.05 * size], "exact")
    from deformer_app.viewer.gizmo import rotation

    editor.handles.move_selected(rotation(editor.edit.handles[-1].centre, [0.0, 0.4, 0.0]))
    editor.commit("Rotate")
    editor.handles.add_region([20, 21, 22, 23, 24, 25])
    editor.prior.slide(0, 0.8)
    editor.commit("Slide")
    editor.prior.set_noise(0.02)
    editor.commit("Strength")
    editor.prior.set_body("moves")
    finish(editor)
    text = python_script(editor, "pose.obj")
    for word in ("kinds=", "weights=", "orientations=", "mean=", "noise=0.02"):
        assert word in text
    assert max(map(len, text.splitlines())) <= 100
    np.testing.assert_allclose(run(text, tmp_path), editor.vertices, atol=1e-6 * size)


def test_the_floor_that_is_on_holds_the_pose_up(editor, tmp_path):
    size = editor.model.reference.bounding_diagonal
    pull(editor, len(editor.model.reference.vertices) // 2, [0.0, -0.1 * size, 0.0])
    free = editor.vertices
    floor = float(np.quantile(free[:, 1], 0.05))
    editor.change("Floor", replace(editor.edit, floor=floor))
    finish(editor)
    assert np.abs(editor.vertices - free).max() > 1e-3 * size
    text = python_script(editor, "pose.obj")
    assert "set_floor" in text
    np.testing.assert_allclose(run(text, tmp_path), editor.vertices, atol=1e-6 * size)


def test_without_handles_it_is_the_prior_s_mean(editor, tmp_path):
    editor.prior.slide(1, 1.0)
    editor.commit("Slide")
    finish(editor)
    text = python_script(editor, "pose.obj")
    assert "set_handles" not in text
    size = editor.model.reference.bounding_diagonal
    np.testing.assert_allclose(run(text, tmp_path), editor.vertices, atol=1e-6 * size)


def test_there_is_none_while_the_solver_is_being_prepared(editor, model_path):
    editor.open_model(model_path)
    assert editor.preparing
    with pytest.raises(InputError, match="still being prepared"):
        python_script(editor)
    finish(editor)
