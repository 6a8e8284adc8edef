"""Runs a plan, in one or several processes; continues an interrupted run."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from deformer.evaluation.journal import Journal, Row, write_csv
from deformer.evaluation.measurements import failure_rows, run_job
from deformer.evaluation.plan import Job, Study, make_plan
from deformer.io import locked, write_json

# Called with the number of finished measurements, of all measurements, and the current job's label.
Report = Callable[[int, int, str], None]


def evaluate(
    studies: list[Study], folder: Path, processes: int = 1, report: Report | None = None
) -> list[Row]:
    """Measure methods on unseen shapes, and write the rows to FOLDER/results.json and results.csv.

    FOLDER/journal.jsonl stores every finished measurement, and FOLDER/models the networks: the same
    call continues an interrupted or killed run. Failed measurements are tried again.

    Args:
        studies: the data sets, methods and protocols.
        folder: directory of the run; created where it does not exist.
        processes: number of jobs at once. 1 runs in this process, a larger number in worker
            processes; apart from the measured seconds the rows are the same.
        report: called with the progress; None is silent.

    Returns:
        The rows, in the order of the plan.

    Raises:
        InputError: the folder's journal is not one, or another process is writing to the folder.
        KeyboardInterrupt: Ctrl-C; finished measurements are stored.
    """
    plan = make_plan(studies)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
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
    """A worker process, the parent's end of its pipe, and its job with the missing measurements."""

    process: BaseProcess
    pipe: Connection
    job: Job


def _in_processes(jobs: list[Job], folder: Path, processes: int) -> _Results:
    """Results of jobs as they arrive; a worker that dies fails its own job only."""
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
                    for key, rows in failure_rows(worker.job, reason):
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
            # A worker writes each file atomically, so that it can be ended at any time.
            worker.pipe.close()
            worker.process.terminate()
            worker.process.join()


def _next(waiting: list[Job], busy: list[_Worker]) -> Job | None:
    """The first waiting job none of whose networks a busy worker may be training."""
    in_training = set().union(*(worker.job.networks for worker in busy))
    return next((job for job in waiting if not job.networks & in_training), None)


def _start(folder: Path, job: Job) -> _Worker:
    # Spawned, because the threads of PyTorch and numba do not survive a fork.
    context = get_context("spawn")
    parent_end, worker_end = context.Pipe()
    process = context.Process(target=_run_worker, args=(worker_end, folder), daemon=True)
    process.start()
    worker_end.close()
    return _Worker(process, parent_end, job)


def _run_worker(pipe: Connection, folder: Path) -> None:
    """Body of a worker: receives jobs, sends keys and rows, and (None, None) after each job.

    The worker ends when its pipe closes, as it does when the parent ends.
    """
    # Ctrl-C reaches all processes of a terminal; only the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            job = pipe.recv()
            for result in run_job(job, folder):
                pipe.send(result)
            pipe.send((None, None))
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        return
