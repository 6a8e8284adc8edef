"""Output of the command line: results on stdout, all else on stderr, one line for a mistake."""

from __future__ import annotations

import _thread
import codecs
import ctypes
import dataclasses
import glob
import io
import json
import logging
import math
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from typer.exceptions import TyperException

from deformer_app.mistakes import system_mistake

if TYPE_CHECKING:
    from rich.progress import Progress

# Exit statuses.
INTERRUPTED = 130  # as shells report Ctrl-C
MISTAKE = 2

err = Console(stderr=True, highlight=False)
out = Console(highlight=False)


# Names of files may have bytes that are no text, which are printed as \xff.
READABLE = "deformer.readable"


def _escape(error: UnicodeError) -> tuple[str, int]:
    """What is printed in place of characters that a stream has no bytes for."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    # A byte of a name that is no text is a half surrogate in Python.
    escaped = text.encode("ascii", "backslashreplace").decode()
    return re.sub(r"\\udc([89a-f][0-9a-f])", r"\\x\1", escaped), error.end


codecs.register_error(READABLE, _escape)


class Interrupted(Exception):
    """Ctrl-C, after which a command has said what is kept and how to go on."""


def run(app: typer.Typer, arguments: list[str] | None = None) -> int:
    """Run the application and return its exit status.

    A user's mistake prints one line on stderr and returns 2, Ctrl-C returns 130. Any other
    exception is an error of the program and is raised with its traceback.
    """
    log = logging.getLogger("deformer")
    log.addHandler(_notes)
    log.setLevel(logging.INFO)
    given = expanded(sys.argv[1:]) if arguments is None else arguments
    given = given or ["--help"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=READABLE)
    with _CtrlC() as ctrl_c:
        return _status(app, given, ctrl_c)


def expanded(arguments: list[str], windows: bool = os.name == "nt") -> list[str]:
    """Arguments with patterns such as takes/*.json replaced by the files that match.

    Shells do that, but for those of Windows. A pattern without a match stays as it is.
    """
    if not windows:
        return arguments
    found = [sorted(glob.glob(text)) or [text] for text in arguments]  # noqa: PTH207 (any path)
    return [name for names in found for name in names]


def _status(app: typer.Typer, given: list[str], ctrl_c: _CtrlC) -> int:
    """Exit status of the command; see `run`."""
    try:
        status = app(args=given, prog_name="deformer", standalone_mode=False)
        if status == INTERRUPTED:  # typer's answer to Ctrl-C
            raise KeyboardInterrupt
    except (KeyboardInterrupt, typer.Abort):
        print("deformer: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Interrupted:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the pipe has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        message = _users_mistake(error)
        if message is None:
            if ctrl_c.pressed:  # a library has made another exception of it
                print("deformer: interrupted", file=sys.stderr)
                return INTERRUPTED
            raise
        print("deformer:", " ".join(message.split()), file=sys.stderr)
        return MISTAKE
    return status if isinstance(status, int) else 0


def _send_ctrl_c() -> None:
    """Interrupt this process; unlike `interrupt_main` it ends a system call that waits."""
    os.kill(os.getpid(), signal.SIGINT)


class _CtrlC:
    """Within the block, Ctrl-C raises KeyboardInterrupt, also where Python would ignore it.

    Attributes:
        pressed: true after Ctrl-C.
    """

    pressed = False

    def __enter__(self) -> _CtrlC:
        """Replace the handling of Ctrl-C, unless it is ignored or not this thread's."""
        self._hook, self._handler = sys.unraisablehook, signal.getsignal(signal.SIGINT)
        main = threading.current_thread() is threading.main_thread()
        self._active = main and callable(self._handler)
        if self._active:
            signal.signal(signal.SIGINT, self._press)
            sys.unraisablehook = self._again
        return self

    def __exit__(self, *error: object) -> None:
        """Restore the handling of Ctrl-C."""
        if self._active:
            sys.unraisablehook = self._hook
            signal.signal(signal.SIGINT, self._handler)

    def _press(self, number: int, frame: object) -> None:
        self.pressed = True
        raise KeyboardInterrupt

    def _again(self, unraisable: Any) -> None:
        """Repeat an interrupt that came in a callback or destructor, from where it cannot get out.

        Imports have many such callbacks.
        """
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            again = _thread.interrupt_main if os.name == "nt" else _send_ctrl_c
            threading.Timer(0.01, again).start()
        else:
            self._hook(unraisable)


def _users_mistake(error: Exception) -> str | None:
    """Describe a mistake that the user can correct; None if `error` is anything else."""
    if isinstance(error, TyperException):
        context = getattr(error, "ctx", None)
        remedy = f"; see {context.command_path} --help" if context else ""
        return error.format_message().rstrip(".") + remedy
    if isinstance(error, OSError):
        return system_mistake(error)
    if isinstance(error, MemoryError):
        reason = str(error) or "a request was refused"
        return f"not enough memory ({reason}); use fewer or smaller shapes"
    from deformer import InputError

    return str(error) if isinstance(error, InputError) else None


class _Notes(logging.Handler):
    """Prints what the library tells on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message."""
        note(record.getMessage())


_notes = _Notes()


def note(message: str) -> None:
    """Print a message on stderr."""
    err.print(message, soft_wrap=True, markup=False)


def warn(message: str) -> None:
    """Print a warning on stderr."""
    err.print(f"[yellow]warning:[/] {_escaped(message)}", soft_wrap=True)


def emit(data: Mapping[str, Any]) -> None:
    """Print a result as one JSON object on stdout; a number that is not finite becomes null."""
    # In ASCII, which every terminal and every name of a file can be written in.
    print(json.dumps(plain(data), allow_nan=False))


def plain(value: Any) -> Any:
    """Convert arrays, numpy numbers, dataclasses, tuples and paths to JSON values."""
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)


def show_table(title: str, columns: list[str], rows: list[list[str]]) -> None:
    """Print a table on stdout; columns after the first are aligned to the right if numeric."""
    from rich.table import Table

    table = Table()
    for index, column in enumerate(columns):
        numeric = bool(rows) and all(_is_number(row[index]) for row in rows)
        table.add_column(column, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(_escaped(cell) for cell in row))
    out.print(f"[bold]{_escaped(title)}[/]", soft_wrap=True)
    out.print(table)


def show_facts(title: str, facts: Mapping[str, Any]) -> None:
    """Print names and values on stdout."""
    from rich.table import Table

    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="cyan")
    grid.add_column(overflow="fold")
    for name, value in facts.items():
        grid.add_row(_escaped(name.replace("_", " ")), _escaped(brief(value)))
    out.print(f"[bold]{_escaped(title)}[/]", soft_wrap=True)
    out.print(grid)


def brief(value: Any) -> str:
    """Format a value in a few characters."""
    value = plain(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        text = f"{value:.4g}"
        return f"{float(text):.0f}" if "e+0" in text and abs(value) < 1e6 else text
    if value is None or value in ([], {}):
        return "none"
    if isinstance(value, list):
        head = ", ".join(f"({brief(v)})" if isinstance(v, list) else brief(v) for v in value[:8])
        return f"{head}, … ({len(value)} in all)" if len(value) > 8 else head
    if isinstance(value, dict):
        return ", ".join(f"{key} {brief(item)}" for key, item in value.items())
    return str(value)


def screen_fault() -> str | None:
    """Reason why no window can be opened; None where nothing speaks against it."""
    if sys.platform in ("win32", "darwin"):
        return None
    display, platform = (os.environ.get(name) for name in ("DISPLAY", "QT_QPA_PLATFORM"))
    if os.environ.get("WAYLAND_DISPLAY") or platform not in (None, "", "xcb"):
        return None
    if not display:
        return None if platform else "DISPLAY is not set"
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
    except OSError:
        return None  # not known; what draws needs it and will say so
    xcb.xcb_connect.restype = ctypes.c_void_p
    connection = ctypes.c_void_p(xcb.xcb_connect(None, None))
    failed = xcb.xcb_connection_has_error(connection)
    xcb.xcb_disconnect(connection)
    return f"no X server answers at DISPLAY={display}" if failed else None


def _progress(*columns: str) -> Progress:
    """A progress bar on stderr, removed at its end; none where stderr is no terminal."""
    from rich import progress as bars

    known = {
        "description": lambda: bars.TextColumn("{task.description:9}"),
        "bar": bars.BarColumn,
        "count": bars.MofNCompleteColumn,
        "remaining": bars.TimeRemainingColumn,
        "terms": lambda: bars.TextColumn("{task.fields[terms]}"),
    }
    made = (known[name]() for name in columns)
    return bars.Progress(*made, console=err, transient=True, disable=not err.is_terminal)


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on stderr; call the yielded function with the steps done and their number."""
    with _progress("description", "bar", "count") as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def measurements_progress() -> Iterator[Callable[[int, int, str], None]]:
    """Show the progress of measurements on stderr: a bar on a terminal, else a line every tenth.

    Call the yielded function with finished measurements, all measurements, and a label.
    """
    with _progress("bar", "count", "remaining", "description") as bar:
        task = bar.add_task("", total=None)
        told = -1

        def report(done: int, total: int, text: str) -> None:
            nonlocal told
            bar.update(task, completed=done, total=total, description=_escaped(text))
            tenth = 10 * done // max(total, 1)
            if not err.is_terminal and tenth > told:
                told = tenth
                note(f"{done}/{total}  {text}".rstrip())

        yield report


@contextmanager
def training_progress() -> Iterator[Callable[[Any], None]]:
    """Show the progress of training on stderr: a bar on a terminal, else a line every tenth.

    Call the yielded function with a progress event of `deformer.train`.
    """
    with _progress("description", "bar", "count", "remaining", "terms") as bar:
        tasks: dict[str, Any] = {}
        tenths: dict[str, int] = {}  # last tenth printed of each stage; 0 is its first event

        def report(event: Any) -> None:
            stage, done, total = str(event.stage), int(event.done), max(int(event.total), 1)
            terms = _terms(event) if stage == "training" else ""
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total, terms=terms)
            bar.update(tasks[stage], completed=done, total=total, terms=terms)
            tenth = 10 * done // total
            if not err.is_terminal and tenth > tenths.get(stage, -1):
                tenths[stage] = tenth
                note(f"{stage} {done}/{total}  {terms}".rstrip())

        yield report


def _terms(event: Any) -> str:
    return (
        f"loss {event.loss:.4g}  reconstruction {event.reconstruction:.4g}  "
        f"sparsity {event.sparsity:.4g}  range {event.range:.4g}"
    )


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
