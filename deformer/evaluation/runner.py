"""Runs a plan: job by job or in parallel processes, and goes on where an earlier run stopped."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from deformer.evaluation.journal import Journal, Row, write_csv
from deformer.evaluation.measurements import failed, run_job
from deformer.evaluation.plan import Job, Study, make_plan
from deformer.io import write_json

# Called with the numbers of finished and of all measurements, and what is being worked on.
Report = Callable[[int, int, str], None]


def evaluate(
    studies: list[Study], folder: Path, processes: int = 1, report: Report | None = None
) -> list[Row]:
    """Measure methods on shapes that they have not seen.

    Every finished measurement is kept in FOLDER/journal.jsonl, and networks in FOLDER/models: a run
    that was interrupted or killed goes on when it is started again. Measurements that failed are
    tried again.

    Args:
        studies: what to measure.
        folder: directory of the run; results.json and results.csv are written to it at the end.
        processes: jobs at once. 1 works in this process; else each is a process of its own. The
            rows are the same, the measured seconds aside.
        report: told of progress.

    Returns:
        The rows, in the order of the plan.

    Raises:
        InputError: an option that makes no sense.
        KeyboardInterrupt: Ctrl-C; what is finished is kept.
    """
    plan = make_plan(studies)
    folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(folder / "journal.jsonl")
    total = sum(len(job.measurements) for job in plan)
    pending = [
        replace(job, measurements=missing)
        for job in plan
        if (missing := tuple(m for m in job.measurements if m.key(job.training) not in journal))
    ]
    done = total - sum(len(job.measurements) for job in pending)
    run = _in_this_process if processes == 1 else _in_processes
    if report is not None:
        report(done, total, "")
    for text, key, rows in run(pending, folder, processes):
        journal.add(key, rows)
        done += 1
        if report is not None:
            report(done, total, text)
    keys = [measurement.key(job.training) for job in plan for measurement in job.measurements]
    rows = [row for key in keys for row in journal[key]]
    write_json(folder / "results.json", rows)
    write_csv(folder / "results.csv", rows)
    return rows


_Results = Iterator[tuple[str, str, list[Row]]]


def _in_this_process(jobs: list[Job], folder: Path, _: int) -> _Results:
    for job in jobs:
        for key, rows in run_job(job, folder):
            yield job.training.label, key, rows


@dataclass
class _Worker:
    """A process, this end of the pipe to it, and its job with the measurements still to come."""

    process: BaseProcess
    pipe: Connection
    job: Job


def _in_processes(jobs: list[Job], folder: Path, processes: int) -> _Results:
    """Results of jobs in the order in which they come; a worker that dies costs its job alone."""
    waiting, busy, idle = list(jobs), list[_Worker](), list[_Worker]()
    try:
        while True:
            while len(busy) < processes and (job := _next(waiting, busy)):
                waiting.remove(job)
                worker = idle.pop() if idle else _start(folder, job)
                worker.job = job
                worker.pipe.send(job)
                busy.append(worker)
            if not busy:
                return
            for pipe in connection.wait([worker.pipe for worker in busy]):
                worker = next(worker for worker in busy if worker.pipe is pipe)
                training = worker.job.training
                try:
                    key, rows = worker.pipe.recv()
                except (EOFError, ConnectionResetError):
                    busy.remove(worker)
                    worker.process.join()
                    reason = f"the process ended with {worker.process.exitcode}; out of memory?"
                    for key, rows in failed(worker.job, reason):
                        yield training.label, key, rows
                    continue
                if key is None:
                    busy.remove(worker)
                    idle.append(worker)
                    continue
                missing = tuple(m for m in worker.job.measurements if m.key(training) != key)
                worker.job = replace(worker.job, measurements=missing)
                yield training.label, key, rows
    finally:
        for worker in (*busy, *idle):
            # What a worker writes it writes at once or not at all: it can be ended anywhere.
            worker.pipe.close()
            worker.process.terminate()
            worker.process.join()


def _next(waiting: list[Job], busy: list[_Worker]) -> Job | None:
    """The first job whose network is not being trained by another."""
    taken = {worker.job.training.network for worker in busy} - {None}
    return next((job for job in waiting if job.training.network not in taken), None)


def _start(folder: Path, job: Job) -> _Worker:
    # Not forked: the threads of PyTorch and numba do not survive that.
    context = get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_work, args=(there, folder), daemon=True)
    process.start()
    there.close()
    return _Worker(process, here, job)


def _work(pipe: Connection, folder: Path) -> None:
    """Body of a worker: receives jobs, sends the rows of their measurements, None after the last.

    It ends when the pipe is closed, also by the death of the parent.
    """
    # Ctrl-C goes to all processes of a terminal; the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            job = pipe.recv()
            for result in run_job(job, folder):
                pipe.send(result)
            pipe.send((None, None))
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        return
