"""One job: train a method, then measure it in its cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch

from deformer.baselines import Poser
from deformer.evaluation import protocols
from deformer.evaluation.material import Material, prepare
from deformer.evaluation.methods import offers_codes, trained
from deformer.evaluation.plan import EXAMPLE_COUNT, Cell, Job, Training
from deformer.evaluation.rows import FAILURE, Row
from deformer.geometry import FloatArray, Mesh, e_rms
from deformer.io import save_mesh
from deformer.linalg import one_blas_thread

Errors = protocols.Errors


def run_job(job: Job, folder: Path) -> Iterator[tuple[str, list[Row]]]:
    """Train a method and give the key and rows of one cell after the other.

    A cell, or a training, that raises gives a row of the metric "failure" for each of the cells
    that it costs. One thread each for PyTorch and BLAS, so that the numbers do not depend on how
    many jobs run beside this one.

    Args:
        job: what to do.
        folder: of the run; networks and examples are kept there.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with one_blas_thread():
            yield from _run(job, folder)
    finally:
        torch.set_num_threads(threads)


def failed(job: Job, reason: str) -> Iterator[tuple[str, list[Row]]]:
    """Keys and rows of all cells of a job that came to nothing."""
    for cell in job.cells:
        row = _row(job.training, cell, cell.protocol(job.training), cell.count, FAILURE, reason)
        yield cell.key(job.training), [row]


def _run(job: Job, folder: Path) -> Iterator[tuple[str, list[Row]]]:
    training = job.training
    try:
        material = _material(training, ())
        method, seconds = trained(
            training.method,
            material.train,
            training.components,
            training.number,
            training.setting,
            folder / "models" / training.network if training.network else None,
        )
    # What a method may raise is its own affair: the failure is a row, and the run goes on.
    except Exception as error:
        yield from failed(job, protocols.one_line(error))
        return
    benches: dict[tuple[int, ...], _Bench] = {}
    for cell in job.cells:
        if cell.kind == "training":
            name = cell.protocol(training)
            rows = [_row(training, cell, name, cell.count, "seconds", seconds)]
        else:
            if cell.test not in benches:
                benches[cell.test] = _Bench(training, cell.test, method, folder)
            rows = benches[cell.test].rows(cell)
        yield cell.key(training), rows


def _material(training: Training, test: tuple[int, ...]) -> Material:
    return prepare(training.source, training.split, test, training.noise, training.number)


def _row(
    training: Training, cell: Cell, protocol: str, count: int, metric: str, value: float | str
) -> Row:
    return {
        "dataset": training.source.name,
        "method": training.method,
        "protocol": protocol,
        "count": count,
        "seed": cell.seed,
        "metric": metric,
        "value": value,
    }


class _Bench:
    """A trained method before its test shapes; passes that several cells need are made once."""

    def __init__(
        self, training: Training, test: tuple[int, ...], method: Poser, folder: Path
    ) -> None:
        self.training, self.method, self.folder = training, method, folder
        self.material = _material(training, test)
        self._passes: dict[str, FloatArray] = {}

    def rows(self, cell: Cell) -> list[Row]:
        """Rows of a cell; of the metric "failure" where something was raised."""
        name = cell.protocol(self.training)
        if cell.kind == "sparse_control":
            parts: dict[str, Callable[[], dict[int, Errors]]] = {name: lambda: self._control(cell)}
        elif cell.kind == "example":
            parts = {f"{name}/sparse_control": self._example_control}
            if offers_codes(self.training.method):
                parts[f"{name}/encoder"] = self._example_encoder
        else:
            measure = self._reconstruction if cell.kind == "reconstruction" else self._rotation
            parts = {
                f"{name}/encoder": lambda: measure(protocols.encoder_pass),
                f"{name}/fit": lambda: measure(protocols.best_fit),
            }
        rows: list[Row] = []
        for protocol, measured in parts.items():
            try:
                classes = measured()
            except Exception as error:
                reason = protocols.one_line(error)
                rows.append(_row(self.training, cell, protocol, cell.count, FAILURE, reason))
                continue
            rows += [
                _row(self.training, cell, protocol, count or cell.count, metric, value)
                for count, errors in classes.items()
                for metric, value in errors.items()
            ]
        return rows

    def _pass(self, run: Callable) -> FloatArray:
        if run.__name__ not in self._passes:
            self._passes[run.__name__] = run(self.method, self.material.test)
        return self._passes[run.__name__]

    def _reconstruction(self, run: Callable) -> dict[int, Errors]:
        faces, ordered = self.material.train.faces, self.training.source.ordered
        estimate = self._pass(run)
        return {0: protocols.reconstruction_errors(self.material.test, estimate, faces, ordered)}

    def _rotation(self, run: Callable) -> dict[int, Errors]:
        angles = protocols.largest_rotations(self.material.reference, self.material.test)
        return dict(protocols.by_rotation(angles, self.material.test, self._pass(run)))

    def _control(self, cell: Cell) -> dict[int, Errors]:
        material, source = self.material, self.training.source
        vertices = material.control_vertices(cell.count, cell.seed)
        targets = material.test[:, vertices]
        if cell.noise:
            spread = cell.noise * material.reference.bounding_diagonal
            rng = np.random.default_rng(cell.seed)
            targets = targets + rng.normal(scale=spread, size=targets.shape)
        faces = material.train.faces
        errors = protocols.sparse_control(
            self.method, material.test, vertices, faces, source.ordered, targets
        )
        return {0: errors}

    def _example_control(self) -> dict[int, Errors]:
        shape = self.material.test[len(self.material.test) // 2]
        vertices = self.material.control_vertices(EXAMPLE_COUNT, self.training.number)
        estimate = np.asarray(self.method.fit_handles(vertices, shape[vertices]))
        return self._keep("sparse_control", shape, estimate, e_rms(shape, estimate, "none"))

    def _example_encoder(self) -> dict[int, Errors]:
        middle = len(self.material.test) // 2
        shape = self.material.test[middle]
        estimate = self._pass(protocols.encoder_pass)[middle]
        estimate = estimate + (shape.mean(axis=0) - estimate.mean(axis=0))
        return self._keep("encoder", shape, estimate, e_rms(shape, estimate))

    def _keep(
        self, what: str, shape: FloatArray, estimate: FloatArray, error: float
    ) -> dict[int, Errors]:
        """Write the true and the estimated mesh for pictures."""
        folder = self.folder / "examples" / self.training.source.name
        folder.mkdir(parents=True, exist_ok=True)
        faces = self.material.train.faces
        save_mesh(folder / "truth.ply", Mesh(shape, faces))
        save_mesh(folder / f"{self.training.method}-{what}.ply", Mesh(estimate, faces))
        return {0: {"E_rms": error}}
