"""The `deformer` command as a user runs it: exit status, stdout, stderr."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deformer
from bars import bending_bar
from command import DEFORMER
from deformer.linalg import CORES
from deformer_app import console
from deformer_app.cli import demo, main as cli
from waiting import HANG, wait_for

COMMANDS = ["check", "train", "info", "fit", "evaluate", "edit", "demo"]
EPOCHS = "4"


@pytest.fixture(scope="module")
def shapes_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("shapes") / "bar.npz"
    deformer.save_shapes(path, bending_bar())
    return path


@pytest.fixture(scope="module")
def model_path(shapes_path, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "bar"
    command = ["train", shapes_path, "-o", path, "--components", "4", "--epochs", EPOCHS]
    assert console.run(cli.app, [str(part) for part in command]) == 0
    return path


def write_handles(path, frames, sequence=False):
    handles = [
        [{"vertex": int(vertex), "position": list(map(float, p))} for vertex, p in frame.items()]
        for frame in frames
    ]
    path.write_text(json.dumps({"frames": handles} if sequence else {"handles": handles[0]}))
    return path


def rms(distances):
    return np.sqrt(np.mean(np.square(distances)))


def frame_of(shape, vertices=(0, 100, 225)):
    """Handles that ask for the place of some vertices in one of the example shapes."""
    return {vertex: bending_bar().vertices[shape][vertex] for vertex in vertices}


def test_help_shows_every_command_and_is_quick():
    before = os.times()
    shown = subprocess.run([*DEFORMER, "--help"], capture_output=True, text=True, check=True)
    after = os.times()
    # Of the processor, half of it needed; the clock would measure what else the machine does.
    assert after.children_user - before.children_user < 1.5
    assert all(command in shown.stdout for command in COMMANDS)
    code = (
        "import sys; from deformer_app import console; from deformer_app.cli import main\n"
        "console.run(main.app, ['--help'])\n"
        "print([m for m in ('torch', 'numpy', 'pyvista', 'deformer') if m in sys.modules])"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert loaded.returncode == 0, loaded.stderr
    assert loaded.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_has_an_example(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"deformer {command}" in out
    assert "--json" in out


def test_without_arguments_comes_the_help(run):
    assert run()[:2] == run("--help")[:2]


def test_version(run):
    status, out, _ = run("--version")
    assert status == 0
    assert re.fullmatch(r"deformer \d+\.\d+\.\d+\n", out)


def test_check_reports_facts_and_findings(run, run_json, shapes_path, tmp_path):
    report = run_json("check", shapes_path)
    assert report["usable"] is True
    assert report["facts"]["shapes"] == 12
    assert report["facts"]["vertices"] == 226
    status, out, _ = run("check", shapes_path)
    assert status == 0
    assert "226" in out

    shapes = bending_bar()
    one = deformer.MeshSequence(shapes.vertices[:1], shapes.faces)
    deformer.save_shapes(tmp_path / "one.npz", one)
    assert not deformer.examine(one).usable
    status, out, _ = run("check", tmp_path / "one.npz")
    assert status == 1
    assert "error" in out
    status, out, _ = run("check", tmp_path / "one.npz", "--json")
    assert status == 1
    assert json.loads(out)["usable"] is False


def test_train_info_fit(run_json, run, model_path, tmp_path):
    facts = run_json("info", model_path)
    assert (facts["vertices"], facts["faces"], facts["components"]) == (226, 448, 4)
    assert facts["summary"]["interrupted"] is False
    assert not model_path.with_name("bar.checkpoint").exists()
    assert "226" in run("info", model_path)[1]

    handles = write_handles(tmp_path / "handles.json", [frame_of(3)])
    result = run_json("fit", model_path, handles, "-o", tmp_path / "pose.obj")
    model = deformer.load_model(model_path)
    mesh = deformer.load_mesh(tmp_path / "pose.obj")
    assert np.array_equal(mesh.faces, model.reference.faces)
    distances = [
        np.sqrt(((mesh.vertices[vertex] - p) ** 2).sum()) for vertex, p in frame_of(3).items()
    ]
    assert result["max_residual"] == pytest.approx(max(distances))
    assert result["residual_rms"] == pytest.approx(rms(distances))
    assert len(result["z"]) == 4
    assert result["iterations"] >= 1 and result["milliseconds"] > 0
    assert result["prior_distance"] >= 0

    exact = run_json("fit", model_path, handles, "-o", tmp_path / "pose.obj", "--hard")
    assert exact["max_residual"] < 1e-6


@pytest.mark.parametrize("output", ["poses.npz", "poses"])
@pytest.mark.parametrize("hard", [False, True], ids=["soft", "hard"])
def test_fit_of_a_sequence(run_json, model_path, tmp_path, output, hard):
    """Its frames have different handles; every record is of those of its own frame."""
    frames = [frame_of(1), frame_of(2), frame_of(2, (0, 225)), frame_of(2, (50, 225))]
    handles = write_handles(tmp_path / "frames.json", frames, sequence=True)
    options = ["--hard"] if hard else []
    result = run_json("fit", model_path, handles, "-o", tmp_path / output, *options)
    poses = deformer.load_shapes(tmp_path / output)
    assert poses.vertices.shape == (4, 226, 3)
    assert len(result["frames"]) == 4
    residuals = []
    for frame, vertices, record in zip(frames, poses.vertices, result["frames"], strict=True):
        apart = [np.sqrt(((vertices[v] - p) ** 2).sum()) for v, p in frame.items()]
        assert record["max_residual"] == pytest.approx(max(apart), abs=1e-6)
        assert record["residual_rms"] == pytest.approx(rms(apart), abs=1e-6)
        assert len(record["z"]) == 4 and record["prior_distance"] >= 0
        residuals += apart
    assert result["max_residual"] == pytest.approx(max(residuals), abs=1e-6)
    assert result["residual_rms"] == pytest.approx(rms(residuals), abs=1e-6)
    assert (result["max_residual"] < 1e-6) == hard
    assert result["iterations"] >= 1 and result["milliseconds"] > 0
    assert result["prior_distance"] == max(frame["prior_distance"] for frame in result["frames"])


def test_fit_of_a_sequence_passes_its_options_on(run_json, model_path, tmp_path):
    """What the command writes is what `fit_sequence` finds."""
    model = deformer.load_model(model_path)
    rng = np.random.default_rng(0)
    shapes = bending_bar().vertices[:8]
    vertices = np.array([0, 60, 100, 225])
    targets = shapes[:, vertices] + 0.05 * rng.normal(size=(8, 4, 3))
    weights = rng.uniform(0.5, 2, size=(8, 4)) * (rng.random((8, 4)) < 0.7)
    weights[:, 3] = 1
    frames = [
        [
            {"vertex": int(vertices[h]), "position": list(targets[f, h]), "weight": weights[f, h]}
            for h in reversed(range(4))
            if weights[f, h]
        ]
        for f in range(8)
    ]
    handles = tmp_path / "frames.json"
    handles.write_text(json.dumps({"frames": frames}))
    jitter = {}
    for smoothness in (0, 100):
        expected = deformer.fit_sequence(
            model, vertices, targets, weights=weights, smoothness=smoothness
        )
        for where in (["--device", "cpu"], ["--device", "auto"], ["--backend", "torch"]):
            options = ["--smoothness", smoothness, *where]
            result = run_json("fit", model_path, handles, "-o", tmp_path / "poses.npz", *options)
            found = deformer.load_shapes(tmp_path / "poses.npz").vertices
            assert abs(found - expected.vertices).max() < 1e-3
            assert result["frames"][3]["z"] == pytest.approx(expected.z[3].tolist(), abs=1e-3)
        jitter[smoothness] = (np.diff(expected.vertices, 2, axis=0) ** 2).mean()
    assert jitter[100] < 0.7 * jitter[0]


@pytest.mark.parametrize("sequence", [False, True], ids=["pose", "sequence"])
def test_fit_is_told_the_noise(run_json, model_path, tmp_path, sequence):
    """By the option or by the file; the option counts where both tell it."""
    model, noise = deformer.load_model(model_path), 0.2
    rng = np.random.default_rng(0)
    given = {v: p + noise * rng.normal(size=3) for v, p in frame_of(3).items()}
    handles = write_handles(tmp_path / "handles.json", [given] * (3 if sequence else 1), sequence)
    output = tmp_path / ("poses.npz" if sequence else "pose.obj")
    plain = run_json("fit", model_path, handles, "-o", output)
    said = run_json("fit", model_path, handles, "-o", output, "--noise", noise)
    used = deformer.target_noise(model, noise, sequence=sequence)
    vertices, targets = list(given), list(given.values())
    if sequence:
        expected = deformer.fit_sequence(model, vertices, [targets] * 3, noise=used).z[1]
    else:
        solver = deformer.HandleSolver(model, noise=used)
        solver.set_handles(vertices, targets)
        expected = solver.solve().z
    assert (said["frames"][1] if sequence else said)["z"] == pytest.approx(expected.tolist())
    assert said["max_residual"] > 1.05 * plain["max_residual"]

    file = json.loads(handles.read_text())
    handles.write_text(json.dumps({**file, "noise": noise}))
    assert run_json("fit", model_path, handles, "-o", output)["max_residual"] == pytest.approx(
        said["max_residual"]
    )
    handles.write_text(json.dumps({**file, "noise": 1e-6}))
    again = run_json("fit", model_path, handles, "-o", output, "--noise", noise)
    assert again["max_residual"] == pytest.approx(said["max_residual"])


def test_fit_bridges_markers_that_are_not_seen(run_json, model_path, tmp_path):
    """A null position, a missing handle and an empty frame are all those of weight 0."""
    vertices, shapes = [0, 60, 100, 225], bending_bar().vertices[:6]
    weights = np.ones((6, 4))
    weights[0], weights[2], weights[4, 1:3], weights[5, 0] = 0, 0, 0, 0
    frames = [
        [
            {"vertex": v, "position": list(shapes[f, v]) if weights[f, h] else None}
            for h, v in enumerate(vertices)
        ]
        for f in range(6)
    ]
    frames[2] = []
    del frames[4][1]
    handles = tmp_path / "frames.json"
    handles.write_text(json.dumps({"frames": frames}))
    result = run_json("fit", model_path, handles, "-o", tmp_path / "poses.npz")
    expected = deformer.fit_sequence(
        deformer.load_model(model_path), vertices, shapes[:, vertices], weights=weights
    )
    found = deformer.load_shapes(tmp_path / "poses.npz").vertices
    assert abs(found - expected.vertices).max() < 1e-6
    assert result["frames"][2]["max_residual"] is None
    assert result["max_residual"] == pytest.approx(np.nanmax(expected.residual))


@pytest.mark.parametrize("options", [[], ["--hard"]], ids=["soft", "exact"])
def test_fit_turns_handles(run_json, model_path, tmp_path, options):
    """What the file asks for is what the record says, of one pose and of every frame."""
    model, vertices = deformer.load_model(model_path), (0, 100, 225)
    shape = bending_bar().vertices[3]
    turns = deformer.local_rotations(model, vertices, shape)
    rows = [
        {"vertex": v, "position": list(shape[v]), "orientation": R.tolist()}
        for v, R in zip(vertices, turns, strict=True)
    ]
    del rows[1]["orientation"]
    handles, output = tmp_path / "handles.json", tmp_path / "pose.obj"
    handles.write_text(json.dumps({"handles": rows}))
    result = run_json("fit", model_path, handles, "-o", output, *options)
    found = deformer.local_rotations(model, vertices, deformer.load_mesh(output).vertices)
    cosines = (np.einsum("hab,hab->h", found, turns) - 1) / 2
    off = np.arccos(np.minimum(cosines, 1))[[0, 2]]
    assert result["max_orientation"] == pytest.approx(off.max(), abs=1e-4)
    assert result["orientation_rms"] == pytest.approx(rms(off), abs=1e-4)
    assert (result["max_orientation"] < 1e-7) == bool(options)
    bare = [{k: v for k, v in row.items() if k != "orientation"} for row in rows]
    handles.write_text(json.dumps({"frames": [rows, rows, bare]}))
    result = run_json("fit", model_path, handles, "-o", tmp_path / "poses.npz", *options)
    angles = [frame.get("max_orientation") for frame in result["frames"]]
    assert angles[2] is None and result["max_orientation"] == max(angles[:2])
    assert (max(angles[:2]) < 1e-7) == bool(options)


@pytest.mark.parametrize("name", ["frame_without_markers", "null_marker"])
def test_fit_reads_marker_files(run_json, model_path, tmp_path, name):
    handles = Path(__file__).parent / f"{name}.json"
    result = run_json("fit", model_path, handles, "-o", tmp_path / "poses.npz")
    assert len(result["frames"]) == len(json.loads(handles.read_text())["frames"])
    assert np.isfinite(deformer.load_shapes(tmp_path / "poses.npz").vertices).all()


def test_fit_warns_of_other_units(run, model_path, tmp_path):
    frame = frame_of(3, (0, 60, 100, 225))
    for factor, told in ((1.0, False), (1000.0, True)):
        scaled = {v: factor * np.array(p) for v, p in frame.items()}
        handles = write_handles(tmp_path / "handles.json", [scaled])
        options = ["-o", tmp_path / "pose.ply", "--json"]
        status, out, err = run("fit", model_path, handles, *options)
        warning = json.loads(out)["warning"]
        assert status == 0
        assert (warning is not None) == told
        if told:
            assert "millimetres" in warning and "scale them by 0.001" in warning
            assert err.splitlines().count(warning) == 1


def test_train_takes_a_split(run_json, run, shapes_path, tmp_path):
    split = {"train": [0, 1, 2, 3, 4, 5, 6], "test": [7, 8]}
    (tmp_path / "split.json").write_text(json.dumps(split))
    arguments = ["--components", 3, "--epochs", 2, "--split", tmp_path / "split.json"]
    result = run_json("train", shapes_path, "-o", tmp_path / "new" / "model", *arguments)
    assert result["split"] == {"train": 7, "test": 2}
    model = deformer.load_model(tmp_path / "new" / "model")
    assert model.split == split and model.components == 3


@pytest.mark.slow
def test_train_reports_progress_on_stderr_only(run, shapes_path, tmp_path):
    arguments = ["--components", 2, "--epochs", 3, "--json"]
    status, out, err = run("train", shapes_path, "-o", tmp_path / "model", *arguments)
    assert status == 0
    assert json.loads(out)["components"] == 2
    assert "3/3" in err and "sparsity" in err


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.skipif(CORES < 2, reason="one core compiles when it calls")
@pytest.mark.parametrize("moment", ["told", "one is kept"])
def test_ctrl_c_while_kernels_are_compiled_is_a_line(tmp_path, moment):
    handles = tmp_path / "handles.json"
    handles.write_text('{"handles": [{"vertex": 17, "position": [0.1, 0.5, 0.2]}]}')
    command = [*DEFORMER, "fit", "humanoid", str(handles), "-o", str(tmp_path / "pose.ply")]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    # A session of its own stands for a terminal, whose Ctrl-C reaches all its processes.
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    try:
        assert process.stderr is not None
        told = process.stderr.readline()
        if moment == "one is kept":  # the others take much longer
            kept = tmp_path / "kernels"
            wait_for(lambda: any(kept.rglob("*.nbc")) or process.poll() is not None)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=HANG)
    finally:
        process.kill()
    assert told.startswith("compiling for this processor")
    assert (process.returncode, err) == (130, "deformer: interrupted\n")
    assert not (tmp_path / "pose.ply").exists()
    wait_for(lambda: not alive(process.pid))


def alive(group):
    """True while a process of the group runs."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_an_interrupted_training_is_saved_and_resumed(shapes_path, tmp_path, run, refuse):
    model = tmp_path / "model"
    command = ["train", shapes_path, "-o", model, "--components", "4", "--epochs", "60"]
    process = subprocess.Popen([*DEFORMER, *map(str, command)], stderr=subprocess.PIPE, text=True)
    checkpoint = tmp_path / "model.checkpoint"
    try:
        assert process.stderr is not None
        while not process.stderr.readline().startswith("training 6/60"):
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=HANG)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "Interrupted: saved the best model so far" in err
    assert "--resume" in err
    assert deformer.load_model(model).summary["interrupted"] is True
    assert checkpoint.is_dir()

    status, _, err = run(*command, "--resume")
    assert status == 0, err
    epochs_told = [int(epoch) for epoch in re.findall(r"^training (\d+)/60", err, re.MULTILINE)]
    assert epochs_told[0] > 6 and epochs_told[-1] == 60
    assert not checkpoint.exists()
    summary = deformer.load_model(model).summary
    assert summary["interrupted"] is False
    assert summary["epochs"] == 60
    assert "has ended" in refuse(*command, "--resume")


def test_info_without_a_model_lists_the_shipped_ones(run, run_json):
    assert run_json("info") == {"shipped": list(deformer.shipped_models())}
    assert run("info")[0] == 0


@pytest.mark.slow
def test_demo_on_a_small_model(run_json, run, model_path, tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "FRAME_STRIDE", 20)
    monkeypatch.setattr(demo, "FRAME", (120, 160))
    result = run_json("demo", "--model", model_path, "-o", tmp_path / "out")
    assert result["frames"] == 101
    assert {handle["name"] for handle in result["handles"]} >= {"left toes", "head"}
    assert 0 < result["milliseconds"]["median"] <= result["milliseconds"]["p95"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        ".deformer.json",
        "drag.gif",
        "pose.ply",
        "sheet.png",
    ]
    pose = deformer.load_mesh(tmp_path / "out" / "pose.ply")
    assert pose.vertices.shape == (226, 3)


def test_mistakes_are_one_line(refuse, shapes_path, model_path, tmp_path):
    nowhere = tmp_path / "nowhere"
    broken = tmp_path / "broken.json"
    broken.write_text("{")
    good = write_handles(tmp_path / "good.json", [frame_of(1)])
    many = write_handles(tmp_path / "many.json", [frame_of(1)], sequence=True)
    far = write_handles(tmp_path / "far.json", [{226: (0, 0, 0)}])
    out = tmp_path / "pose.ply"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("keep me")

    assert "wrong" in refuse("wrong")
    assert "--wrong" in refuse("info", "--wrong")
    assert "SHAPES" in refuse("train")
    assert "--components" in refuse("train", shapes_path, "-o", out, "--components", "0")
    assert "--config" in refuse("train", shapes_path, "-o", out, "--config", "other")
    assert "nowhere" in refuse("check", nowhere)
    assert "nowhere" in refuse("info", nowhere)
    assert "nowhere" in refuse("fit", model_path, nowhere, "-o", out)
    assert "broken.json" in refuse("fit", model_path, broken, "-o", out)
    assert "226" in refuse("fit", model_path, far, "-o", out)
    assert ".stp" in refuse("fit", model_path, good, "-o", tmp_path / "pose.stp")
    assert "sequence" in refuse("fit", model_path, many, "-o", out)
    poses = tmp_path / "poses.npz"
    assert "--smoothness" in refuse("fit", model_path, many, "-o", poses, "--smoothness", "-1")
    assert "smoothness" in refuse("fit", model_path, many, "-o", poses, "--smoothness", "nan")
    for noise in ("0", "-1", "nan", "inf"):
        assert "--noise" in refuse("fit", model_path, good, "-o", out, "--noise", noise)
    both = refuse("fit", model_path, good, "-o", out, "--noise", "0.1", "--hard")
    assert "--noise: got it with --hard" in both
    assert "abacus" in refuse("fit", model_path, many, "-o", poses, "--device", "abacus")
    assert "numba, torch" in refuse("fit", model_path, many, "-o", poses, "--backend", "abacus")
    assert not poses.exists()
    assert "does not exist" in refuse("fit", model_path, good, "-o", nowhere / "pose.ply")
    assert "broken.json" in refuse("train", shapes_path, "-o", nowhere, "--split", broken)
    assert "good.json" in refuse("train", shapes_path, "-o", good)
    assert "full" in refuse("train", shapes_path, "-o", tmp_path / "full")
    assert "no checkpoint" in refuse("train", shapes_path, "-o", nowhere, "--resume")
    assert not nowhere.exists()
    assert (tmp_path / "full" / "letter.txt").read_text() == "keep me"


def test_training_stops_at_what_the_doctor_refuses(run, tmp_path):
    shapes = bending_bar()
    one = deformer.MeshSequence(shapes.vertices[:1], shapes.faces)
    deformer.save_shapes(tmp_path / "one.npz", one)
    status, out, err = run("train", tmp_path / "one.npz", "-o", tmp_path / "model")
    assert (status, out) == (2, "")
    assert "deformer check" in err.splitlines()[-1]
    assert not (tmp_path / "model").exists()


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch, shapes_path):
    def fail(*_):
        raise RuntimeError("a fault")

    monkeypatch.setattr(deformer, "load_model", fail)
    with pytest.raises(RuntimeError, match="a fault"):
        console.run(cli.app, ["info", str(shapes_path)])


def test_numbers_that_json_cannot_hold_become_null(capsys):
    console.emit({"a": float("nan"), "b": np.array([1.0, np.inf]), "c": Path("x"), "d": (1, True)})
    assert json.loads(capsys.readouterr().out) == {
        "a": None,
        "b": [1.0, None],
        "c": "x",
        "d": [1, True],
    }


@pytest.fixture
def session_path(model_path, tmp_path):
    from deformer_app.viewer.edit import Handle
    from deformer_app.viewer.session import ModelName, Session

    model = deformer.load_model(model_path)
    session = Session.begin(ModelName(str(model_path), model.fingerprint), model.codes[0])
    target = tuple(map(float, bending_bar().vertices[3][100]))
    handle = Handle(1, (100,), (target,), kind="exact")
    session.do("Place handle", session.edit.with_handles([handle]))
    session.save(tmp_path / "session.json")
    return tmp_path / "session.json"


def test_fit_of_a_session_is_its_pose(run_json, session_path, tmp_path):
    result = run_json("fit", "--session", session_path, "-o", tmp_path / "pose.ply")
    pose = deformer.load_mesh(tmp_path / "pose.ply").vertices
    target = bending_bar().vertices[3][100]
    assert pose[100] == pytest.approx(target, abs=1e-6)
    assert result["max_residual"] < 1e-6 and len(result["z"]) == 4


def test_fit_of_a_session_with_the_model_elsewhere(run_json, session_path, model_path, tmp_path):
    data = json.loads(session_path.read_text())
    data["model"]["path"] = "gone"
    session_path.write_text(json.dumps(data))
    run_json("fit", model_path, "--session", session_path, "-o", tmp_path / "pose.ply")


def test_mistakes_with_sessions(refuse, session_path, model_path, tmp_path):
    out = tmp_path / "pose.ply"
    assert "--session" in refuse("fit", "-o", out)
    noisy = refuse("fit", "--session", session_path, "-o", out, "--noise", "0.1")
    assert "--noise: got it with --session" in noisy
    assert "HANDLES" in refuse("fit", model_path, "-o", out)
    assert "another model" in refuse("fit", "humanoid", "--session", session_path, "-o", out)
    assert "both" in refuse("fit", model_path, session_path, "--session", session_path, "-o", out)
    assert "pose.npz" in refuse("fit", "--session", session_path, "-o", tmp_path / "pose.npz")
    gone = tmp_path / "gone.json"
    assert "gone.json" in refuse("fit", "--session", gone, "-o", out)
    assert "gone.json" in refuse("edit", "--session", gone)
    assert "no such model" in refuse("edit", tmp_path / "nowhere")
    assert "another model" in refuse("edit", "humanoid", "--session", session_path)
    assert not out.exists()
