"""A fit of many frames that is killed goes on, and writes the same file to the last byte."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from command import DEFORMER
from deformer import io
from shapes import small_model
from waiting import HANG, wait_for

FRAMES = 2000
# What is to be killed must not end before, however late the killer looks.
HELD = """
import time
from deformer.editing.finished_windows import FinishedWindows
from deformer_app.entry import main

save, saved = FinishedWindows.save, []

def hold(*arguments):
    save(*arguments)
    saved.append(arguments)
    if len(saved) == 3:
        time.sleep(600)

FinishedWindows.save = hold
main()
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="POSIX signals"),
]


def command(output, program=DEFORMER):
    return [*program, "fit", "m", "frames.json", "-o", output, "--memory", "700MB"]


def test_a_killed_fit_goes_on_and_writes_the_same_file(tmp_path, monkeypatch):
    name = "poses.npz"
    monkeypatch.chdir(tmp_path)
    model = small_model()
    model.save("m")
    t = np.linspace(0, 1, FRAMES)[:, None]
    codes = (1 - t) * model.codes[1] + t * model.codes[9] + 0.1 * np.sin(40 * t)
    vertices = [5, 60, 110]
    places = [model.decode(z)[vertices] for z in codes]
    frames = [
        [{"vertex": v, "position": p.tolist()} for v, p in zip(vertices, places, strict=True)]
        for places in places
    ]
    io.write_json("frames.json", {"frames": frames})
    subprocess.run(command(f"whole-{name}"), check=True, timeout=HANG, stdout=subprocess.DEVNULL)
    folder = Path(f"{name}.windows")

    def kept():
        return {path.name: path.stat().st_mtime_ns for path in folder.glob("fit-*")}

    held = command(name, [sys.executable, "-c", HELD])
    with subprocess.Popen(held, stdout=subprocess.DEVNULL) as process:
        wait_for(lambda: len(kept()) > 1 or process.poll() is not None)
        process.send_signal(signal.SIGKILL)
        assert process.wait(HANG) == -signal.SIGKILL
    before = kept()
    assert len(before) > 1 and not Path(name).exists()
    with subprocess.Popen(command(name), stdout=subprocess.DEVNULL) as process:
        wait_for(lambda: len(kept()) > len(before) or process.poll() is not None)
        after = kept()
        # What was fitted is not fitted again.
        assert not after or before.items() <= after.items()
        assert process.wait(HANG) == 0
    assert not folder.exists()
    assert Path(name).read_bytes() == Path(f"whole-{name}").read_bytes()
