"""The window exports poses like the model's document, and keeps that of shapes it trains on."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

import deformer
import tubes
from deformer_app.viewer.exports import export_pose
from deformer_app.viewer.training_job import TrainingJob
from shapes import small_model
from waiting import HANG


def test_a_pose_is_exported_like_the_document(tmp_path):
    reference = small_model().reference
    data = b"# by hand\n" + deformer.io.mesh_bytes(reference, ".obj")
    document = deformer.Document(".obj", data, "a", len(reference.vertices), reference.faces)
    model = replace(small_model(), document=document)
    notes: list[str] = []
    editor = SimpleNamespace(
        preparing=False,
        wait_for_pose=lambda: None,
        vertices=reference.vertices + 1,
        model=model,
        note=notes.append,
    )
    export_pose(editor, tmp_path / "pose.obj")  # pyright: ignore
    assert notes == [f"Wrote {tmp_path / 'pose.obj'}"]
    assert (tmp_path / "pose.obj").read_bytes() == document.write(reference.vertices + 1)
    assert (tmp_path / "pose.obj").read_bytes().startswith(b"# by hand\n")


@pytest.mark.slow
def test_training_in_the_window_keeps_the_document(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    for n in range(4):
        (folder / f"{n}.obj").write_bytes(tubes.obj(n / 4))
    job = TrainingJob(folder, tmp_path / "model", 2, 2, "y")
    job._thread.join(HANG)
    assert job.done and job.error is None
    document = deformer.load_model(tmp_path / "model").document
    assert document is not None and document.data == tubes.obj()
