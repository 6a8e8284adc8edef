"""A file of one kind at the place of another: one line says what it is and where it belongs."""

import json
import subprocess

import numpy as np
import pytest

import deformer
from command import DEFORMER
from deformer import InputError, io
from deformer.io import file_kinds, loading, point_caches
from deformer_app.cli.synthesis import start_code
from deformer_app.rendering.footage import PICTURES, VIDEOS, open_footage
from deformer_app.viewer.pose_files import load_library, save_library
from deformer_app.viewer.poses import SavedPose
from deformer_app.viewer.session import ModelName, Session
from shapes import sequence, small_model

SHAPES = 12


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A file or folder of each kind, by the kind; written by the program where it writes them."""
    folder, model = tmp_path_factory.mktemp("kinds"), small_model()
    name = ModelName("tube", model.fingerprint)
    code = tuple(model.codes[0].tolist())
    Session.begin(name, code).save(folder / "session.json")
    save_library(folder / "poses.json", [SavedPose.of_code("up", code)], name)
    model.save(folder / "model")
    deformer.save_shapes(folder / "shapes.npz", sequence(3))
    deformer.save_shapes(folder / "shapes", sequence(3))
    deformer.save_mesh(folder / "mesh.ply", model.reference)
    place = {"vertex": 5, "position": [0.0, 0.5, 0.0]}
    for title, content in {
        "handles": {"handles": [place]},
        "frames": {"frames": [[place]]},
        "split": {"train": [0, 1], "test": [2]},
        "code": {"z": code},
        "vertices": {"vertices": [1, 2]},
        "results": [{"method": "pca", "metric": "E_rms", "value": 1.0}],
    }.items():
        (folder / f"{title}.json").write_text(json.dumps(content))
    (folder / "picture.png").write_bytes(b"\x89PNG")
    report = subprocess.run(
        [*DEFORMER, "check", folder / "shapes.npz", "--json"], capture_output=True, check=False
    )
    (folder / "report.json").write_bytes(report.stdout)
    return folder


KINDS = {
    "session.json": "session",
    "poses.json": "poses",
    "model": "model",
    "model/model.json": "model",
    "split.json": "split",
    "code.json": "code",
    "report.json": "report",
    "results.json": "report",
    "handles.json": "handles",
    "frames.json": "handles",
    "vertices.json": "vertices",
    "shapes.npz": "shapes",
    "shapes": "shapes",
    "mesh.ply": "shapes",
    "picture.png": "picture",
}
READERS = {
    "session": Session.load,
    "poses": lambda path: load_library(path, small_model(), ModelName.of("tube", small_model())),
    "model": deformer.load_model,
    "split": lambda path: io.load_split(path, SHAPES),
    "code": lambda path: start_code(small_model(), str(path)),
    "handles": lambda path: io.load_handles(path, len(small_model().reference.vertices)),
    "picture": open_footage,
}


@pytest.mark.parametrize(("name", "kind"), KINDS.items())
def test_what_the_program_writes_is_known_by_its_contents(files, name, kind):
    assert io.kind_of(files / name) == kind


PAIRS = [
    (name, expected)
    for name, kind in KINDS.items()
    for expected in READERS
    if kind != expected
    # Meshes are encoded, and a folder is one of pictures.
    and not (expected == "code" and not name.endswith(".json"))
    and not (expected == "picture" and "." not in name)
]


@pytest.mark.parametrize(("name", "expected"), PAIRS)
def test_each_reader_says_what_a_file_of_another_kind_is(files, name, expected):
    path = files / name
    with pytest.raises(InputError) as caught:
        READERS[expected](path)
    text = str(caught.value)
    found, _, wanted = text.removeprefix(f"{path}: is ").partition(", expected ")
    assert "\n" not in text and text.startswith(f"{path}: is ")
    assert "; " in wanted and found != wanted.partition(";")[0]


@pytest.mark.parametrize("name", ["session.json", "handles.json", "picture.png", "split.json"])
def test_shapes_and_meshes_are_no_other_file(files, name):
    for read in (deformer.load_shapes, deformer.load_mesh):
        with pytest.raises(InputError, match="expected a mesh or a sequence of meshes; "):
            read(files / name)


def test_a_session_for_handles_and_handles_for_a_session(files):
    with pytest.raises(InputError) as caught:
        io.load_handles(files / "session.json", 120)
    assert str(caught.value) == (
        f"{files / 'session.json'}: is a session of the viewer, expected a handles file; open it "
        "by File > Open session or --session; File > Export handles then writes its handles"
    )
    with pytest.raises(InputError, match=r"handles\.json: is a handles file.*a session.*fit MODEL"):
        Session.load(files / "handles.json")


def test_a_file_of_the_kind_with_a_fault_is_told_of_its_fault(files, tmp_path):
    data = json.loads((files / "session.json").read_text())
    data["cursor"] = 99
    (tmp_path / "session.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match="cursor: expected"):
        Session.load(tmp_path / "session.json")
    (tmp_path / "handles.json").write_text('{"handles": [{"vertex": 1}]}')
    with pytest.raises(InputError, match=r"handles\[0\]: no 'position'"):
        io.load_handles(tmp_path / "handles.json", 120)


@pytest.mark.parametrize("content", ["", "{", "3", "[]", '{"other": 1}', "[" * 10_000, "\udcff"])
def test_what_is_of_no_kind_keeps_the_message_of_its_reader(tmp_path, content):
    path = tmp_path / "other.json"
    path.write_bytes(content.encode(errors="surrogateescape"))
    assert io.kind_of(path) is None and io.wrong_kind(path, "handles") is None
    with pytest.raises(InputError, match=r"other\.json"):
        Session.load(path)
    assert io.kind_of(tmp_path / "gone.json") is None


def test_a_file_without_a_session_says_which_files_have_one(tmp_path):
    (tmp_path / "a.json").write_text('{"other": 1}')
    with pytest.raises(InputError, match=r"a\.json: is no session.*Save session"):
        Session.load(tmp_path / "a.json")


def test_suffixes_of_pictures_are_those_that_are_read(tmp_path):
    from deformer_app.rendering.footage import PICTURES, VIDEOS

    for suffix in PICTURES + VIDEOS:
        (tmp_path / f"a{suffix}").write_bytes(np.arange(8, dtype=np.uint8).tobytes())
        assert io.kind_of(tmp_path / f"a{suffix}") == "picture"


def test_every_suffix_of_shapes_has_a_reader():
    assert {*loading._READERS, *point_caches.CACHE_SUFFIXES} == {*io.SHAPE_SUFFIXES}
    assert {*PICTURES, *VIDEOS} == {*file_kinds._PICTURES}


def test_a_file_too_large_to_be_read_twice_is_of_no_kind(tmp_path, monkeypatch):
    file = tmp_path / "handles.json"
    file.write_text('{"handles": []}')
    assert io.kind_of(file) == "handles"
    monkeypatch.setattr(file_kinds, "_LARGEST_READ", 10)
    assert io.kind_of(file) is None
