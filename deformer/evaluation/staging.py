"""Jobs where the files of a run are not: what a job reads goes with it, what it writes comes back.

What travels are arrays, JSON values and dataclasses of this project, never the user's files.
"""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path

from deformer.evaluation.journal import Row
from deformer.evaluation.measurements import EXAMPLES, network_folder, run_job
from deformer.evaluation.methods import is_trained
from deformer.evaluation.plan import Job, Measurement, Training
from deformer.evaluation.sources import Reading, load_source
from deformer.geometry import FloatArray, IntArray
from deformer.io import atomic_path, write_npz
from deformer.model import DeformationModel, load_model
from deformer.parallel import Executor

_SHAPES, _MODEL = "shapes.npz", "model"


@dataclass(frozen=True, eq=False)
class Shapes:
    """The shapes of a source, as methods are measured on them.

    Args:
        vertices: (N, V, 3).
        faces: (F, 3).
        reference: index of the undeformed shape that was named, or None.
    """

    vertices: FloatArray
    faces: IntArray
    reference: int | None


@dataclass(frozen=True, eq=False)
class Written:
    """What a job has written.

    Args:
        rows: keys and rows of the measurements that belong to the pictures.
        networks: hash (`Training.network`) → model.
        pictures: path in the directory of examples → content.
    """

    rows: list[tuple[str, list[Row]]]
    networks: dict[str, DeformationModel]
    pictures: dict[str, bytes]

    def unpack(self, folder: Path) -> None:
        """Write everything to the directory of the run."""
        for name, model in self.networks.items():
            cache = network_folder(folder, name)
            if not is_trained(cache):
                cache.parent.mkdir(parents=True, exist_ok=True)
                model.save(cache)
        for name, content in self.pictures.items():
            path = folder / EXAMPLES / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(path) as temporary:
                temporary.write_bytes(content)


class Staging:
    """Submits jobs with what they read.

    Args:
        executor: runs them.
        folder: directory of the run.
    """

    def __init__(self, executor: Executor, folder: Path) -> None:
        """Nothing is sent yet."""
        self._executor, self._folder = executor, folder
        self._shared: dict[object, object] = {}

    def submit(self, job: Job) -> int:
        """The number of the task; its parts are as of `run_job`, its result is `Written`."""
        source, model = job.training.source, _given_model(job)
        if source not in self._shared:
            sequence, reference = load_source(source)
            shapes = Shapes(sequence.vertices, sequence.faces, reference)
            self._shared[source] = self._executor.share(shapes)
        if model is not None and model not in self._shared:
            self._shared[model] = self._executor.share(load_model(model))
        networks = {
            name: load_model(cache)
            for name in job.networks
            if is_trained(cache := network_folder(self._folder, name))
        }
        return self._executor.submit(
            run_staged, job, self._shared[source], networks, self._shared.get(model)
        )


def run_staged(
    job: Job,
    shapes: Shapes,
    networks: dict[str, DeformationModel],
    model: DeformationModel | None,
) -> Generator[tuple[str, list[Row]], None, Written]:
    """As `run_job`, in a directory of its own.

    Args:
        job: the training and its measurements.
        shapes: of the job's source.
        networks: those of the job's networks that are trained, by their hash.
        model: the model of the job's setting, if it has one.

    Returns:
        What was written. Measurements with pictures come with them, so that none is taken for
        finished without its pictures.
    """
    with tempfile.TemporaryDirectory(prefix="deformer-") as temporary:
        folder = Path(temporary)
        write_npz(folder / _SHAPES, {"vertices": shapes.vertices, "faces": shapes.faces})
        for name, network in networks.items():
            network_folder(folder, name).parent.mkdir(exist_ok=True)
            network.save(network_folder(folder, name))
        if model is not None:
            model.save(folder / _MODEL)
        moved = _moved(job, folder, shapes.reference)
        # Keys are hashes of all options, with the path of a model.
        original = {
            there.key(moved.training): here
            for there, here in zip(moved.measurements, job.measurements, strict=True)
        }
        held: list[tuple[str, list[Row]]] = []
        for key, rows in run_job(moved, folder):
            here = original[key]
            found = here.key(job.training), rows
            if here.kind == "example":
                held.append(found)
            else:
                yield found
        trained = {
            name: load_model(cache)
            for name in job.networks - networks.keys()
            if is_trained(cache := network_folder(folder, name))
        }
        pictures = {
            path.relative_to(folder / EXAMPLES).as_posix(): path.read_bytes()
            for path in sorted((folder / EXAMPLES).rglob("*"))
            if path.is_file()
        }
        return Written(held, trained, pictures)


def _given_model(job: Job) -> str | None:
    """Path or name of the trained model that a job measures, or that lays out its points."""
    layouts = (measurement.layout for measurement in job.measurements)
    trainings = [job.training, *(one for one in layouts if isinstance(one, Training))]
    return next((one.setting.model for one in trainings if one.setting.model is not None), None)


def _moved(job: Job, folder: Path, reference: int | None) -> Job:
    """The job with its files in `folder`."""

    def training(one: Training) -> Training:
        reading = Reading(reference=None if reference is None else str(reference))
        source = replace(one.source, path=str(folder / _SHAPES), reading=reading)
        setting = one.setting
        if setting.model is not None:
            setting = replace(setting, model=str(folder / _MODEL))
        return replace(one, source=source, setting=setting)

    def measurement(one: Measurement) -> Measurement:
        return (
            replace(one, layout=training(one.layout)) if isinstance(one.layout, Training) else one
        )

    return Job(training(job.training), tuple(map(measurement, job.measurements)))
