"""The memory that a process has taken."""

import sys
from pathlib import Path


def peak_memory():
    """Largest resident memory of this process since its program began, in bytes."""
    if sys.platform == "linux":
        # The peak that getrusage tells begins with that of the process that started this one.
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
