"""Evaluation: splits, no leak of test shapes, resuming, parallel runs, protocols, presets."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import deformer
import parallel_tasks
from bars import bending_bar
from deformer import InputError, MeshSequence
from deformer.baselines import METHODS
from deformer.evaluation import plan as plan_module
from deformer.evaluation.journal import COLUMNS, FAILURE, Journal
from deformer.evaluation.methods import Setting
from deformer.evaluation.plan import Study, make_plan
from deformer.evaluation.presets import QUICK, paper_sources, paper_studies
from deformer.evaluation.protocols import errors_by_rotation, largest_rotations, sparse_control
from deformer.evaluation.runner import evaluate
from deformer.evaluation.sources import Reading, Source, load_split
from deformer.evaluation.splits import Split, limit_test_shapes, random_split, sequence_split
from deformer.evaluation.summary import summarise
from deformer.network.config import PRESETS
from shapes import random_rotation, tube, twist
from waiting import wait_for


class TinyPCA:
    """A method small enough to reason about: principal components, least squares."""

    name = "tiny"
    space = "vertices"

    def fit(self, shapes, components, seed=0):
        flat = shapes.vertices.reshape(len(shapes), -1)
        self.mean = flat.mean(0)
        self.basis = np.linalg.svd(flat - self.mean, full_matrices=False)[2][:components]
        return self

    def encode(self, vertices):
        return (np.reshape(vertices, (len(vertices), -1)) - self.mean) @ self.basis.T

    fit_codes = encode

    def decode(self, codes):
        return (codes @ self.basis + self.mean).reshape(len(codes), -1, 3)

    def fit_handles(self, vertices, targets, noise=0.0):
        rows = (3 * np.asarray(vertices)[:, None] + np.arange(3)).ravel()
        code = np.linalg.lstsq(self.basis[:, rows].T, np.ravel(targets) - self.mean[rows])[0]
        return self.decode(code[None])[0]


@pytest.fixture
def tiny(monkeypatch):
    monkeypatch.setitem(METHODS, "tiny", TinyPCA)


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "bar.npz"
    deformer.save_shapes(path, bending_bar(count=24))
    return str(path)


@pytest.fixture
def source(bar):
    return Source.at("bar", bar)


def study(source, *methods, **options):
    defaults = {"components": (2, 4), "at": 4, "counts": (5, 9), "epochs": 3, "tests": 4}
    return Study(source, methods, **(defaults | options))


def values(rows):
    """What must not depend on how a run went."""
    return [{**row} for row in rows if row["metric"] != "seconds"]


def test_splits_of_the_paper():
    scape = random_split(71, 0)
    assert (len(scape.train), len(scape.test)) == (36, 35)
    assert sorted(scape.train + scape.test) == list(range(71))
    swing = sequence_split(150, 0)
    assert (len(swing.train), len(swing.test)) == (15, 135)
    assert [index // 10 for index in swing.train] == list(range(15))
    assert random_split(71, 0) == scape != random_split(71, 1)
    assert sequence_split(150, 3) != swing
    assert sequence_split(48, 0).train[-1] >= 40


def test_every_split_trains_on_the_reference_that_is_named(bar, tmp_path):
    plain = Source.at("bar", bar)
    source = Source.at("bar", bar, reading=Reading(reference="20"))
    assert source.reference == 20 and source.fingerprint != plain.fingerprint
    shapes = deformer.load_shapes(bar)
    for split in study(source, "pca", splits=6).drawn_splits():
        assert 20 in split.train and 20 not in split.test
        data = load_split(source, split, split.test)
        np.testing.assert_array_equal(data.reference.vertices, shapes.vertices[20])
        np.testing.assert_array_equal(data.train.vertices[0], shapes.vertices[20])
        assert len(data.train) == len(split.train)
    given = (Split((1, 2, 3), (20, 21)),)
    (split,) = study(source, "pca", splits=given).drawn_splits()
    assert split == Split((1, 2, 3, 20), (21,))
    deformer.save_mesh(tmp_path / "rest.ply", shapes.mesh(5))
    source = Source.at("bar", bar, reading=Reading(reference=str(tmp_path / "rest.ply")))
    assert (source.count, source.reference) == (25, 0)


def test_a_split_keeps_its_parts_apart():
    with pytest.raises(InputError, match="shape 3 is to train and to test on"):
        Split((1, 2, 3), (3, 4))
    with pytest.raises(InputError, match="got 1 shapes to train"):
        Split((1,), (2,))


def test_fewer_test_shapes_of_a_sequence_follow_each_other():
    assert limit_test_shapes(tuple(range(10, 20)), 4, ordered=True) == (13, 14, 15, 16)
    assert limit_test_shapes(tuple(range(10)), 4, ordered=False) == (0, 3, 6, 9)
    assert limit_test_shapes((1, 2), 5, ordered=False) == (1, 2)


def test_epochs_only_make_trainings_shorter(source, tiny):
    """The default's rounds are fewer than the steps of Adam that a quick look allows."""
    methods = "autoencoder", "autoencoder-paper", "linear-components", "tiny"

    def epochs(limit):
        jobs = make_plan([study(source, *methods, epochs=limit, components=(4,), pictures=False)])
        return {job.training.method: job.training.setting.epochs for job in jobs}

    rounds, steps = (PRESETS[name].training.epochs for name in ("default", "paper"))
    assert rounds < QUICK["epochs"] < steps
    assert epochs(None) == dict.fromkeys(methods)
    assert epochs(7) == {**dict.fromkeys(methods[:3], 7), "tiny": None}
    assert epochs(QUICK["epochs"]) == {
        "autoencoder": None,
        "autoencoder-paper": QUICK["epochs"],
        "linear-components": QUICK["epochs"],
        "tiny": None,
    }
    # What is not made shorter is the same training, and its measurements are not computed again.
    assert epochs(steps) == epochs(steps + 1) == epochs(None)


class Spy(TinyPCA):
    """Remembers what it was shown."""

    name = "spy"

    trained: ClassVar[list] = []
    targets: ClassVar[list] = []

    def fit(self, shapes, components, seed=0):
        Spy.trained.append(shapes.vertices.copy())
        return super().fit(shapes, components, seed)

    def fit_handles(self, vertices, targets, noise=0.0):
        Spy.targets.append(np.array(targets))
        return super().fit_handles(vertices, targets, noise)


@pytest.mark.parametrize("align", [False, True])
@pytest.mark.parametrize("ordered", [False, True])
def test_no_test_shape_reaches_a_method(tmp_path, monkeypatch, align, ordered):
    """Whatever the test shapes are, training sees the same bytes; handles are all that is told."""
    monkeypatch.setitem(METHODS, "spy", Spy)
    shapes = bending_bar(count=24)
    split = (sequence_split if ordered else random_split)(24, 0)
    seen = []
    for number, scale in enumerate((1.0, 40.0)):
        vertices = shapes.vertices.copy()
        vertices[list(split.test)] = scale * vertices[list(split.test)] + (scale - 1)
        path = tmp_path / f"{number}.npz"
        deformer.save_shapes(path, MeshSequence(vertices, shapes.faces))
        chosen = Source.at("bar", str(path), align=align, ordered=ordered)
        protocols = ("reconstruction", "sparse_control", "noise", "rotation")
        Spy.trained, Spy.targets = [], []
        rows = evaluate([study(chosen, "spy", protocols=protocols)], tmp_path / f"out{number}")
        assert not any(row["metric"] == FAILURE for row in rows)
        assert {len(target) for target in Spy.targets} == {5, 9, plan_module.EXAMPLE_COUNT}
        seen.append(Spy.trained)
    # Two numbers of components, and three levels of noise.
    assert [len(train) for train in seen[0]] == 5 * [len(split.train)]
    for first, second in zip(*seen, strict=True):
        np.testing.assert_array_equal(first, second)


def test_each_training_sees_its_split_and_its_noise(source):
    split = random_split(24, 0)
    clean = load_split(source, split, split.test)
    np.testing.assert_array_equal(clean.train.vertices, bending_bar(24).vertices[list(split.train)])
    np.testing.assert_array_equal(clean.test, bending_bar(24).vertices[list(split.test)])
    noisy = load_split(source, split, split.test, noise=0.01, seed=3)
    added = noisy.train.vertices - clean.train.vertices
    assert added.std() == pytest.approx(0.01 * clean.reference.bounding_diagonal, rel=0.05)
    np.testing.assert_array_equal(noisy.test, clean.test)
    np.testing.assert_array_equal(noisy.reference.vertices, clean.reference.vertices)


def test_aligning_takes_rigid_motions_away_and_nothing_else(tmp_path):
    shapes, rng = bending_bar(count=10), np.random.default_rng(0)
    moved = [p @ random_rotation(rng).T + rng.normal(size=3) for p in shapes.vertices]
    path = tmp_path / "moved.npz"
    deformer.save_shapes(path, MeshSequence(np.stack(moved), shapes.faces))
    split = Split((0, 1, 2, 3), (4, 5))
    source = Source.at("moved", str(path), align=True)
    data = load_split(source, split, split.test)
    for pose, index in zip(data.test, split.test, strict=True):
        assert deformer.e_rms(shapes.vertices[index], pose, "rigid") < 1e-6
        # Already as close to the reference as a rigid motion brings it.
        best = deformer.e_rms(data.reference.vertices, pose, "rigid")
        assert deformer.e_rms(data.reference.vertices, pose, "none") == pytest.approx(best)


def test_rows_have_the_contract_and_agree_with_a_direct_computation(tmp_path, source, tiny):
    rows = evaluate([study(source, "tiny", tests=None)], tmp_path)
    assert json.loads((tmp_path / "results.json").read_text()) == rows
    assert (tmp_path / "results.csv").read_text().splitlines()[0] == ",".join(COLUMNS)
    assert all(tuple(row) == COLUMNS for row in rows)
    found = {
        (row["protocol"], row["count"], row["metric"]): row["value"]
        for row in rows
        if row["method"] == "tiny"
    }
    split, shapes = random_split(24, 0), bending_bar(24)
    truth = shapes.vertices[list(split.test)]
    for K in (2, 4):
        method = TinyPCA().fit(shapes.subset(split.train), K)
        estimate = method.decode(method.encode(truth))
        for run in ("encoder", "fit"):
            key = f"reconstruction/{run}", K
            assert found[*key, "E_rms"] == pytest.approx(deformer.e_rms(truth, estimate))
            rigid = deformer.e_rms(truth, estimate, "rigid")
            assert found[*key, "E_rms_rigid"] == pytest.approx(rigid)
    assert found["sparse_control", 5, "shapes"] == len(truth)
    assert "STED" not in {metric for _, _, metric in found}
    assert sum(found[p, c, m] for p, c, m in found if p == "rotation/fit" and m == "shapes") == 12


def test_motion_is_measured_where_shapes_are_in_order(tmp_path, bar, tiny):
    rows = evaluate([study(Source.at("bar", bar, ordered=True), "tiny")], tmp_path)
    metrics = {(row["protocol"], row["metric"]) for row in rows}
    for protocol in ("reconstruction/encoder", "reconstruction/fit", "sparse_control"):
        assert {(protocol, "STED"), (protocol, "STED_temporal")} <= metrics


@pytest.mark.slow
def test_the_same_again_computes_nothing_and_gives_the_same(tmp_path, source, monkeypatch, tiny):
    methods, protocols = ("tiny", "autoencoder", "arap"), ("sparse_control",)
    chosen = study(source, *methods, components=(4,), protocols=protocols)
    first = evaluate([chosen], tmp_path / "a")
    again = evaluate([chosen], tmp_path / "b")
    for one, other in zip(values(first), values(again), strict=True):
        assert one == {**other, "value": pytest.approx(other["value"], rel=1e-4)}
    monkeypatch.setattr(TinyPCA, "fit", lambda *_: pytest.fail("trained again"))
    assert evaluate([chosen], tmp_path / "a") == first


@pytest.mark.slow
def test_parallel_equals_serial(tmp_path, source):
    methods = "autoencoder", "arap", "biharmonic-nearest"
    chosen = study(source, *methods, tests=2, components=(4,), counts=(5,))
    told = []
    serial = evaluate([chosen], tmp_path / "serial")
    parallel = evaluate([chosen], tmp_path / "parallel", 2, lambda *event: told.append(event))
    assert [event[0] for event in told] == list(range(told[0][1] + 1))
    assert {row["method"] for row in serial} == set(methods)
    for one, other in zip(values(serial), values(parallel), strict=True):
        # Compiled kernels may round differently where they were compiled and where they are kept.
        assert one == {**other, "value": pytest.approx(other["value"], rel=1e-4)}


@pytest.mark.slow
def test_a_process_that_dies_fails_what_is_left_of_its_own_job(tmp_path, source, monkeypatch):
    monkeypatch.setattr("deformer.evaluation.runner.run_job", parallel_tasks.measure_or_die)
    asked = study(source, "arap", "biharmonic", protocols=("sparse_control",), pictures=False)
    rows = evaluate([asked], tmp_path, 2)
    failures = [row for row in rows if row["metric"] == FAILURE]
    assert {row["method"] for row in failures} == {"arap"}
    assert {row["value"] for row in failures} == {"the process ended; out of memory?"}
    measured = {row["protocol"] for row in rows if row["method"] == "arap"}
    assert {row["protocol"] for row in failures} == {"sparse_control"} < measured
    assert json.loads((tmp_path / "results.json").read_text()) == rows


KILLED = {
    "protocols": ("sparse_control",),
    "components": (3,),
    "at": 3,
    "seeds": 2,
    "tests": 3,
}
RUN = f"""
import sys
from pathlib import Path
from deformer.evaluation import Source, Study, evaluate
if __name__ == "__main__":
    source = Source.at("bar", sys.argv[1])
    study = Study(source, ("autoencoder", "arap"), counts=(5, 9), epochs=3, **{KILLED})
    evaluate([study], Path(sys.argv[2]), int(sys.argv[3]), lambda d, t, _: print(d, t, flush=True))
"""


@pytest.fixture(scope="module")
def whole_run(bar, tmp_path_factory):
    """Rows of the run that another test kills, had it not been."""
    source = Source.at("bar", bar)
    rows = evaluate([study(source, "autoencoder", "arap", **KILLED)], tmp_path_factory.mktemp("a"))
    return values(rows)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("processes", [1, 2])
def test_a_killed_run_goes_on_where_it_stopped(tmp_path, bar, source, whole_run, processes):
    script = tmp_path / "run.py"
    script.write_text(RUN)
    run = subprocess.Popen(
        [sys.executable, str(script), bar, str(tmp_path), str(processes)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert run.stdout is not None
    for line in run.stdout:
        if int(line.split()[0]) >= 4:
            break
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    wait_for(lambda: not _alive(run.pid), pause=0.1)  # workers end with their parent
    kept = len((tmp_path / "journal.jsonl").read_bytes().splitlines())
    told = []
    rows = evaluate(
        [study(source, "autoencoder", "arap", **KILLED)],
        tmp_path,
        report=lambda done, total, _: told.append((done, total)),
    )
    assert told[0][0] == kept >= 4, "began anew"
    assert told[-1][0] == told[-1][1] > kept, "nothing was left to do"
    for one, other in zip(values(rows), whole_run, strict=True):
        assert one == {**other, "value": pytest.approx(other["value"], rel=1e-4)}


def _alive(group):
    """Whether a process of the session is left that is no zombie."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            fields = (process / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if int(fields[3]) == group and fields[0] != "Z":
            return True
    return False


def result_row(**changes):
    texts = dict.fromkeys(COLUMNS, "x")
    return {**texts, "count": 5, "seed": 0, "value": 0.5, **changes}


@pytest.mark.parametrize(
    "change",
    [
        *({"count": 1.5}, {"count": True}, {"seed": -1}, {"value": None}, {"value": [1]}),
        *({"method": 3}, {"value": 10**400}, {"metric": "failure", "value": 1.0}, {"more": 1}),
    ],
)
def test_rows_of_a_journal_are_checked(tmp_path, change):
    path = tmp_path / "journal.jsonl"
    Journal(path).add("first", [result_row(), result_row(value="why", metric="failure")])
    assert len(Journal(path)["first"]) == 2
    path.write_text(json.dumps({"key": "a", "rows": [result_row(**change)]}) + "\n")
    with pytest.raises(InputError, match=r"journal\.jsonl, line 1: rows\[0\]"):
        Journal(path)


def test_a_line_that_a_crash_cut_off_is_dropped(tmp_path):
    row = result_row()
    path = tmp_path / "journal.jsonl"
    Journal(path).add("first", [row])
    with path.open("ab") as file:
        file.write(b'{"key": "second", "ro')
    again = Journal(path)
    assert "first" in again and "second" not in again
    again.add("third", [row])
    assert "third" in Journal(path)
    (tmp_path / "notes.txt").write_text("not\na journal\n")
    with pytest.raises(InputError, match="line 1"):
        Journal(tmp_path / "notes.txt")


class Broken(TinyPCA):
    name = "broken"

    def decode(self, codes):
        raise ValueError("out of\ncomponents")


class Untrainable(TinyPCA):
    name = "untrainable"

    def fit(self, shapes, components, seed=0):
        raise RuntimeError("no convergence")


def test_what_fails_is_a_row_with_its_reason(tmp_path, source, monkeypatch, tiny):
    monkeypatch.setitem(METHODS, "broken", Broken)
    monkeypatch.setitem(METHODS, "untrainable", Untrainable)
    rows = evaluate([study(source, "broken", "untrainable", "tiny", components=(4,))], tmp_path)
    failures = [row for row in rows if row["metric"] == FAILURE]
    assert {row["method"] for row in failures} == {"broken", "untrainable"}
    reasons = {row["method"]: row["value"] for row in failures if "encoder" in row["protocol"]}
    assert reasons["broken"] == "ValueError: out of components"
    assert {r["value"] for r in failures if r["method"] == "untrainable"} == {
        "RuntimeError: no convergence"
    }
    # Tried again, and this time well: a failure is not what a measurement ends with.
    monkeypatch.setitem(METHODS, "broken", type("Mended", (TinyPCA,), {"name": "broken"}))
    rows = evaluate([study(source, "broken", "untrainable", "tiny", components=(4,))], tmp_path)
    assert {row["method"] for row in rows if row["metric"] == FAILURE} == {"untrainable"}


def test_a_method_is_told_the_noise_of_its_control_points(source, tmp_path, monkeypatch):
    """In the data's units; it is the deviation of what was added to the true positions."""
    told = {}

    class Told(TinyPCA):
        name = "told"

        def fit_handles(self, vertices, targets, noise=0.0):
            told.setdefault(noise, []).append(np.array(targets))
            return super().fit_handles(vertices, targets, noise)

    monkeypatch.setitem(METHODS, "told", Told)
    one = study(source, "told", protocols=("noise",), counts=(40,), pictures=False)
    evaluate([one], tmp_path)
    split = random_split(source.count, 0)
    test = limit_test_shapes(split.test, one.tests, source.ordered)
    data = load_split(source, split, test, 0.0, 0)
    diagonal = data.reference.bounding_diagonal
    assert sorted(told) == pytest.approx([0.0, *(diagonal * n for n in plan_module.NOISE)])
    exact = data.test[:, data.control_vertices(40, 0)]
    for noise in sorted(told)[1:]:
        assert (np.stack(told[noise]) - exact).std() == pytest.approx(noise, rel=0.1)


def test_failures_on_single_shapes_are_counted():
    shapes, calls = bending_bar(6), []

    class Moody(TinyPCA):
        def fit_handles(self, vertices, targets, noise=0.0):
            calls.append(1)
            if len(calls) == 2:
                return np.full((226, 3), np.nan)
            if len(calls) == 4:
                raise ValueError("too hard")
            return super().fit_handles(vertices, targets, noise)

    method = Moody().fit(shapes, 5)
    vertices = np.array([0, 50, 100, 150, 225])
    errors = sparse_control(method, shapes.vertices, vertices, shapes.faces)
    assert (errors["failures"], errors["shapes"]) == (2, 6)
    assert errors["E_rms"] < 1e-6
    method.fit_handles = lambda *_: 1 / 0
    with pytest.raises(InputError, match="all 6 shapes: ZeroDivisionError"):
        sparse_control(method, shapes.vertices, vertices, shapes.faces)


def test_rotations_are_those_that_were_made():
    mesh, rng = tube(), np.random.default_rng(0)
    turns = [40.0, 100.0, 250.0]
    poses = np.stack(
        [
            twist(mesh.vertices - [1, 0, 0], np.radians(angle)) @ random_rotation(rng).T
            for angle in turns
        ]
    )
    # Aligned as a whole, each end is turned by half of the twist.
    found = largest_rotations(mesh, poses)
    np.testing.assert_allclose(found, np.array(turns) / 2, rtol=0.12)
    estimate = poses + np.array([1.0, 2.0, 3.0])[:, None, None] * np.sign(poses)
    classes = errors_by_rotation(found, poses, estimate)
    assert {bound: errors["shapes"] for bound, errors in classes.items()} == {30: 1, 60: 1, 150: 1}
    assert classes[60]["E_rms"] == pytest.approx(deformer.e_rms(poses[1], estimate[1]))


def test_a_training_serves_all_protocols_that_need_it(source, tiny):
    every = study(source, "tiny", "arap", protocols=plan_module.PROTOCOLS, splits=2, seeds=3)
    jobs = make_plan([every, every])
    trainings = [job.training for job in jobs]
    assert len(set(trainings)) == len(trainings)
    # K = 2, K = 4 and three levels of noise; a method without components has no K.
    assert [t.method for t in trainings].count("tiny") == 2 * 5
    assert [t.method for t in trainings].count("arap") == 2 * 4
    keys = [measurement.key(job.training) for job in jobs for measurement in job.measurements]
    assert len(set(keys)) == len(keys)
    control = [
        (job.training.number, measurement.seed)
        for job in jobs
        for measurement in job.measurements
        if measurement.kind == "sparse_control" and not measurement.noise and not job.training.noise
    ]
    assert set(control) == {(0, 0), (0, 2), (0, 4), (1, 1), (1, 3), (1, 5)}


def test_keys_tell_apart_what_gives_other_rows(source, tiny):
    def keys(**options):
        jobs = make_plan([study(options.pop("source", source), "tiny", **options)])
        return {measurement.key(job.training) for job in jobs for measurement in job.measurements}

    before = keys()
    assert keys() == before
    assert keys(counts=(5, 9, 12)) > before
    assert not keys(source=replace(source, fingerprint="changed")) & before
    assert not keys(source=replace(source, align=True)) & before
    assert len(keys(tests=5) & before) == 2, "only trainings stay"


def test_laid_out_points_are_those_of_the_splits_own_model(tmp_path, source, tiny):
    """Every method gets the same points; they come from a network that saw the training shapes."""
    asked = study(source, "autoencoder", "tiny", protocols=("layout",), counts=(5,), pictures=False)
    rows = evaluate([asked], tmp_path)
    assert not [row for row in rows if row["metric"] == FAILURE]
    named = {
        (row["method"], row["protocol"]): row["value"] for row in rows if row["metric"] == "E_rms"
    }
    (folder,) = (tmp_path / "models").glob("*/model.json")
    model = deformer.load_model(folder.parent)
    vertices = deformer.layout(model, 5).vertices
    split = asked.drawn_splits()[0]
    assert model.summary["train"] == len(split.train)
    data = load_split(source, split, limit_test_shapes(split.test, 4, False))
    method = TinyPCA().fit(data.train, 4)
    expected = sparse_control(method, data.test, vertices, data.train.faces)["E_rms"]
    assert named["tiny", "layout/sparse_control"] == pytest.approx(expected)
    voronoi = data.control_vertices(5, 0)
    expected = sparse_control(method, data.test, voronoi, data.train.faces)["E_rms"]
    assert named["tiny", "sparse_control"] == pytest.approx(expected)
    assert ("autoencoder", "layout/sparse_control") in named


def test_points_of_a_layout_file_are_used_as_they_are(source, tiny):
    asked = study(source, "tiny", protocols=("layout",), layout=(3, 1, 7), pictures=False)
    (job,) = make_plan([asked])
    chosen = [m for m in job.measurements if m.layout is not None]
    assert [(m.layout, m.count) for m in chosen] == [((3, 1, 7), 3)]
    assert [m.count for m in job.measurements if m.kind == "sparse_control"] == [3, 3]
    other = replace(chosen[0], layout=(3, 1, 8))
    assert other.key(job.training) != chosen[0].key(job.training)


def test_a_network_that_lays_out_points_is_trained_by_one_worker_at_a_time(source, tiny):
    asked = study(source, "autoencoder", "tiny", protocols=("layout",))
    network, tiny_job = make_plan([asked])
    assert network.networks == tiny_job.networks == {network.training.network}
    assert not replace(tiny_job, measurements=tiny_job.measurements[:1]).networks


def test_sensitivity_is_asked_of_the_papers_network_alone(source, tiny):
    chosen = study(source, "tiny", "autoencoder", "autoencoder-paper", protocols=("sensitivity",))
    jobs = make_plan([chosen])
    tried = [job.training for job in jobs if job.training.method == "autoencoder-paper"]
    assert {t.setting.lambdas for t in tried} == {None, *plan_module.LAMBDAS}


def test_mistakes_are_refused_before_anything_runs(source):
    for options, message in [
        ({"methods": ("nobody",)}, "methods: got 'nobody'"),
        ({"methods": ("model",)}, "methods: got 'model'"),
        ({"protocols": ("all",)}, "protocols: got 'all'"),
        ({"methods": ()}, "methods: got none"),
        ({"counts": (0, 5)}, "counts: expected"),
    ]:
        with pytest.raises(InputError, match=message):
            Study(**({"source": source, "methods": ("arap",)} | options))


@pytest.mark.slow
def test_a_trained_model_is_measured_as_it_is(tmp_path, source):
    split = random_split(24, 0)
    model = deformer.train(
        bending_bar(24), 3, epochs=2, split={"train": list(split.train), "test": list(split.test)}
    )
    model.save(tmp_path / "model")
    setting = Setting.of_model(str(tmp_path / "model"))
    options = {"components": (3,), "at": 3, "splits": (split,), "tests": None}
    rows = evaluate([study(source, "model", "arap", model=setting, **options)], tmp_path / "out")
    truth = bending_bar(24).vertices[list(split.test)]
    expected = deformer.e_rms(truth, model.decode(model.encode(truth)))
    found = [
        row["value"]
        for row in rows
        if (row["method"], row["protocol"], row["metric"])
        == ("model", "reconstruction/encoder", "E_rms")
    ]
    assert found == [pytest.approx(expected, rel=1e-5)]


def test_summaries_over_seeds():
    def row(method, count, seed, metric, value):
        place = ("set", method, "sparse_control", count, seed, metric, value)
        return dict(zip(COLUMNS, place, strict=True))

    rows = [row("a", 5, seed, "E_rms", value) for seed, value in enumerate((1.0, 2.0, 6.0))]
    rows += [row("a", 5, 0, "failures", 2), row("a", 5, 0, "shapes", 9)]
    rows += [row("a", 5, 3, FAILURE, "why"), row("b", 5, 0, FAILURE, "why")]
    tables = summarise(rows)
    assert list(tables) == [("set", "sparse_control", "E_rms")]
    a, b = (tables["set", "sparse_control", "E_rms"].cells[name][5] for name in "ab")
    assert (a.mean, a.spread) == (3.0, pytest.approx(7**0.5))
    assert (a.failed, a.lost, a.shapes) == (1, 2, 9)
    assert (b.values, b.failed) == ((), 1)


def test_paper_preset_plans_what_the_paper_shows(tmp_path, tiny):
    for name, count in [
        ("crane", 30),
        ("horse-gallop", 48),
        ("ict-expressions", 56),
        ("humanoid", 60),
    ]:
        deformer.save_shapes(tmp_path / f"{name}.npz", bending_bar(count, rings=4, side=2))
    deformer.save_shapes(tmp_path / "scape-obj", bending_bar(71, rings=4, side=2), format="obj")
    sources = {source.name: source for source in paper_sources(tmp_path)}
    assert list(sources) == ["scape", "crane", "horse", "face", "humanoid"]
    assert sources["crane"].align and sources["crane"].ordered and not sources["scape"].ordered
    jobs = make_plan(paper_studies(list(sources.values())))
    measurements = [(job.training, measurement) for job in jobs for measurement in job.measurements]

    def counts(name, method, kind):
        return {
            measurement.count
            for training, measurement in measurements
            if (training.source.name, training.method, measurement.kind) == (name, method, kind)
            and not training.noise
        }

    for method in ("tiny", "autoencoder", "autoencoder-paper"):
        for name in sources:
            assert 50 in counts(name, method, "reconstruction"), "moreevaluation"
        for name in ("scape", "crane"):
            assert {10, 30, 50} <= counts(name, method, "reconstruction"), "gerror"
            assert {5, 20, 80} <= counts(name, method, "sparse_control"), "sparse_control"
    assert {5, 20, 80} <= counts("scape", "arap", "sparse_control")
    lambdas = {
        training.setting.lambdas for training, _ in measurements if training.source.name == "scape"
    }
    assert lambdas == {None, *plan_module.LAMBDAS}, "diff_lambda"
    for training, measurement in measurements:
        assert not set(training.split.train) & set(measurement.test)
        share = len(training.split.train) / training.source.count
        assert share == pytest.approx(36 / 71 if training.source.name == "scape" else 0.1, abs=0.01)
    rows_of = [
        (t.source.name, t.method, measurement.protocol(t), measurement.count, measurement.seed)
        for t, measurement in measurements
    ]
    assert len(set(rows_of)) == len(rows_of), "two measurements would give the same rows"


def test_paper_preset_needs_data(tmp_path):
    with pytest.raises(InputError, match="holds none of scape-obj"):
        paper_sources(tmp_path)
