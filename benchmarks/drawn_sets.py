"""Sets of any size, drawn from the shipped humanoid, for benchmarks of growth."""

import zipfile
from pathlib import Path

import numpy as np
from scipy import sparse

import deformer
from deformer.geometry import edges


def write_shapes(path: Path, count: int, vertices: int) -> None:
    """Write shapes of so many vertices to an NPZ file, a few at a time in memory."""
    model = deformer.load_model("humanoid")
    rng = np.random.default_rng(0)
    codes = model.prior.mean + rng.normal(size=(count, model.components)) @ model.prior.factor.T
    codes[0] = 0.0
    lift, faces = subdivided(model.reference, vertices)
    raw = path.with_suffix(".npy")
    out = np.lib.format.open_memmap(raw, "w+", np.float32, (count, lift.shape[0], 3))
    for n, code in enumerate(codes):
        out[n] = lift @ model.decode(code)
    out.flush()
    del out
    face_file = path.with_name("faces.npy")
    np.save(face_file, faces)
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(raw, "vertices.npy")
        archive.write(face_file, "faces.npy")
    raw.unlink()


def subdivided(mesh: deformer.Mesh, vertices: int):
    """Interpolation (W, V) to a mesh of so many vertices, and its faces."""
    lift, faces = sparse.eye_array(len(mesh.vertices), format="csr"), mesh.faces
    while lift.shape[0] < vertices:
        pairs = edges(faces)
        # Only as many edges as are needed: those of the first faces.
        rng = np.random.default_rng(1)
        wanted = min(len(pairs), vertices - lift.shape[0])
        chosen = np.zeros(len(pairs), dtype=bool)
        chosen[rng.permutation(len(pairs))[:wanted]] = True
        if wanted < len(pairs):
            # Not all of them are split at once: each face only once.
            lift, faces = split_some(lift, faces, pairs[chosen])
            continue
        V = lift.shape[0]
        number = {tuple(pair): V + n for n, pair in enumerate(pairs.tolist())}
        rows = np.repeat(np.arange(len(pairs)), 2)
        middle = sparse.csr_array(
            (np.full(2 * len(pairs), 0.5), (rows, pairs.ravel())), shape=(len(pairs), V)
        )
        lift = sparse.vstack([lift, middle @ lift]).tocsr()
        new = []
        for a, b, c in faces.tolist():
            ab, bc, ca = (number[tuple(sorted(p))] for p in ((a, b), (b, c), (c, a)))
            new += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.array(new)
    return lift, faces


def split_some(lift, faces, pairs):
    """Split single edges of faces, each face at most once."""
    V, faces = lift.shape[0], faces.tolist()
    at: dict[tuple[int, int], list[int]] = {}
    for f, (a, b, c) in enumerate(faces):
        for pair in ((a, b), (b, c), (c, a)):
            at.setdefault(tuple(sorted(pair)), []).append(f)
    touched, ends = set(), []
    for pair in map(tuple, pairs.tolist()):
        if touched & set(at[pair]):
            continue
        touched |= set(at[pair])
        middle = V + len(ends)
        ends.append(pair)
        for f in at[pair]:
            corners = faces[f]
            turn = next(i for i in range(3) if {corners[i], corners[(i + 1) % 3]} == set(pair))
            a, b, c = corners[turn:] + corners[:turn]
            faces[f] = [a, middle, c]
            faces.append([middle, b, c])
    rows = np.repeat(np.arange(len(ends)), 2)
    half = sparse.csr_array(
        (np.full(2 * len(ends), 0.5), (rows, np.ravel(ends))), shape=(len(ends), V)
    )
    return sparse.vstack([lift, half @ lift]).tocsr(), np.array(faces)
