"""Record first-minute.mp4, the first minute of the viewer, and viewer.png, its last frame.

python docs/first_minute.py docs

The program runs on a display of its own (Xvfb) with a real mouse and real keys (xdotool), and
ffmpeg records the display: `apt install xvfb xdotool ffmpeg`. How smooth the film is depends on
the machine; nothing else should run meanwhile. Of the time in which the solver is prepared, which
also depends on the machine, the film keeps two seconds.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import deformer

sys.path.append(str(Path(__file__).parents[1] / "tests" / "helpers"))

from display import virtual_display
from person import Person

SIZE = (1280, 800)
RATE = 15  # frames a second
STEP = 0.03  # seconds between two moves of the mouse
START = 3.0  # seconds of the start page
KEPT = 2.0  # seconds that are kept of the wait for the solver
REST = 1.0  # seconds without a change after which the picture rests
QUALITY = 27  # x264's constant rate factor


class Hand:
    """A hand on the mouse, which moves as smoothly as a person's.

    Args:
        person: whose program it is.
    """

    def __init__(self, person: Person) -> None:
        """Begin in the middle of the display."""
        self._person, self._at = person, np.array(SIZE) / 2

    def go(self, to, seconds=0.9) -> None:
        """Move the mouse to a pixel."""
        end, count = np.asarray(to, dtype=float), max(int(seconds / STEP), 1)
        shares = (1 - np.cos(np.pi * np.arange(1, count + 1) / count)) / 2
        way = [self._at + share * (end - self._at) for share in shares]
        words = [w for x, y in way for w in ("mousemove", round(x), round(y), "sleep", STEP)]
        self._person.xdotool(*words)
        self._at = end

    def click(self, at) -> None:
        """Click on a pixel."""
        self.go(at)
        time.sleep(0.3)
        self._person.xdotool("click", 1)

    def drag(self, start, *ends, seconds=1.4) -> None:
        """Press at a pixel, move on from one pixel to the next, release."""
        self.go(start)
        time.sleep(0.4)
        self._person.xdotool("mousedown", 1)
        for end in ends:
            self.go(end, seconds)
        time.sleep(0.3)
        self._person.xdotool("mouseup", 1)
        time.sleep(0.8)


@contextmanager
def recorded(display: str, film: Path):
    """Record a display for the length of the block, without loss."""
    size = "x".join(map(str, SIZE))
    source = ["-f", "x11grab", "-framerate", str(RATE), "-video_size", size, "-i", display]
    codec = ["-c:v", "libx264", "-qp", "0", "-preset", "ultrafast"]
    ffmpeg = subprocess.Popen(
        ["ffmpeg", "-v", "error", "-y", *source, *codec, str(film)], stdin=subprocess.PIPE
    )
    try:
        yield
    finally:
        ffmpeg.communicate(b"q")


def live(person: Person, folder: Path) -> tuple[float, float]:
    """Do what a new user does: open a model, drag, pin, mirror, slide, save.

    Returns:
        When the model was chosen, and when it could be dragged, on the clock of `time.monotonic`.
    """
    vertices = deformer.load_model("humanoid").reference.vertices
    left, right = vertices[:, 0].argmax(), vertices[:, 0].argmin()  # hands
    foot = vertices[:, 2].argmin()
    hand = Hand(person)
    hand.click(person.sees("cards")["humanoid"])
    chosen = time.monotonic()
    person.be_ready()
    person.sees("slider")  # the components have been measured
    ready = time.monotonic()
    time.sleep(1.5)

    def at(vertex, by=(0, 0)):
        return np.add(person.sees("vertices")[vertex], by)

    seen = folder / "seen.json"  # is written when the picture rests, where something has moved

    def rested(moved_since=0.0):
        """Wait until what has moved since a time rests."""
        person.wait(lambda: moved_since < seen.stat().st_mtime < time.time() - REST)

    def done(label, moved_since=0.0):
        """Wait until a step is in the history, and until what it moved since a time rests."""
        person.wait(lambda: person.steps()[-1:] == [label])
        rested(moved_since)

    begun = time.time()
    hand.drag(at(right), at(right, (-45, -100)), at(right, (-20, -150)))
    done("Place and drag", begun)
    begun = time.time()
    hand.click(person.sees("tour")["End tour"])  # its next steps are not those of the film
    rested(begun)
    hand.go(at(foot, (2, -8)))
    time.sleep(0.4)
    person.key("p")
    done("Make pin")
    hand.go(at(right))
    person.xdotool("click", 1)  # selects its handle
    begun = time.time()
    hand.click(person.sees("tools")["Mirror"])
    done("Mirror", begun)
    begun = time.time()
    hand.drag(at(left), at(left, (30, 60)), at(left, (-10, 110)))
    done("Drag", begun)
    slider = person.sees("slider")
    hand.drag(slider, np.add(slider, (60, 0)), np.add(slider, (-30, 0)), np.add(slider, (35, 0)))
    hand.go(at(left, (120, 60)))  # away from the sliders, which colour the body
    time.sleep(0.5)
    person.write("ctrl+s", "Save session", folder / "first.json")
    time.sleep(2.5)
    person.key("Escape")  # closes the message, which has the name of a temporary folder
    time.sleep(1.5)
    return chosen, ready


def main() -> None:
    """Record the film and cut it."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("into", type=Path)
    into = options.parse_args().into
    with (
        tempfile.TemporaryDirectory() as name,
        virtual_display("xdotool", "ffmpeg", size=SIZE) as display,
    ):
        folder = Path(name)
        raw, film = folder / "raw.mkv", into / "first-minute.mp4"
        person = Person(display, folder)
        try:
            person.sees("cards")
            with recorded(display, raw):
                begun = time.monotonic()
                time.sleep(START)
                chosen, ready = (at - begun for at in live(person, folder))
        finally:
            person.end()
        quiet = ["ffmpeg", "-v", "error", "-y"]
        codec = ["-c:v", "libx264", "-crf", str(QUALITY), "-pix_fmt", "yuv420p"]
        cut = f"select=not(between(t\\,{chosen + KEPT}\\,{ready})),setpts=N/FRAME_RATE/TB"
        subprocess.run(
            [*quiet, "-i", raw, "-vf", cut, *codec, "-movflags", "+faststart", film], check=True
        )
        last = ["-sseof", "-0.5", "-i", raw, "-frames:v", "1"]
        subprocess.run([*quiet, *last, into / "viewer.png"], check=True)


if __name__ == "__main__":
    main()
