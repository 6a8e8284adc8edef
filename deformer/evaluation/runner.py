"""Runs a plan, in one or several processes; continues an interrupted run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from deformer.evaluation.journal import Journal, Row, write_csv
from deformer.evaluation.measurements import failure_rows, network_folder, run_job
from deformer.evaluation.methods import is_trained
from deformer.evaluation.plan import Job, Study, make_plan
from deformer.evaluation.staging import Staging, Written
from deformer.io import locked, write_json
from deformer.parallel import Done, Executor, Failed, Part, WorkerLost, executor_of

# Called with the number of finished measurements, of all measurements, and the current job's label.
Report = Callable[[int, int, str], None]


def evaluate(
    studies: list[Study],
    folder: Path,
    processes: int = 1,
    report: Report | None = None,
    *,
    cluster: str | None = None,
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
        cluster: address of a Dask scheduler, or "local:N" for N workers on this machine, in place
            of processes; its machines need not have the files. None is no cluster.

    Returns:
        The rows, in the order of the plan.

    Raises:
        InputError: the folder's journal is not one, or another process is writing to the folder,
            or the cluster cannot be used.
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
        if report is not None:
            report(done, total, "")
        with executor_of(processes, cluster) as executor:
            for text, key, rows in _results(pending, folder, executor):
                journal.add(key, rows)
                done += 1
                if report is not None:
                    report(done, total, text)
        keys = [measurement.key(job.training) for job in plan for measurement in job.measurements]
        rows = [row for key in keys for row in journal[key]]
        write_json(folder / "results.json", rows)
        write_csv(folder / "results.csv", rows)
        return rows


def _results(
    jobs: list[Job], folder: Path, executor: Executor
) -> Iterator[tuple[str, str, list[Row]]]:
    """Label, key and rows of each measurement; a lost worker fails the measurements it leaves."""
    waiting, running = list(jobs), dict[int, Job]()
    staging = None if executor.shares_files else Staging(executor, folder)

    def submit_ready() -> None:
        """Submit the waiting jobs none of whose networks a running job may be training."""
        in_training = set[str]().union(*(_untrained(job, folder) for job in running.values()))
        for job in list(waiting):
            if job.networks & in_training:
                continue
            waiting.remove(job)
            task = staging.submit(job) if staging else executor.submit(run_job, job, folder)
            running[task] = job
            in_training |= _untrained(job, folder)

    submit_ready()
    for event in executor.as_completed():
        job = running[event.task]
        if isinstance(event, Part):
            key, rows = event.value
            missing = tuple(m for m in job.measurements if m.key(job.training) != key)
            running[event.task] = replace(job, measurements=missing)
            yield job.training.label, key, rows
            continue
        del running[event.task]
        if isinstance(event, Done) and isinstance(event.result, Written):
            event.result.unpack(folder)
            for key, rows in event.result.rows:
                yield job.training.label, key, rows
        elif isinstance(event, Failed):
            if not isinstance(event.error, WorkerLost):
                raise event.error
            for key, rows in failure_rows(job, str(event.error)):
                yield job.training.label, key, rows
        submit_ready()


def _untrained(job: Job, folder: Path) -> set[str]:
    """Networks that a job needs and that no job has stored yet."""
    return {name for name in job.networks if not is_trained(network_folder(folder, name))}
