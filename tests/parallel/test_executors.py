"""Executors: parts as they come, each once; what fails fails alone; nothing outlives the block."""

import multiprocessing
import sys
from functools import partial

import pytest

import parallel_tasks as tasks
from deformer import InputError
from deformer.parallel import (
    Done,
    Failed,
    InProcess,
    Part,
    Processes,
    Threads,
    WorkerLost,
    executor_of,
    results,
    stream,
)
from deformer.parallel.inbox import Inbox
from waiting import wait_for

pytestmark = pytest.mark.slow
every = pytest.mark.parametrize(
    "make", [InProcess, Threads, partial(Processes, 2)], ids=["one", "threads", "two"]
)


def outcomes(executor):
    """Task → (its parts, its last event)."""
    parts, ends = {}, {}
    for event in executor.as_completed():
        assert event.task not in ends, "nothing comes after the end"
        if isinstance(event, Part):
            parts.setdefault(event.task, []).append(event.value)
        else:
            ends[event.task] = event
    return {task: (parts.get(task, []), end) for task, end in ends.items()}


@every
def test_parts_come_in_order_and_then_the_result(make):
    with make() as executor:
        numbers = {executor.submit(tasks.count, n): n for n in (3, 0, 5)}
        found = outcomes(executor)
    assert len(numbers) == 3
    for task, n in numbers.items():
        assert found[task] == ([[k] for k in range(n)], Done(task, sum(range(n))))
    assert not multiprocessing.active_children()


@every
def test_an_error_is_that_of_its_task(make):
    with make() as executor:
        bad, good = executor.submit(tasks.refuse, "no such thing"), executor.submit(tasks.count, 2)
        found = outcomes(executor)
    parts, end = found[bad]
    assert parts == [0] and isinstance(end, Failed)
    assert isinstance(end.error, InputError) and str(end.error) == "no such thing"
    assert found[good] == ([[0], [1]], Done(good, 1))


@every
def test_tasks_can_be_submitted_while_others_end(make):
    seen = []
    with make() as executor:
        executor.submit(tasks.count, 1)
        for event in executor.as_completed():
            if isinstance(event, Done):
                seen.append(event.result)
                if len(seen) < 4:
                    executor.submit(tasks.count, len(seen) + 1)
    assert seen == [0, 1, 3, 6]


@every
def test_results_come_in_order_and_those_of_a_stream_as_they_end(make):
    told = []
    with make() as executor:
        kept = results(executor, [executor.keep(tasks.squares, n) for n in (3, 5)])
        assert results(executor, [executor.submit(tasks.total, k, 1) for k in kept]) == [5, 30]
        asked = []

        def calls():
            for n in range(9):
                asked.append(n)
                yield tasks.count, n

        for ended, (n, found) in enumerate(stream(executor, calls(), told.append), start=1):
            assert found == sum(range(n))
            assert len(asked) <= ended + executor.wanted, "no more than a few wait"
        assert len(told) == sum(range(9))
        with pytest.raises(InputError, match="no such thing"):
            results(executor, [executor.submit(tasks.refuse, "no such thing")])


def test_threads_work_at_the_same_time_and_end_when_nobody_waits(tmp_path, monkeypatch):
    monkeypatch.setattr("deformer.parallel.threads.CORES", 2)
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    with Threads() as executor:
        pair = [executor.submit(tasks.meet, a, b), executor.submit(tasks.meet, b, a)]
        assert len(set(results(executor, pair))) == 1
    ended = [tmp_path / "one", tmp_path / "two"]
    with pytest.raises(KeyboardInterrupt), Threads() as executor:
        for path in ended:
            executor.submit(tasks.tick, str(path))
        for _ in executor.as_completed():
            raise KeyboardInterrupt
    wait_for(lambda: all(path.exists() for path in ended))


def test_two_processes_work_at_the_same_time(tmp_path):
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    with Processes(2) as executor:
        first, second = executor.submit(tasks.meet, a, b), executor.submit(tasks.meet, b, a)
        found = outcomes(executor)
    assert found[first][1].result != found[second][1].result


def test_a_process_takes_one_task_after_the_other():
    with Processes(1) as executor:
        for _ in range(3):
            executor.submit(tasks.process)
        found = {end.result for _, end in outcomes(executor).values()}
    assert len(found) == 1


def test_a_process_that_dies_fails_its_own_task():
    with Processes(2) as executor:
        bad, good = executor.submit(tasks.die, 2), [executor.submit(tasks.count, 3)]
        good += [executor.submit(tasks.count, n) for n in (1, 2, 4)]
        found = outcomes(executor)
    parts, end = found[bad]
    assert parts in ([], [[0]], [[0], [1]]), "what was told before it died"
    assert isinstance(end, Failed) and isinstance(end.error, WorkerLost)
    assert "the process ended" in str(end.error)
    assert all(isinstance(found[task][1], Done) for task in good)


def test_processes_end_with_the_block_whatever_they_do(tmp_path):
    started = tmp_path / "started"
    with pytest.raises(KeyboardInterrupt), Processes(2) as executor:
        executor.submit(tasks.wait_for_ever, str(started))
        executor.submit(tasks.count, 1)
        for _ in executor.as_completed():
            wait_for(started.exists)
            assert multiprocessing.active_children()
            raise KeyboardInterrupt
    assert not multiprocessing.active_children()


def test_a_cluster_without_dask_says_what_to_install(monkeypatch):
    for name in ("dask", "dask.config", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "deformer.parallel.cluster", raising=False)
    with pytest.raises(InputError, match=r'needs the package dask.*; pip install "deformer\[clus'):
        executor_of(cluster="local:2")
    with pytest.raises(InputError, match="got 2 with a cluster"):
        executor_of(processes=2, cluster="local:2")


def test_what_is_told_again_or_late_comes_once():
    inbox = Inbox()
    for task in (7, 8):
        inbox.expect(task)
    inbox.put_part(7, 0, "a")
    inbox.put_part(7, 0, "a")  # run again, by another worker
    inbox.put_part(7, 2, "c")  # the second was lost on its way
    inbox.put_end(7, ["a", "b", "c"], "result")
    inbox.put_part(7, 1, "b")
    inbox.put_error(8, WorkerLost("gone"))
    *events, last = inbox.events()
    assert events == [*(Part(7, value) for value in "abc"), Done(7, "result")]
    assert isinstance(last, Failed) and last.task == 8
