"""Tasks that tests give to executors: workers import them from here."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from deformer.errors import InputError
from waiting import wait_for


def count(number):
    """Yields 0, 1, … and returns their sum."""
    yield from ([n] for n in range(number))
    return sum(range(number))


def die(number):
    """Yields as `count` does, then ends as a process that is killed."""
    yield from count(number)
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
    time.sleep(60)


def die_on_worker(number):
    """As `die`, on a worker of Dask."""
    yield from count(number)
    wait_for_nanny()
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
    time.sleep(60)


def wait_for_nanny():
    """Wait until the nanny has seen its worker start: it gives up on one that dies before."""
    import distributed

    own = [distributed.get_worker().address]
    with distributed.worker_client(separate_thread=False) as client:
        wait_for(lambda: all(client.run(_watches, nanny=True, workers=own).values()))


def _watches(dask_worker):
    """Called in a nanny."""
    return dask_worker.process.status.name == "running"


def refuse(text):
    """Yields once and raises."""
    yield 0
    raise InputError(text)


def meet(own, other):
    """Ends once another task runs at the same time: each sees the other's file."""
    Path(own).touch()
    while not Path(other).exists():
        time.sleep(0.02)
    yield os.getpid()
    return os.getpid()


def process():
    """Returns the process that it runs in."""
    yield None
    return os.getpid()


def wait_for_ever(started):
    """Never ends."""
    yield 0
    Path(started).touch()
    while True:
        time.sleep(1)


def measure_or_die(job, folder):
    """As `run_job`, but the method "arap" kills its process once the journal has a part."""
    from deformer.evaluation.measurements import run_job  # takes seconds to import

    journal = Path(folder) / "journal.jsonl"
    for found in run_job(job, folder):
        yield found
        if job.training.method == "arap":
            wait_for(lambda: journal.is_file() and '"arap"' in journal.read_text())
            os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
            time.sleep(60)


def die_once(number, died):
    """As `count`, on a worker of Dask; the first that runs it ends after two parts."""
    for part in count(number):
        yield part
        if part == [1] and not Path(died).exists():
            Path(died).touch()
            wait_for_nanny()
            time.sleep(0.5)  # until the parts have gone out
            os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
            time.sleep(60)
    return sum(range(number))


def total(array, factor):
    """The sum of an array."""
    yield from ()
    return factor * float(array.sum())


def tick(ended):
    """Yields for ever, and leaves a file when it is ended."""
    try:
        while True:
            yield 0
            time.sleep(0.02)
    finally:
        Path(ended).touch()


def squares(number):
    """The first squares, as an array."""
    yield 0
    return np.arange(float(number)) ** 2


def appended(array, number):
    """An array with one more number."""
    yield 0
    return np.append(array, number)
