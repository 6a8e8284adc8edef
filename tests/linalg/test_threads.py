"""Truths of running on all cores: results in order, ranges that cover, limits that are heeded."""

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from deformer.linalg import threads
from deformer.linalg.threads import (
    in_parallel,
    one_blas_thread,
    over_parts,
    over_ranges,
    ranges,
    split,
    use_cores,
)


@pytest.fixture
def cores(monkeypatch):
    monkeypatch.setattr(threads, "CORES", 4)


@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "NUMBA_NUM_THREADS"])
def test_the_environment_bounds_the_cores(name):
    code = "from deformer.linalg import CORES; print(CORES)"
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, name: "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == "1"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no affinity masks here")
def test_the_affinity_mask_bounds_the_cores():
    code = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "from deformer.linalg import CORES; print(CORES)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "1"


def test_values_that_are_no_numbers_bound_nothing(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "all")
    monkeypatch.setenv("NUMBA_NUM_THREADS", "0")
    assert threads.usable_cores() >= 1


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 1000])
def test_ranges_cover_all(cores, count):
    for pieces in ([range(*r) for r in ranges(count, 1)], split(count)):
        assert [n for piece in pieces for n in piece] == list(range(count))
        assert len(pieces) <= 4
    assert all(len(piece) for piece in split(count)) or count == 0


def test_results_come_in_order_and_kernels_within_stay_on_one_thread(cores):
    def work(item):
        threads_used = set()
        over_ranges(lambda a, b: threads_used.add(threading.get_ident()), 9000)
        return item, len(threads_used)

    assert list(in_parallel(work, range(30))) == [(item, 1) for item in range(30)]


@pytest.mark.parametrize("count", [1, 2])
def test_a_thread_keeps_to_its_share_of_the_cores(cores, count):
    def work():
        use_cores(count)
        outer = list(in_parallel(lambda n: [n, *in_parallel(lambda m: m, range(3))], range(3)))
        return len(ranges(90_000)), len(split(90)), outer

    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(work).result()
    assert found == (count, count, [[n, 0, 1, 2] for n in range(3)])
    assert len(ranges(90_000)) == len(split(90)) == 4, "other threads have all"


def test_blas_has_its_threads_again_when_the_last_block_ends():
    def threads_of_blas():
        return [entry["num_threads"] for entry in threadpool_info() if entry["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        before = threads_of_blas()
        one, other = one_blas_thread(), one_blas_thread()
        one.__enter__()
        other.__enter__()
        one.__exit__(None, None, None)
        assert set(threads_of_blas()) <= {1}
        other.__exit__(None, None, None)
        assert threads_of_blas() == before


def test_what_is_raised_is_raised_to_the_caller(cores):
    def work(item):
        if item == 3:
            raise ValueError("three")

    with pytest.raises(ValueError, match="three"):
        list(in_parallel(work, range(6)))


def test_every_part_is_done_when_over_parts_returns():
    done = np.zeros(1000, dtype=int)

    def count(part):
        done[part.start : part.stop] += 1

    over_parts(count, len(done))
    assert (done == 1).all()


def test_over_parts_raises_what_a_part_raises():
    def fail(part):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        over_parts(fail, 5)
