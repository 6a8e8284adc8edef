"""A cluster of two workers on this machine: the same as without, also when a worker dies."""

import os
import signal
from importlib import metadata

import numpy as np
import pytest

pytest.importorskip("distributed", reason="needs Dask: pip install distributed")

import deformer
import parallel_tasks as tasks
from bars import bending_bar
from deformer import InputError
from deformer.evaluation import FAILURE, Source, Study, evaluate
from deformer.parallel import Done, Failed, Part, WorkerLost, executor_of, results
from deformer.parallel.versions import differences, versions
from deformer.training import site_tiles
from waiting import wait_for

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    """Two workers, which all tests of this module connect to as users do: by an address."""
    import dask.config
    import distributed

    settings = {
        # A task is given up after two workers, and not after four, which would take longer.
        "distributed.scheduler.allowed-failures": 1,
        # No worker is given up, however long the next one takes to start.
        "distributed.deploy.lost-worker-timeout": "1 day",
    }
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit=0, dashboard_address="127.0.0.1:0"
        ) as made,
    ):
        yield made


def watched(cluster):
    """Processes of all workers, once their nannies have seen them start: see `wait_for_nanny`."""
    nannies = cluster.workers.values()
    wait_for(lambda: all(n.process and n.process.status.name == "running" for n in nannies))
    return [nanny.pid for nanny in nannies]


def outcomes(executor):
    parts, ends = {}, {}
    for event in executor.as_completed():
        if isinstance(event, Part):
            parts.setdefault(event.task, []).append(event.value)
        else:
            ends[event.task] = event
    return {task: (parts.get(task, []), end) for task, end in ends.items()}


def test_tasks_run_on_workers(cluster, tmp_path):
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    with executor_of(cluster=cluster.scheduler_address) as executor:
        counted = executor.submit(tasks.count, 4)
        bad = executor.submit(tasks.refuse, "no such thing")
        pair = executor.submit(tasks.meet, a, b), executor.submit(tasks.meet, b, a)
        shared = executor.share(np.arange(5.0))
        summed = [executor.submit(tasks.total, shared, n) for n in (1, 2)]
        found = outcomes(executor)
    assert found[counted] == ([[0], [1], [2], [3]], Done(counted, 6))
    assert isinstance(found[bad][1].error, InputError)
    assert str(found[bad][1].error) == "no such thing"
    workers = {found[task][1].result for task in pair}
    assert len(workers) == 2 and os.getpid() not in workers
    assert [found[task][1].result for task in summed] == [10.0, 20.0]


def test_a_worker_that_dies_is_survived(cluster, tmp_path):
    """The task that it ran is run again, and each part of it comes once."""
    died = tmp_path / "died"
    with executor_of(cluster=cluster.scheduler_address) as executor:
        task = executor.submit(tasks.die_once, 5, str(died))
        others = [executor.submit(tasks.count, 3) for _ in range(3)]
        found = outcomes(executor)
    assert died.exists()
    assert found[task] == ([[0], [1], [2], [3], [4]], Done(task, 10))
    assert all(found[other][1].result == 3 for other in others)


def test_a_task_that_kills_every_worker_fails_alone(cluster):
    with executor_of(cluster=cluster.scheduler_address) as executor:
        bad, good = executor.submit(tasks.die_on_worker, 1), executor.submit(tasks.count, 3)
        found = outcomes(executor)
    end = found[bad][1]
    assert isinstance(end, Failed) and isinstance(end.error, WorkerLost)
    assert "workers ended" in str(end.error)
    assert found[good][1].result == 3


def test_workers_elsewhere_end_what_nobody_waits_for(cluster, tmp_path):
    ended = tmp_path / "ended"
    with (
        pytest.raises(KeyboardInterrupt),
        executor_of(cluster=cluster.scheduler_address) as executor,
    ):
        executor.submit(tasks.tick, str(ended))
        for _ in executor.as_completed():
            raise KeyboardInterrupt
    wait_for(ended.exists)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "bar.npz"
    deformer.save_shapes(path, bending_bar(count=24))
    return Study(
        Source.at("bar", str(path)),
        ("autoencoder", "pca", "arap"),
        ("sparse_control", "layout"),
        at=3,
        counts=(5,),
        epochs=2,
        tests=2,
    )


@pytest.fixture(scope="module")
def alone(study, tmp_path_factory):
    """Rows and directory of an evaluation in this process."""
    folder = tmp_path_factory.mktemp("alone")
    return evaluate([study], folder), folder


def same(rows, expected):
    for one, other in zip(rows, expected, strict=True):
        if one["metric"] != "seconds":
            assert one == {**other, "value": pytest.approx(other["value"], rel=1e-6)}


def test_an_evaluation_gives_the_same_when_a_worker_dies(cluster, study, alone, tmp_path):
    expected, folder = alone
    killed, told = [], []

    def report(done, total, text):
        told.append((done, total))
        if done == 2 and not killed:
            killed.append(watched(cluster)[0])
            os.kill(killed[0], signal.SIGKILL)

    rows = evaluate([study], tmp_path, report=report, cluster=cluster.scheduler_address)
    assert killed and [done for done, _ in told] == list(range(told[-1][1] + 1))
    assert not [row for row in rows if row["metric"] == FAILURE]
    same(rows, expected)
    for kind, names in (("models", "*/model.json"), ("examples", "*/*.ply")):
        here, there = (
            {path.relative_to(place) for path in (place / kind).glob(names)}
            for place in (folder, tmp_path)
        )
        assert here == there != set(), "what workers wrote came back"
    # Everything that is stored is used again, in this process, too.
    same(evaluate([study], tmp_path, report=lambda *event: told.append(event[:2])), expected)
    assert told[-1][0] == told[-2][0]


def test_what_is_kept_outlives_the_worker_that_had_it(cluster):
    with executor_of(cluster=cluster.scheduler_address) as executor:
        (first,) = results(executor, [executor.keep(tasks.squares, 4)])
        grown = results(executor, [executor.keep(tasks.appended, first, n) for n in (16, 25)])
        assert not isinstance(grown[0], list), "a stand-in"
        for process in watched(cluster):
            os.kill(process, signal.SIGKILL)
        found = results(executor, [executor.submit(tasks.total, one, 1) for one in grown])
    assert found == [30.0, 39.0]


@pytest.fixture
def small_tiles(monkeypatch):
    """The bar's vertices are in several tiles."""
    monkeypatch.setattr(site_tiles, "_TILE", 10_000)


def test_a_training_gives_the_same_when_a_worker_dies(cluster, small_tiles, tmp_path):
    """While settings are tried, and while the components are on both workers."""
    options = {"components": 3, "epochs": 5, "device": "cpu"}
    shapes = bending_bar(count=12)
    expected = deformer.train(shapes, **options)
    killed, told = {}, []

    def report(progress):
        told.append(progress)
        if progress.stage not in {*killed, "features"} and progress.done == 3:
            killed[progress.stage] = watched(cluster)[0]
            os.kill(killed[progress.stage], signal.SIGKILL)

    there = {"cluster": cluster.scheduler_address, "on_progress": report}
    found = deformer.train(shapes, **options, **there)
    assert killed.keys() == {"cross-validation", "training"}
    for stage in ("features", *killed):
        counts = [(p.done, p.total) for p in told if p.stage == stage]
        assert counts == sorted(counts) and counts[-1][0] == counts[-1][1]
    assert found.config == expected.config and found.handle_noise == expected.handle_noise
    # Weights of the tried misfits are exponential in their errors, fifty times these.
    assert found.handle_misfits == pytest.approx(expected.handle_misfits, rel=5e-5)
    # Single precision, whose sums have another order; rounds of the factorisation amplify it.
    scale = np.abs(expected.weights.C).max()
    np.testing.assert_allclose(found.weights.C, expected.weights.C, atol=1e-5 * scale)
    np.testing.assert_allclose(
        found.codes, expected.codes, atol=1e-5 * np.abs(expected.codes).max()
    )


def test_local_workers_end_with_the_block():
    with executor_of(cluster="local:1") as executor:
        task = executor.submit(tasks.process)
        (_, end) = outcomes(executor)[task]
    with pytest.raises(ProcessLookupError):
        os.kill(end.result, 0)


def test_a_local_worker_that_dies_is_replaced_however_long_that_takes(tmp_path):
    import dask.config

    soon = {"distributed.deploy.lost-worker-timeout": "1 ms"}  # of Dask's own patience
    with dask.config.set(soon), executor_of(cluster="local:1") as executor:
        task = executor.submit(tasks.die_once, 3, str(tmp_path / "died"))
        assert outcomes(executor)[task] == ([[0], [1], [2]], Done(task, 3))


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("local:0", "expected local:1 to local:1000, got 'local:0'"),
        ("local:many", "expected local:1 to local:1000"),
        ("nonsense://x", "no scheduler answers at 'nonsense://x'"),
        ("tcp://127.0.0.1:1", "no scheduler answers at 'tcp://127.0.0.1:1'"),
    ],
)
def test_an_address_that_is_none_is_one_line(address, message, monkeypatch):
    monkeypatch.setattr("deformer.parallel.cluster._PATIENCE", 1)
    with pytest.raises(InputError) as caught, executor_of(cluster=address):
        pass
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_an_assertion_of_dask_about_an_address_is_one_line(monkeypatch):
    def fail(*_, **__):
        raise AssertionError

    monkeypatch.setattr("distributed.Client", fail)
    with pytest.raises(InputError) as caught, executor_of(cluster="a\0b"):
        pass
    assert "no scheduler answers at 'a\\x00b' (no address of one)" in str(caught.value)


def test_other_versions_are_named(cluster, monkeypatch, caplog):
    """Faked in this process alone: workers answer with their own."""
    true, changed = metadata.version, {"numpy": "0.1"}
    assert differences(versions(), versions()) == ("", "")
    monkeypatch.setattr(
        "deformer.parallel.versions.metadata.version", lambda name: changed.get(name) or true(name)
    )
    with executor_of(cluster=cluster.scheduler_address):
        pass
    assert f"has numpy {np.__version__} there, 0.1 here; its numbers may differ" in caplog.text
    changed["deformer"] = "0.0.0"
    expected = rf"has deformer {true('deformer')} there, 0\.0\.0 here; install the same"
    with pytest.raises(InputError, match=expected), executor_of(cluster=cluster.scheduler_address):
        pass
