"""One job: train a method, then take its measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import torch

from deformer.baselines import Method, Poser
from deformer.evaluation import protocols
from deformer.evaluation.journal import FAILURE, Row
from deformer.evaluation.methods import offers_codes, trained
from deformer.evaluation.plan import EXAMPLE_COUNT, Job, Measurement, Training
from deformer.evaluation.sources import SplitData, load_split
from deformer.geometry import FloatArray, Mesh, e_rms
from deformer.io import save_mesh
from deformer.linalg import one_blas_thread

Errors = protocols.Errors


def run_job(job: Job, folder: Path) -> Iterator[tuple[str, list[Row]]]:
    """Train a method and give the key and rows of one measurement after the other.

    A measurement that raises gives a row of the metric "failure", and a training that raises gives
    one for each of the job's measurements. One thread each for PyTorch and BLAS, so that the
    numbers do not depend on how many jobs run beside this one.

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
    """Keys and rows of all measurements of a job that came to nothing."""
    for measurement in job.measurements:
        protocol = measurement.protocol(job.training)
        row = _row(job.training, measurement, protocol, measurement.count, FAILURE, reason)
        yield measurement.key(job.training), [row]


def _run(job: Job, folder: Path) -> Iterator[tuple[str, list[Row]]]:
    training = job.training
    try:
        data = _split_data(training, ())
        method, seconds = trained(
            training.method,
            data.train,
            training.components,
            training.number,
            training.setting,
            folder / "models" / training.network if training.network else None,
        )
    # What a method may raise is its own affair: the failure is a row, and the run goes on.
    except Exception as error:
        yield from failed(job, protocols.one_line(error))
        return
    by_test: dict[tuple[int, ...], _TrainedMethod] = {}
    for measurement in job.measurements:
        if measurement.kind == "training":
            name = measurement.protocol(training)
            rows = [_row(training, measurement, name, measurement.count, "seconds", seconds)]
        else:
            test = measurement.test
            if test not in by_test:
                by_test[test] = _TrainedMethod(training, test, method, folder)
            rows = by_test[test].rows(measurement)
        yield measurement.key(training), rows


def _split_data(training: Training, test: tuple[int, ...]) -> SplitData:
    return load_split(training.source, training.split, test, training.noise, training.number)


def _row(
    training: Training,
    measurement: Measurement,
    protocol: str,
    count: int,
    metric: str,
    value: float | str,
) -> Row:
    return {
        "dataset": training.source.name,
        "method": training.method,
        "protocol": protocol,
        "count": count,
        "seed": measurement.seed,
        "metric": metric,
        "value": value,
    }


class _TrainedMethod:
    """A trained method and its test shapes; what several measurements need is computed once."""

    def __init__(
        self, training: Training, test: tuple[int, ...], method: Poser, folder: Path
    ) -> None:
        self.training, self.method, self.folder = training, method, folder
        self.data = _split_data(training, test)

    @cached_property
    def _encoded(self) -> FloatArray:
        """The test shapes (N, V, 3) as one pass of the encoder gives them."""
        return protocols.encoder_pass(self._coded, self.data.test)

    @cached_property
    def _fitted(self) -> FloatArray:
        """The shapes (N, V, 3) of the method that come closest to the test shapes."""
        return protocols.best_fit(self._coded, self.data.test)

    @property
    def _coded(self) -> Method:
        return cast(Method, self.method)  # plans ask for the codes of no other

    def rows(self, measurement: Measurement) -> list[Row]:
        """Rows of a measurement; of the metric "failure" where something was raised."""
        name = measurement.protocol(self.training)
        parts: dict[str, Callable[[], dict[int, Errors]]]
        if measurement.kind == "sparse_control":
            parts = {name: lambda: self._control(measurement)}
        elif measurement.kind == "example":
            parts = {f"{name}/sparse_control": self._example_control}
            if offers_codes(self.training.method):
                parts[f"{name}/encoder"] = self._example_encoder
        else:
            rotation = measurement.kind == "rotation"
            errors_of = self._rotation if rotation else self._reconstruction
            parts = {
                f"{name}/encoder": lambda: errors_of(self._encoded),
                f"{name}/fit": lambda: errors_of(self._fitted),
            }
        rows: list[Row] = []
        for protocol, measure in parts.items():
            try:
                classes = measure()
            except Exception as error:
                reason = protocols.one_line(error)
                rows.append(
                    _row(self.training, measurement, protocol, measurement.count, FAILURE, reason)
                )
                continue
            rows += [
                _row(
                    self.training, measurement, protocol, count or measurement.count, metric, value
                )
                for count, errors in classes.items()
                for metric, value in errors.items()
            ]
        return rows

    def _reconstruction(self, estimate: FloatArray) -> dict[int, Errors]:
        faces, ordered = self.data.train.faces, self.training.source.ordered
        return {0: protocols.reconstruction_errors(self.data.test, estimate, faces, ordered)}

    def _rotation(self, estimate: FloatArray) -> dict[int, Errors]:
        angles = protocols.largest_rotations(self.data.reference, self.data.test)
        return dict(protocols.by_rotation(angles, self.data.test, estimate))

    def _control(self, measurement: Measurement) -> dict[int, Errors]:
        data, source = self.data, self.training.source
        vertices = data.control_vertices(measurement.count, measurement.seed)
        targets = data.test[:, vertices]
        if measurement.noise:
            spread = measurement.noise * data.reference.bounding_diagonal
            rng = np.random.default_rng(measurement.seed)
            targets = targets + rng.normal(scale=spread, size=targets.shape)
        faces = data.train.faces
        errors = protocols.sparse_control(
            self.method, data.test, vertices, faces, source.ordered, targets
        )
        return {0: errors}

    def _example_control(self) -> dict[int, Errors]:
        shape = self.data.test[len(self.data.test) // 2]
        vertices = self.data.control_vertices(EXAMPLE_COUNT, self.training.number)
        estimate = np.asarray(self.method.fit_handles(vertices, shape[vertices]))
        return self._keep("sparse_control", shape, estimate, e_rms(shape, estimate, "none"))

    def _example_encoder(self) -> dict[int, Errors]:
        middle = len(self.data.test) // 2
        shape = self.data.test[middle]
        estimate = self._encoded[middle]
        estimate = estimate + (shape.mean(axis=0) - estimate.mean(axis=0))
        return self._keep("encoder", shape, estimate, e_rms(shape, estimate))

    def _keep(
        self, what: str, shape: FloatArray, estimate: FloatArray, error: float
    ) -> dict[int, Errors]:
        """Write the true and the estimated mesh for pictures."""
        folder = self.folder / "examples" / self.training.source.name
        folder.mkdir(parents=True, exist_ok=True)
        faces = self.data.train.faces
        save_mesh(folder / "truth.ply", Mesh(shape, faces))
        save_mesh(folder / f"{self.training.method}-{what}.ply", Mesh(estimate, faces))
        return {0: {"E_rms": error}}
