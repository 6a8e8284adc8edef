"""Triangle meshes and sequences of them that share one connectivity, and their edge operators."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from deformer.checks import (
    as_array,
    checked_array,
    checked_indices,
    checked_integer,
    checked_text,
    shortened,
)
from deformer.errors import InputError
from deformer.geometry.links import spanning_links

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def checked_faces(faces: ArrayLike, vertex_count: int) -> IntArray:
    """Faces (F, 3) of a mesh of so many vertices, as read-only int64; InputError for others.

    Returns `faces` itself where it is that already.
    """
    array = as_array(faces, "faces")
    ready = array.dtype == np.int64 and array.flags.c_contiguous and not array.flags.writeable
    ready = ready and array.ndim == 2 and array.shape[1] == 3 and len(array) > 0
    if ready and array.min() >= 0 and array.max() < vertex_count:
        return array
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise InputError(
            f"faces: expected an array of shape (F, 3) with F > 0, got {array.shape}; "
            "triangulate the faces"
        )
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"faces: expected integers, got {array.dtype}; cast the indices to int")
    bad = np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))
    if len(bad):
        raise InputError(
            f"faces[{bad[0]}]: indices {array[bad[0]].tolist()} are outside 0…{vertex_count - 1}; "
            "remove the face or add the missing vertices"
        )
    return _frozen(array.astype(np.int64, order="C"))


# Greatest magnitude of a coordinate: the square of an area must not overflow.
FARTHEST = 1e60


def _check_vertices(vertices: ArrayLike, ndim: int) -> FloatArray:
    array = checked_array(vertices, "vertices", finite=False)
    expected = "(V, 3)" if ndim == 2 else "(N, V, 3)"
    if array.ndim != ndim or array.shape[-1] != 3 or 0 in array.shape:
        raise InputError(f"vertices: expected an array of shape {expected}, got {array.shape}")
    # An array that nobody can write to need not be copied.
    kept = array.flags.owndata and not array.flags.writeable
    array = array.astype(np.float64, copy=not kept)
    bad = np.argwhere(~(np.abs(array) <= FARTHEST))
    if len(bad):
        position = array[tuple(bad[0])]
        wrong = f"is beyond ±{FARTHEST:g}" if np.isfinite(position) else "is not a finite position"
        raise InputError(f"vertices{bad[0][:-1].tolist()}: {position} {wrong}; repair or remove it")
    return _frozen(array)


def checked_names(names: Sequence[str], count: int) -> tuple[str, ...]:
    """Names of `count` shapes, or none; InputError for others."""
    if not isinstance(names, tuple | list):
        raise InputError(f"names: expected a tuple of texts, got {shortened(names)}; list them")
    if names and len(names) != count:
        raise InputError(
            f"names: {len(names)} of them, expected {count} as there are shapes, or none; name "
            "every shape"
        )
    return tuple(checked_text(name, f"names[{n}]") for n, name in enumerate(names))


def _frozen(array: NDArray) -> NDArray:
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Mesh:
    """One triangle mesh.

    Args:
        vertices: (V, 3) finite positions, kept as read-only float64 in the data's own units.
        faces: (F, 3) vertex indices, counter-clockwise seen from outside, kept as int64.

    Raises:
        InputError: wrong shape, an index out of range, or a position that is not finite or is
            beyond ±1e60.
    """

    vertices: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        """Check the arrays and keep read-only copies."""
        object.__setattr__(self, "vertices", _check_vertices(self.vertices, 2))
        object.__setattr__(self, "faces", checked_faces(self.faces, len(self.vertices)))

    @cached_property
    def bounding_diagonal(self) -> float:
        """Length of the diagonal of the axis-aligned bounding box."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def links(self) -> IntArray:
        """Links (B, 2) between the connected components, of `spanning_links`; empty for one."""
        return spanning_links(self.vertices, self.labels)

    @cached_property
    def labels(self) -> IntArray:
        """Connected component (V,) of every vertex, as `connected_components` numbers them."""
        return connected_components(self.faces, len(self.vertices))[1]


@dataclass(frozen=True, eq=False)
class MeshSequence:
    """N shapes with one connectivity.

    Args:
        vertices: (N, V, 3) finite positions, kept as read-only float64 in the data's own units.
        faces: (F, 3) vertex indices shared by all shapes, kept as int64.
        names: N texts, one for each shape; empty if the shapes have no names.

    Raises:
        InputError: wrong shape, an index out of range, a position that is not finite or is beyond
            ±1e60, or another number of names.
    """

    vertices: FloatArray
    faces: IntArray
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the arrays and keep read-only copies."""
        object.__setattr__(self, "vertices", _check_vertices(self.vertices, 3))
        object.__setattr__(self, "faces", checked_faces(self.faces, self.vertices.shape[1]))
        object.__setattr__(self, "names", checked_names(self.names, len(self.vertices)))

    def __len__(self) -> int:
        """Count the shapes."""
        return len(self.vertices)

    def mesh(self, index: int) -> Mesh:
        """Shape `index` as a Mesh; negative indices count from the end.

        Raises:
            InputError: no such shape.
        """
        return Mesh(self.vertices[checked_shape(index, len(self))], self.faces)

    def subset(self, indices: ArrayLike) -> MeshSequence:
        """Shapes at `indices` (n,), in that order.

        Raises:
            InputError: no such shape.
        """
        chosen = checked_indices(indices, "indices", len(self), what="shape")
        names = tuple(self.names[i] for i in chosen) if self.names else ()
        return MeshSequence(self.vertices[chosen], self.faces, names)


def checked_shape(index: int, count: int) -> int:
    """The index of one of so many shapes; negative ones count from the end."""
    index = checked_integer(index, "shape")
    if not -count <= index < count:
        raise InputError(f"shape {index} does not exist; the sequence has {count} shapes")
    return index


def edges(faces: IntArray) -> IntArray:
    """Undirected edges (E, 2) of `faces` (F, 3), each once with the smaller index first, sorted."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    half = np.sort(half[half[:, 0] != half[:, 1]], axis=1)
    # One number an edge: rows take twenty times as long to sort.
    V = half.max(initial=0) + 1
    return np.stack(np.divmod(np.unique(half[:, 0] * V + half[:, 1]), V), axis=1)


def one_rings(faces: IntArray, vertex_count: int) -> tuple[IntArray, IntArray]:
    """One-ring neighbours of every vertex in compressed rows.

    Args:
        faces: (F, 3) int64 vertex indices.
        vertex_count: V.

    Returns:
        indptr (V+1,) and neighbours (2E,): the ring of i is neighbours[indptr[i]:indptr[i+1]],
        in increasing order; empty for a vertex without a face.
    """
    pairs = edges(faces)
    matrix = sparse.csr_array(
        (np.ones(2 * len(pairs)), (pairs.T.ravel(), pairs[:, ::-1].T.ravel())),
        shape=(vertex_count, vertex_count),
    )
    matrix.sort_indices()
    return matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64)


def site_rings(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Neighbours of every site of a mesh: of the V vertices, then of the B links.

    A vertex has its one-ring, a link the two vertices that it joins.

    Returns:
        indptr (V+B+1,) and neighbours (2E+2B,), as of `one_rings`.
    """
    indptr, rings = one_rings(mesh.faces, len(mesh.vertices))
    ends = indptr[-1] + 2 * np.arange(1, len(mesh.links) + 1)
    return np.concatenate([indptr, ends]), np.concatenate([rings, mesh.links.ravel()])


def connected_components(faces: IntArray, vertex_count: int) -> tuple[int, IntArray]:
    """Number of connected components, and the component (V,) of every vertex.

    Components are numbered from 0 in the order of their first vertices.

    Args:
        faces: (F, 3) int64 vertex indices.
        vertex_count: V.
    """
    roots, labels = np.unique(component_roots(edges(faces), vertex_count), return_inverse=True)
    return len(roots), labels.astype(np.int64)


def component_roots(pairs: IntArray, count: int) -> IntArray:
    """The least member (n,) of the group of each of n things that pairs (m, 2) join to groups."""
    # scipy.sparse.csgraph does the same, but its import takes longer than solving for a pose.
    first, second = pairs.T
    root = np.arange(count)
    while True:
        # Each root is joined to the least root that an edge of its tree leads to.
        low = np.minimum(root[first], root[second])
        found = root.copy()
        np.minimum.at(found, root[first], low)
        np.minimum.at(found, root[second], low)
        while not np.array_equal(found, higher := found[found]):
            found = higher
        if np.array_equal(found, root):
            return root
        root = found


def connectivity_hash(faces: IntArray, vertex_count: int) -> str:
    """SHA-256 of `vertex_count` and `faces` (F, 3) in order: equal only for equal connectivity."""
    digest = hashlib.sha256(f"{vertex_count}\n".encode())
    digest.update(np.ascontiguousarray(faces, dtype="<i8").tobytes())
    return digest.hexdigest()
