"""Every reader on damaged inputs: whole and finite, or one line that names the file.

`make fuzz` reads others, for longer.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from damage import KINDS
from waiting import HANG

NUMBER = 150
FUZZ = Path(__file__).parent / "fuzz.py"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits the memory of a process")
@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_input_is_whole_or_refused(tmp_path, name):
    done = subprocess.run(
        [sys.executable, FUZZ, "--seed", "1", "--kind", name, "--minutes", str(HANG / 60),
         "--number", str(NUMBER), "--keep", tmp_path],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
