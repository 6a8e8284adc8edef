"""Commands that are killed or interrupted at any moment: every file is whole, and the next goes on.

`make soak` tries more moments: DEFORMER_KILLS of each kind, in place of 1.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import deformer
from bars import bending_bar
from command import DEFORMER
from deformer import io
from deformer.evaluation.journal import Journal
from shapes import small_model
from waiting import HANG

KILLS = int(os.environ.get("DEFORMER_KILLS", "1"))
SIGNALS = ["SIGKILL", "SIGINT"]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="POSIX signals"),
]

# Ctrl-C waits for the imports: numpy's makes an ImportError of it.
SAVER = """
import signal; signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
signal.signal(signal.SIGINT, signal.default_int_handler)
import deformer, sys
from dataclasses import replace
model = deformer.load_model("m")
try:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    for n in range(40):
        replace(model, codes=(n + 1.0) * model.codes).save("m")
except KeyboardInterrupt:
    sys.exit(130)
"""
TRAIN = ["train", "bar.npz", "-o", "m", "--components", "3", "--epochs", "10"]
FIT = ["fit", "m", "frames.json", "-o", "poses"]
EVALUATE = ["evaluate", "bar.npz", "-o", "out", "--methods", "pca,autoencoder", "--components", "3",
            "--protocols", "sparse_control",
            "--counts", "5", "--tests", "2", "--epochs", "2"]  # fmt: skip


def prepare(work):
    """Inputs, an older output, and files of someone else beside it."""
    model = small_model()
    deformer.save_shapes("bar.npz", bending_bar())
    if work != TRAIN:
        model.save("m")
    if work == FIT:
        vertices = range(0, len(model.reference.vertices), 20)
        frames = [
            [{"vertex": v, "position": model.decode(z)[v].tolist()} for v in vertices]
            for z in np.repeat(model.codes, 5, axis=0)
        ]
        io.write_json("frames.json", {"frames": frames})
        shapes = deformer.MeshSequence(model.decode(model.codes[:3]), model.reference.faces)
        deformer.save_shapes("poses", shapes)
    for name in (".m-letter.txt", "notes.txt", ".poses-1"):
        Path(name).write_text("keep me")


def check():
    """Every output that is there is whole; foreign files are untouched."""
    for name in (".m-letter.txt", "notes.txt", ".poses-1"):
        assert Path(name).read_text() == "keep me"
    if Path("m").exists():
        deformer.load_model("m")
    if Path("poses").exists():
        assert len(deformer.load_shapes("poses")) in (3, 5 * len(small_model().codes))
    if Path("out/journal.jsonl").exists():
        Journal(Path("out/journal.jsonl"))
    for path in Path("out").glob("results.json"):
        assert json.loads(path.read_text())


def names():
    return {path.name for path in Path().iterdir()}


def start(work):
    command = [sys.executable, "-c", SAVER] if work == SAVER else [*DEFORMER, *work]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


WORKS = {"train": TRAIN, "fit": FIT, "evaluate": EVALUATE, "save": SAVER}


@pytest.fixture(scope="module", params=WORKS)
def undisturbed(request, tmp_path_factory):
    """A work's name, the seconds that it takes when nothing ends it, and what is there then."""
    work = WORKS[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("undisturbed"))
        prepare(work)
        begun = time.monotonic()
        process = start(work)
        _, told = process.communicate(timeout=HANG)
        assert process.returncode == 0, told
        check()
        return request.param, time.monotonic() - begun, names()


@pytest.mark.parametrize("number", SIGNALS)
def test_whatever_ends_it_all_files_are_whole_and_the_next_goes_on(
    tmp_path, monkeypatch, undisturbed, number
):
    name, whole, written = undisturbed
    work = WORKS[name]
    rng = np.random.default_rng([*WORKS].index(name))
    for attempt in range(KILLS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        monkeypatch.chdir(folder)
        prepare(work)
        with start(work) as process:
            time.sleep(rng.uniform(0.0, whole))
            process.send_signal(getattr(signal, number))
            _, told = process.communicate(timeout=HANG)
        ends = 0, 130, -signal.SIGKILL, -signal.SIGINT
        # Python itself ends with 1 if it is interrupted while it starts.
        assert process.returncode in ends or "KeyboardInterrupt" in told, told
        check()
        again = work
        if work == TRAIN and deformer.has_checkpoint("m.checkpoint"):
            again = [*TRAIN, "--resume"]
        with start(again) as process:
            _, why = process.communicate(timeout=HANG)
        assert process.returncode == 0, (told, why)
        assert names() == written
        check()
