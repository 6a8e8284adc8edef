"""Compilation of kernels: kept in files, and side by side once a machine.

Numba compiles a kernel when it is first called, one after the other, and keeps the machine code in
a file (`njit`). `compile_kernels` fills these files on all cores at once, in processes of its own
(numba holds the interpreter's lock while it compiles), for kernels that say which types they are
called with.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

from deformer.compilation_state import begin_compiling, counted_as_compiling, end_compiling

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_log = logging.getLogger("deformer")
_declared: dict[str, list[tuple[Dispatcher, str]]] = {}  # by module


class _Compilations(event.Listener):
    """Counts compilations, but not machine code that is read from a file."""

    def on_start(self, event: event.Event) -> None:
        begin_compiling()

    def on_end(self, event: event.Event) -> None:
        end_compiling()


event.register("numba:compile", _Compilations())


def njit(**options: Any) -> Callable[[Kernel], Kernel]:
    """Numba's decorator, with machine code kept in a file where one can be written.

    Args:
        options: numba's own, without `cache`.
    """

    def decorate(function: Kernel) -> Kernel:
        try:
            return cast(Kernel, numba.njit(cache=True, **options)(function))
        except RuntimeError as error:  # neither the package's folder nor the user's is writable
            if "cannot cache" not in str(error):
                raise
        _tell_of_no_cache()
        return cast(Kernel, numba.njit(**options)(function))

    return decorate


@functools.cache
def _tell_of_no_cache() -> None:
    _log.warning(
        "no folder for compiled kernels can be written: each run compiles them again, which takes "
        "a minute or two; set NUMBA_CACHE_DIR to a folder that can be written"
    )


def called_with(signature: str) -> Callable[[Kernel], Kernel]:
    """Decorator over `njit`: the types that the library calls the kernel with.

    Args:
        signature: numba's own notation. Other types remain possible; they are compiled when they
            are first used.
    """

    def declare(kernel: Kernel) -> Kernel:
        dispatcher: object = kernel
        if isinstance(dispatcher, Dispatcher):  # a plain function where NUMBA_DISABLE_JIT is set
            _declared.setdefault(dispatcher.py_func.__module__, []).append((dispatcher, signature))
        return kernel

    return declare


def compile_kernels(modules: Sequence[str], cores: int) -> None:
    """Compile the kernels of modules, unless that has been done with this numba and processor.

    It warns of the wait on the logger "deformer". Threads and processes that need the same kernels
    wait for the first of them.

    Args:
        modules: names of modules, already imported or not.
        cores: number of processes. With one, or where the interpreter is not a program of its own,
            as within another application, nothing is done: calls then compile as ever.
    """
    program = Path(sys.executable or "")
    if cores < 2 or not program.stem.lower().startswith("python"):
        return
    kernels = _kernels(modules)
    stamp = _stamp(modules, kernels)
    if stamp is None or stamp.exists():
        return
    from filelock import FileLock  # only for this: it imports asyncio

    stamp.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{stamp}.lock"):
        if not stamp.exists():
            _log.warning("compiling for this processor: a minute or two, once")
            with counted_as_compiling():
                _run_shares(program, cores, tuple(modules))
            # What a process failed to compile is compiled by the call that needs it.
            stamp.touch()


def _run_shares(program: Path, shares: int, modules: tuple[str, ...]) -> None:
    """Compile all shares, each in a process of its own.

    None is compiled here: numba does not survive Ctrl-C while it compiles, and a window would move
    by fits and starts.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    code = f"from {__name__} import _compile_share; _compile_share(%d, {shares}, {modules})"
    processes = [
        subprocess.Popen(
            [str(program), "-c", code % share],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for share in range(shares)
    ]
    try:
        for process in processes:
            process.wait()
    finally:
        for process in processes:
            process.kill()  # after Ctrl-C; one that has ended is not there any more


def _kernels(modules: Sequence[str]) -> list[tuple[Dispatcher, str]]:
    for module in modules:
        importlib.import_module(module)
    return [entry for module in modules for entry in _declared.get(module, [])]


def _stamp(modules: Sequence[str], kernels: Sequence[tuple[Dispatcher, str]]) -> Path | None:
    """File that says that the kernels are compiled, beside them; None if none can be kept."""
    if not kernels or kernels[0][0].stats.cache_path is None:
        return None
    state = [numba.__version__, sys.version, llvmlite.binding.get_host_cpu_name()]
    state += [os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")]
    for module in modules:
        source = Path(str(sys.modules[module].__file__)).stat()
        state.append(f"{module} {source.st_mtime_ns} {source.st_size}")
    digest = hashlib.sha256("\n".join(state).encode()).hexdigest()[:16]
    return Path(str(kernels[0][0].stats.cache_path)) / f"kernels-{digest}.compiled"


def _compile_share(share: int, shares: int, modules: Sequence[str]) -> None:
    """Compile one of the shares: the largest kernels first, each to the share with the least."""
    loads = [0] * shares
    kernels = _kernels(modules)
    mine = []
    for kernel, signature in sorted(kernels, key=lambda entry: -_size(entry[0])):
        least = loads.index(min(loads))
        loads[least] += _size(kernel)
        if least == share:
            mine.append((kernel, signature))
    for kernel, signature in mine:
        # As calls do, which look for machine code by the types of the arguments alone.
        arguments, _ = normalize_signature(signature)
        kernel.compile(arguments)


def _size(kernel: Dispatcher) -> int:
    """Length of the byte code of a kernel and of what it calls: a guess at the time it takes."""
    function = kernel.py_func
    called = (function.__globals__.get(name) for name in function.__code__.co_names)
    below = [_size(other) for other in called if isinstance(other, Dispatcher)]
    return len(function.__code__.co_code) + sum(below)
