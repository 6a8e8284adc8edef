"""Kernels compiled ahead, side by side: into files that the calls then find."""

import logging
import os
import subprocess
import sys
import textwrap

import numba
import numba.core.compiler
import pytest

import deformer
from deformer import compilation

KERNELS = """
from numba import njit
from deformer.compilation import called_with


@called_with("f8(f8[::1])")
@njit(cache=True)
def total(x):
    s = 0.0
    for i in range(len(x)):
        s += x[i]
    return s


@called_with("i8(i8, i8)")
@njit(cache=True)
def product(a, b):
    return a * b
"""


def run(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout


@pytest.mark.slow
def test_calls_find_what_other_processes_compiled_once_for_all_threads(tmp_path):
    (tmp_path / "kernels_of_a_test.py").write_text(KERNELS)
    code = """
        import logging, sys
        from threading import Thread
        import numpy as np
        from deformer.compilation import compile_kernels
        logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
        threads = [Thread(target=compile_kernels, args=(["kernels_of_a_test"], 2)) for _ in "12"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        import kernels_of_a_test as k
        assert k.total(np.ones(3)) == 3 and k.product(6, 7) == 42
        print(sum(k.total.stats.cache_misses.values()), sum(k.product.stats.cache_misses.values()))
    """
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    first, second = (run(code, **environment).splitlines() for _ in range(2))
    told, misses = first
    assert told.startswith("compiling for this processor")
    assert misses == "0 0"
    assert second == ["0 0"]
    (tmp_path / "kernels_of_a_test.py").write_text(KERNELS + "\n\nCHANGED = True\n")
    assert run(code, **environment).startswith("compiling for this processor")


@pytest.mark.slow
def test_a_solve_calls_kernels_with_the_types_that_they_declare():
    code = """
        import deformer
        from deformer import compilation
        from deformer.editing.nodes import Nodes
        from numba.core.sigutils import normalize_signature
        model = deformer.load_model("humanoid")
        vertices = model.reference.vertices
        for hard in (False, True):
            solver = deformer.HandleSolver(model)
            solver.set_handles([17, 300], vertices[[17, 300]] + 0.1, hard=hard)
            solver.solve()
        of = Nodes.of
        Nodes.of = lambda system: of(system, 400)
        solver = deformer.HandleSolver(model)
        for shift in (0.0, 0.1):  # the second is a frame by nodes
            solver.set_handles([17, 300], vertices[[17, 300]] + shift, hard=True)
            solver.solve(warm=True)
        for module, kernels in compilation._declared.items():
            for kernel, signature in kernels:
                used = set(kernel.stats.cache_hits) | set(kernel.stats.cache_misses)
                used = {u if isinstance(u, tuple) else u.args for u in used}
                declared = normalize_signature(signature)[0]
                print(module, kernel.__name__, len(used), used <= {declared})
    """
    rows = [line.split() for line in run(code).splitlines()]
    assert len(rows) > 15
    assert [row for row in rows if row[2:] != ["1", "True"]] == []


def test_an_interpreter_within_another_program_is_not_started(monkeypatch, caplog, tmp_path):
    started = []
    monkeypatch.setattr(compilation, "_stamp", lambda modules, kernels: tmp_path / "none")
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(a))
    monkeypatch.setattr(sys, "executable", "/opt/modeller/bin/modeller")
    caplog.set_level(logging.INFO, logger="deformer")
    compilation.compile_kernels(["deformer.linalg.sparse_cholesky"], 2)
    assert not started and not caplog.messages


NO_CACHE = """
    from numba.core import caching
    def read_only(self):
        raise OSError(30, "Read-only file system")
    caching._CacheLocator.ensure_cache_path = read_only
"""


@pytest.mark.slow
def test_where_no_cache_can_be_written_kernels_work_and_one_line_says_so():
    code = (
        NO_CACHE
        + """
    import importlib, logging, pkgutil, sys
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    import numpy as np
    import deformer
    from deformer.compilation import compile_kernels
    from deformer.editing import solver
    for module in pkgutil.walk_packages(deformer.__path__, "deformer."):
        importlib.import_module(module.name)
    compile_kernels(solver._KERNELS, 2)
    # A kernel that calls another.
    half_turn = deformer.geometry.log_to_rotation(np.array([0.0, 0.0, np.pi]))
    print(np.abs(half_turn - np.diag([-1.0, -1.0, 1.0])).max() < 1e-12)
    """
    )
    told, met = run(code).splitlines()
    assert "no folder for compiled kernels" in told and "NUMBA_CACHE_DIR" in told
    assert met == "True"


def test_compiling_is_told_while_a_kernel_is_compiled(monkeypatch):
    seen, compile_extra = [], numba.core.compiler.compile_extra

    def watched(*args, **options):
        seen.append(deformer.compiling())
        return compile_extra(*args, **options)

    monkeypatch.setattr(numba.core.compiler, "compile_extra", watched)
    assert not deformer.compiling()
    assert numba.njit(lambda x: x + 1)(1) == 2
    assert seen == [True]
    assert not deformer.compiling()


@pytest.mark.slow
def test_machine_code_that_is_read_from_a_file_is_not_compiled(tmp_path):
    (tmp_path / "kernels_of_a_test.py").write_text(KERNELS)
    code = """
        from deformer import compilation
        begun = []
        compilation._Compilations.on_start = lambda self, event: begun.append(event)
        import kernels_of_a_test as k
        assert k.product(6, 7) == 42
        print(len(begun))
    """
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    assert [run(code, **environment).strip() for _ in range(2)] == ["1", "0"]
