"""Training in the background of the window: its progress, and a flag to stop it."""

from __future__ import annotations

import threading
from pathlib import Path

import deformer
from deformer import InputError, TrainingProgress, examine, io


class TrainingJob:
    """Trains a model on a thread of its own.

    Args:
        shapes: directory or NPZ of example shapes.
        output: directory that the model is written to.
        components: latent dimensions.
        epochs: steps, or None for the configuration's.
        up: axis of the shapes that points up.
    """

    def __init__(
        self, shapes: Path, output: Path, components: int, epochs: int | None, up: str
    ) -> None:
        """Start."""
        self.output = output
        self.progress: TrainingProgress | None = None
        self.error: Exception | None = None
        self.done = False
        self._stop = False
        arguments = (shapes, components, epochs, up)
        self._thread = threading.Thread(
            target=self._run, args=arguments, name="training", daemon=True
        )
        self._thread.start()

    def cancel(self) -> None:
        """Stop after the current step; nothing is written."""
        self._stop = True

    @property
    def cancelled(self) -> bool:
        """True once the user has stopped it."""
        return self._stop

    def _run(self, source: Path, components: int, epochs: int | None, up: str) -> None:
        try:
            deformer.check_model_folder(self.output)
            with io.locked(self.output):
                shapes = deformer.load_shapes(source, self._loading)
                report = examine(shapes)
                if not report.usable:
                    errors = [f.message for f in report.findings if f.severity == "error"]
                    raise InputError(f"{source}: {errors[0] if errors else 'unusable'}")
                model = deformer.train(
                    shapes,
                    components,
                    epochs=epochs,
                    up=up,
                    document=deformer.load_document(source),
                    on_progress=self._report,
                )
                if not self._stop:
                    model.save(self.output)
        except KeyboardInterrupt:
            pass  # cancelled before the first step
        except Exception as error:  # the window shows it
            self.error = error
        finally:
            self.done = True

    def _loading(self, done: int, total: int) -> None:
        self._report(TrainingProgress("loading", done, total))

    def _report(self, progress: TrainingProgress) -> None:
        self.progress = progress
        if self._stop:
            raise KeyboardInterrupt
