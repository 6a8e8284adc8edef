"""The loop around a training, with a training that only counts."""

import json

import numpy as np
import pytest
from safetensors.numpy import load_file

from deformer import InputError
from deformer.training import loop as training_loop
from deformer.training.checkpoints import has_checkpoint
from deformer.training.loop import TrainingProgress, run_training

IDENTITY = {"what": "counting"}


class Counting:
    """Adds up the numbers of its steps."""

    def __init__(self):
        self.steps, self.total, self.calls = [], 0, []

    def start(self):
        self.calls.append("start")

    def step(self, epoch):
        self.calls.append("step")
        self.steps.append(epoch)
        self.total += epoch
        return 2.0 * epoch, 1.0

    def state(self):
        return {"count": len(self.steps)}, {"total": np.array(self.total)}

    def restore(self, status, arrays):
        self.calls.append("restore")
        self.total = int(arrays["total"])


def at(epoch, act):
    """A progress callback that does something once."""

    def callback(progress):
        if progress.done == epoch:
            act()

    return callback


def interrupt():
    raise KeyboardInterrupt


def test_steps_are_taken_in_order_and_told():
    seen, counting = [], Counting()
    course = run_training(counting, 3, IDENTITY, on_progress=seen.append)
    assert counting.calls == ["start", "step", "step", "step"]
    assert counting.steps == [0, 1, 2]
    assert seen == [
        TrainingProgress("training", n + 1, 3, 2.0 * n + 1.0, 2.0 * n, 1.0) for n in range(3)
    ]
    assert course.epochs == 3 and not course.interrupted


def test_a_stopped_run_goes_on_where_it_stopped(tmp_path):
    options = {"checkpoint": tmp_path}
    part = run_training(Counting(), 9, IDENTITY, **options, on_progress=at(4, interrupt))
    assert part.epochs == 4 and part.interrupted
    counting = Counting()
    course = run_training(counting, 9, IDENTITY, **options, resume=True)
    assert counting.calls == ["restore", *5 * ["step"]] and counting.steps == [4, 5, 6, 7, 8]
    assert counting.total == sum(range(9))
    assert course.epochs == 9 and not course.interrupted


def test_time_before_a_stop_counts(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(training_loop.time, "monotonic", lambda: now[0])

    def tick(progress):
        now[0] += 2.0
        if progress.done == 3:
            raise KeyboardInterrupt

    part = run_training(Counting(), 9, IDENTITY, checkpoint=tmp_path, on_progress=tick)
    assert part.seconds == 4.0  # two callbacks lie before the third step
    now[0] += 1000.0
    whole = run_training(
        Counting(), 5, IDENTITY, checkpoint=tmp_path, resume=True, on_progress=tick
    )
    assert whole.seconds == 4.0 + 2.0


def test_a_checkpoint_is_written_every_half_minute_and_at_the_end(tmp_path, monkeypatch):
    now, kept = [0.0], []
    monkeypatch.setattr(training_loop.time, "monotonic", lambda: now[0])

    def look(progress):
        now[0] += 12.0
        path = tmp_path / "checkpoint.json"
        kept.append(json.loads(path.read_text())["epoch"] if path.exists() else 0)

    run_training(Counting(), 8, IDENTITY, checkpoint=tmp_path, on_progress=look)
    # Told before it is written: after the third step, and the sixth.
    assert kept == [0, 0, 0, 3, 3, 3, 6, 6]
    status = json.loads((tmp_path / "checkpoint.json").read_text())
    assert status["count"] == 8
    assert load_file(tmp_path / status["arrays"])["total"] == sum(range(8))


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    course = run_training(Counting(), 9, IDENTITY, on_progress=at(4, interrupt))
    assert course.interrupted and course.epochs == 4
    assert not has_checkpoint(tmp_path) and not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
@pytest.mark.parametrize("when", [6, 8], ids=["between", "at the end"])
def test_a_training_that_diverges_leaves_the_checkpoint_before_it(
    tmp_path, monkeypatch, value, when
):
    now = [0.0]
    monkeypatch.setattr(training_loop.time, "monotonic", lambda: now[0])

    class Diverging(Counting):
        def state(self):
            total = value if len(self.steps) >= when else float(self.total)
            return {}, {"total": np.array(total)}

    def tick(progress):
        now[0] += 12.0

    with pytest.raises(InputError, match=f"training: diverged by epoch {when}: total"):
        run_training(Diverging(), 8, IDENTITY, checkpoint=tmp_path, on_progress=tick)
    status = json.loads((tmp_path / "checkpoint.json").read_text())
    assert status["epoch"] == (3 if when == 6 else 6)
    assert np.isfinite(load_file(tmp_path / status["arrays"])["total"])


def test_other_errors_pass_through(tmp_path):
    def fail():
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        run_training(Counting(), 9, IDENTITY, checkpoint=tmp_path, on_progress=at(4, fail))
    assert not has_checkpoint(tmp_path)
