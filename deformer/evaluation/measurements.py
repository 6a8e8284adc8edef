"""One job: train a method, then measure it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from functools import cached_property, lru_cache
from pathlib import Path
from typing import cast

import numpy as np
import torch

from deformer.baselines import Autoencoder, ComponentMethod, PosingMethod
from deformer.editing import layout
from deformer.evaluation import protocols
from deformer.evaluation.journal import FAILURE, Row
from deformer.evaluation.methods import has_components, train_method
from deformer.evaluation.plan import EXAMPLE_COUNT, Job, Measurement, Training
from deformer.evaluation.sources import SplitData, load_split
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence, e_rms
from deformer.io import save_mesh
from deformer.linalg import one_blas_thread

Errors = protocols.Errors
# Folder of the meshes that pictures show, in the directory of a run.
EXAMPLES = "examples"


def run_job(job: Job, folder: Path) -> Generator[tuple[str, list[Row]], None, None]:
    """Train a method and yield the key and the rows of each of its measurements.

    A measurement that raises yields a row of the metric "failure"; a training that raises yields
    such a row for each measurement of the job. PyTorch and BLAS use one thread each, so that the
    numbers do not depend on how many jobs run at once.

    Args:
        job: the training and its measurements.
        folder: directory of the run; networks and example meshes are written there.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with one_blas_thread():
            yield from _run(job, folder)
    finally:
        torch.set_num_threads(threads)


def failure_rows(job: Job, reason: str) -> Iterator[tuple[str, list[Row]]]:
    """Key and row of the metric "failure" for each measurement of a job; `reason` is one line."""
    for measurement in job.measurements:
        protocol = measurement.protocol(job.training)
        row = _row(job.training, measurement, protocol, measurement.count, FAILURE, reason)
        yield measurement.key(job.training), [row]


def _run(job: Job, folder: Path) -> Iterator[tuple[str, list[Row]]]:
    training = job.training
    try:
        data = _split_data(training, ())
        method, seconds = _trained(training, data.train, folder)
    # A method may raise anything: the failure becomes a row, and the run continues.
    except Exception as error:
        yield from failure_rows(job, protocols.one_line(error))
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


def _trained(training: Training, train: MeshSequence, folder: Path) -> tuple[PosingMethod, float]:
    """The method of a training on `train`, and the seconds that it took; see `train_method`."""
    return train_method(
        training.method,
        train,
        training.components,
        training.number,
        training.setting,
        network_folder(folder, training.network) if training.network else None,
    )


def network_folder(folder: Path, network: str) -> Path:
    """Where a run in `folder` stores the network with the hash `network` (`Training.network`)."""
    return folder / "models" / network


@lru_cache(maxsize=32)
def _chosen_vertices(training: Training, count: int, folder: Path) -> IntArray:
    """Control vertices (count,) that the model of a training chooses."""
    method, _ = _trained(training, _split_data(training, ()).train, folder)
    return layout(cast(Autoencoder, method).model, count).vertices


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
    """A trained method with its test shapes; caches results that several measurements share."""

    def __init__(
        self, training: Training, test: tuple[int, ...], method: PosingMethod, folder: Path
    ) -> None:
        self.training, self.method, self.folder = training, method, folder
        self.data = _split_data(training, test)

    @cached_property
    def _encoded(self) -> FloatArray:
        """Reconstructions (N, V, 3) of the test shapes by one encoder pass."""
        return protocols.encoder_pass(self._coded, self.data.test)

    @cached_property
    def _fitted(self) -> FloatArray:
        """The decodable shapes (N, V, 3) closest to the test shapes."""
        return protocols.best_fit(self._coded, self.data.test)

    @property
    def _coded(self) -> ComponentMethod:
        return cast(ComponentMethod, self.method)  # plans measure codes only where there are

    def rows(self, measurement: Measurement) -> list[Row]:
        """Rows of a measurement; a part that raises becomes a row of the metric "failure"."""
        name = measurement.protocol(self.training)
        parts: dict[str, Callable[[], dict[int, Errors]]]
        if measurement.kind == "sparse_control":
            parts = {name: lambda: self._control(measurement)}
        elif measurement.kind == "example":
            parts = {f"{name}/sparse_control": self._example_control}
            if has_components(self.training.method):
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
        return dict(protocols.errors_by_rotation(angles, self.data.test, estimate))

    def _control(self, measurement: Measurement) -> dict[int, Errors]:
        data, source = self.data, self.training.source
        if measurement.layout is None:
            vertices = data.control_vertices(measurement.count, measurement.seed)
        elif isinstance(measurement.layout, Training):
            vertices = _chosen_vertices(measurement.layout, measurement.count, self.folder)
        else:
            vertices = np.array(measurement.layout, dtype=np.int64)
        targets = data.test[:, vertices]
        noise = measurement.noise * data.reference.bounding_diagonal
        if noise:
            rng = np.random.default_rng(measurement.seed)
            targets = targets + rng.normal(scale=noise, size=targets.shape)
        faces = data.train.faces
        errors = protocols.sparse_control(
            self.method, data.test, vertices, faces, source.ordered, targets, noise
        )
        return {0: errors}

    def _example_control(self) -> dict[int, Errors]:
        shape = self.data.test[len(self.data.test) // 2]
        vertices = self.data.control_vertices(EXAMPLE_COUNT, self.training.number)
        estimate = np.asarray(self.method.fit_handles(vertices, shape[vertices]))
        return self._save_example("sparse_control", shape, estimate, e_rms(shape, estimate, "none"))

    def _example_encoder(self) -> dict[int, Errors]:
        middle = len(self.data.test) // 2
        shape = self.data.test[middle]
        estimate = self._encoded[middle]
        estimate = estimate + (shape.mean(axis=0) - estimate.mean(axis=0))
        return self._save_example("encoder", shape, estimate, e_rms(shape, estimate))

    def _save_example(
        self, what: str, shape: FloatArray, estimate: FloatArray, error: float
    ) -> dict[int, Errors]:
        """Write the true and the estimated mesh, which the report draws."""
        folder = self.folder / EXAMPLES / self.training.source.name
        folder.mkdir(parents=True, exist_ok=True)
        faces = self.data.train.faces
        save_mesh(folder / "truth.ply", Mesh(shape, faces))
        save_mesh(folder / f"{self.training.method}-{what}.ply", Mesh(estimate, faces))
        return {0: {"E_rms": error}}
