"""A display of its own for tests of windows: Xvfb, or a reason to skip."""

import os
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest


@contextmanager
def virtual_display(*programs, size=(1400, 950)):
    """The name of an X display that lasts for the block; skips where it cannot be had."""
    if not sys.platform.startswith("linux"):
        pytest.skip("needs X on Linux")
    for program in ("Xvfb", *programs):
        if shutil.which(program) is None:
            pytest.skip(f"needs {program} (Debian, Ubuntu: apt install {program.lower()})")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{size[0]}x{size[1]}x24", "-noreset"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        number = os.read(read, 20).decode().strip()
        assert number, "Xvfb did not start"
        yield f":{number}"
    finally:
        os.close(read)
        server.terminate()
        server.wait()
