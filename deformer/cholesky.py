"""Sparse Cholesky: factor a symmetric positive definite matrix once, solve many times."""

from __future__ import annotations

import threading

import numpy as np
from cholespy import CholeskySolverD, MatrixType  # pyright: ignore[reportAttributeAccessIssue]
from scipy import sparse

from deformer.mesh import FloatArray

# cholespy takes at most 128 right-hand sides at once.
_MAX_COLUMNS = 120


class SparseCholesky:
    """Factor of a symmetric positive definite matrix A (n, n); float64."""

    def __init__(self, matrix: sparse.sparray) -> None:
        """Factor `matrix` (AMD ordering)."""
        A = sparse.coo_array(matrix)
        self._solver = CholeskySolverD(
            len(A.diagonal()),
            A.row.astype(np.int32),
            A.col.astype(np.int32),
            A.data.astype(np.float64),
            MatrixType.COO,
        )
        # cholespy's solver object keeps one work buffer.
        self._lock = threading.Lock()

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution x (n, m) of A x = b for right-hand sides b (n, m)."""
        x = np.empty(b.shape)
        with self._lock:
            for start in range(0, b.shape[1], _MAX_COLUMNS):
                part = np.ascontiguousarray(b[:, start : start + _MAX_COLUMNS], dtype=np.float64)
                out = np.empty_like(part)
                self._solver.solve(part, out)
                x[:, start : start + _MAX_COLUMNS] = out
        return x
