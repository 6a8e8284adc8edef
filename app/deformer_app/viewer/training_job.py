"""Training in the background of the window: its progress, and a flag to stop it."""

from __future__ import annotations

import threading
from pathlib import Path

import deformer
from deformer import InputError, TrainingProgress, examine, io
from deformer_app.viewer.training_advice import comment, suggested_components
from deformer_app.viewer.training_estimate import TrainingEstimate
from deformer_app.viewer.up_axis import up_axis_of


def checkpoint_of(output: Path) -> Path:
    """Return the folder of the checkpoints of a model's training, as `deformer train` names it."""
    return output.parent / f"{output.name}.checkpoint"


class TrainingJob:
    """Trains a model on a thread of its own.

    Args:
        shapes: directory or NPZ of example shapes.
        output: directory that the model is written to.
        components: latent dimensions; None suits them to the number of shapes.
        epochs: steps, or None for the configuration's.
        up: axis of the shapes that points up; None is that of `up_axis_of`.
        resume: go on from the checkpoint of a training that was stopped.

    Attributes:
        estimate: how far it is.
        advice: what to tell of the chosen number of components, once the shapes are read.
    """

    def __init__(
        self,
        shapes: Path,
        output: Path,
        components: int | None,
        epochs: int | None,
        up: str | None,
        resume: bool = False,
    ) -> None:
        """Start."""
        self.output = output
        self.estimate = TrainingEstimate()
        self.advice = ""
        self._resume, self._keep = resume, False
        self.progress: TrainingProgress | None = None
        self.error: Exception | None = None
        self.done = False
        self._stop = False
        arguments = (shapes, components, epochs, up)
        self._thread = threading.Thread(
            target=self._run, args=arguments, name="training", daemon=True
        )
        self._thread.start()

    def cancel(self, keep: bool = False) -> None:
        """Stop after the current step; no model is written.

        Args:
            keep: leave the checkpoint, so that the training can go on from it.
        """
        self._keep = keep
        self._stop = True

    def wait(self, seconds: float) -> bool:
        """Wait at most so long for the end; return True once it has come."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    @property
    def cancelled(self) -> bool:
        """True once the user has stopped it."""
        return self._stop

    def _run(
        self, source: Path, components: int | None, epochs: int | None, up: str | None
    ) -> None:
        try:
            deformer.check_model_folder(self.output)
            with io.locked(self.output):
                shapes = deformer.load_shapes(source, self._loading)
                report = examine(shapes)
                if not report.usable:
                    errors = [f.message for f in report.findings if f.severity == "error"]
                    raise InputError(f"{source}: {errors[0] if errors else 'unusable'}")
                if components is None:
                    components = suggested_components(len(shapes))
                self.advice = comment(components, len(shapes))
                document = deformer.load_document(source)
                model = deformer.train(
                    shapes,
                    components,
                    epochs=epochs,
                    up=up or up_axis_of(shapes.mesh(0), document),
                    document=document,
                    checkpoint=checkpoint_of(self.output),
                    resume=self._resume,
                    on_progress=self._report,
                )
                if not self._stop:
                    model.save(self.output)
                    deformer.remove_checkpoint(checkpoint_of(self.output))
        except KeyboardInterrupt:
            pass  # cancelled before the first step
        except Exception as error:  # the window shows it
            self.error = error
        finally:
            if self._stop and not self._keep:
                self._forget_checkpoint()
            self.done = True

    def _forget_checkpoint(self) -> None:
        checkpoint = checkpoint_of(self.output)
        if deformer.has_checkpoint(checkpoint):
            try:
                deformer.remove_checkpoint(checkpoint)
            except (OSError, InputError) as error:
                self.error = error

    def _loading(self, done: int, total: int) -> None:
        self._report(TrainingProgress("loading", done, total))

    def _report(self, progress: TrainingProgress) -> None:
        self.estimate.follow(progress)
        self.progress = progress
        if self._stop:
            raise KeyboardInterrupt
