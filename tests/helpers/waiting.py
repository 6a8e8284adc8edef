"""Waits that end with what they wait for: a busy machine makes them longer, not wrong."""

import time

HANG = 600.0  # seconds after which something is taken to hang; no machine should come near it


def wait_for(condition, step=lambda: None, pause=0.002):
    """Repeat `step` until `condition` gives something true; returns that.

    Args:
        condition: called without arguments, as often as there is time.
        step: what keeps things going meanwhile, such as handling a window's events; it raises
            where `condition` can no longer come true, such as when a process has died.
        pause: seconds between two looks.
    """
    end = time.monotonic() + HANG
    while not (found := condition()):
        assert time.monotonic() < end, f"hangs: nothing in {HANG:.0f} s"
        step()
        time.sleep(pause)
    return found
