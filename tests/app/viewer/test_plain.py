"""Truths of `deformer edit --plain`, in a process and on a display of its own."""

import os
import subprocess
import sys

import pytest

from deformer_app.viewer.session import Session
from display import virtual_display
from waiting import HANG

pytestmark = pytest.mark.window

# Sends Ctrl-C to its own process once the editor is idle; places a handle first if told to.
INTERRUPTED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from deformer_app.entry import main
from deformer_app.viewer.editor import Editor

tick = Editor.tick

def look(editor):
    tick(editor)
    if not editor.idle:
        return
    if {edited} and not editor.session.changed:
        editor.handles.place(100, add=True)
        editor.commit("Place handle")
    else:
        os.kill(os.getpid(), signal.SIGINT)

Editor.tick = look
sys.argv[1:] = ["edit", "--plain"]
main()
"""


@pytest.mark.parametrize("edited", [True, False])
def test_ctrl_c_in_the_terminal_keeps_the_session(tmp_path, edited):
    with virtual_display() as display:
        done = subprocess.run(
            [sys.executable, "-c", INTERRUPTED.replace("{edited}", str(edited))],
            env={**os.environ, "DISPLAY": display, "DEFORMER_SETTINGS": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=HANG,
        )
    assert (done.returncode, done.stderr.count("\n")) == (130, 1), done.stderr
    kept = list(tmp_path.glob("autosave-*.json"))
    if not edited:
        assert done.stderr == "deformer: interrupted\n" and not kept
        return
    assert f"deformer edit --session {kept[0]}" in done.stderr
    assert len(Session.load(kept[0]).edit.handles) == 1
    assert not list(tmp_path.glob("*.lock"))
