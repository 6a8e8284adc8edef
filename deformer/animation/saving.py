"""Sequences of shapes written like the file that they came from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deformer.animation.clips import Clip, morph_glb
from deformer.animation.morphing import checked_tolerance, diagonal, morph_targets
from deformer.animation.point_caches import write_mdd, write_pc2
from deformer.checks import (
    check_memory,
    checked_instance,
    checked_integer,
    checked_number,
    checked_path,
    checked_text,
)
from deformer.documents import (
    USD_SUFFIXES,
    Document,
    Like,
    document_of,
    save_mesh,
    up_of,
    upright_glb,
    write_usd,
)
from deformer.errors import InputError
from deformer.geometry import FloatArray, Mesh, MeshSequence, ShapeSequence, StoredShapes
from deformer.io import (
    MESH_SUFFIXES,
    atomic_path,
    check_output_file,
    check_shapes_output as check_bare_output,
    load_mesh,
    mesh_bytes,
    save_shape_files,
    usd_library,
    write_npz,
)

FPS = 24.0
TOLERANCE = 1e-3
CACHE_SUFFIXES = (".mdd", ".pc2")
SEQUENCE_SUFFIXES = (".npz", ".glb", *CACHE_SUFFIXES, *USD_SUFFIXES)
"""Suffixes of files that `save_shapes` writes a whole sequence to."""
# Files of other programs: nobody names a directory so.
_FOREIGN_SUFFIXES = (
    *(".gltf", ".usdz", ".abc", ".fbx", ".dae", ".3ds", ".x3d", ".bvh", ".blend", ".ma", ".mb"),
    *(".json", ".zip", ".gif", ".mp4", ".png", ".txt", ".csv"),
)
_MOST_FPS = 1e6
# Arrays of the positions' size that are in memory where GLB or USD is written.
_COPIES = 4


@dataclass(frozen=True)
class SavedShapes:
    """What `save_shapes` has written.

    Args:
        files: the files, or the directory.
        targets: number of morph targets; None for formats without.
        principal: false if the targets are the shapes themselves, for as many were needed.
        error: largest distance of a vertex from its place, as a share of the bounding-box diagonal
            of the first shape; None for formats without morph targets.
    """

    files: tuple[Path, ...]
    targets: int | None = None
    principal: bool = True
    error: float | None = None


def save_shapes(
    path: str | Path,
    shapes: ShapeSequence,
    format: str | None = None,
    like: Like | None = None,
    *,
    fps: float = FPS,
    tolerance: float = TOLERANCE,
    name: str | None = None,
    up: str | None = None,
) -> SavedShapes:
    """Write a sequence in the format of the suffix, or as a directory of files 0000, 0001, ….

    - .npz: `vertices` (N, V, 3), `faces` (F, 3), and `names` if the shapes have some;
    - .glb: morph targets, as few as the tolerance needs, and a clip of their weights; at rest the
      mesh is the first shape;
    - .mdd, .pc2: a point cache; the first shape is written beside it as a mesh of the same name,
      unless there is one of the same connectivity;
    - .usd, .usda, .usdc: a mesh with time samples, which needs the extra "usd";
    - no suffix: a directory. An existing one is replaced as a whole if this function has written
      all its files.

    Args:
        path: the file or directory.
        shapes: the sequence; one in a file (`StoredShapes`) is written some shapes at a time, but
            for GLB and USD it is taken into memory.
        format: "obj", "ply", "off", "stl" or "glb", with a USD document also "usd", "usda" or
            "usdc", for a directory; None is that of the document, or PLY without one. See
            `save_mesh` on precision.
        like: what the files have beside positions and triangles, as of `save_mesh`.
        fps: frames a second.
        tolerance: of a GLB, the largest distance of a vertex from its place, as a share of the
            bounding-box diagonal of the first shape. Rounding to single precision comes on top.
        name: of GLB and USD, name of the clip and of a mesh without a document; None is the stem
            of the path.
        up: "y" or "z", the axis that points up, unless the document is GLB or USD, which say so
            themselves; None is that of a model given as `like`, else y. USD says which; GLB has y
            up, so that clips of other documents have a node that turns z up, which `load_shapes`
            and `load_mesh` leave out. Coordinates stay.

    Returns:
        the files, and the number and the error of the morph targets.

    Raises:
        InputError: an unknown suffix or format, a directory with other contents, a document of
            another mesh, a parent that is missing or not writable, another mesh beside a point
            cache, or a position too large for the format.
    """
    target = checked_path(path, "path")
    if not isinstance(shapes, StoredShapes):
        checked_instance(shapes, "shapes", MeshSequence, remedy="make one of vertices and faces")
    if format is not None:
        checked_text(format, "format")
    tolerance = checked_tolerance(tolerance)
    fps = checked_number(fps, "fps", above=0, most=_MOST_FPS, remedy="give frames a second")
    up = up_of(like, up)
    label = target.stem if name is None else checked_text(name, "name")
    document = document_of(like)
    if document is not None:
        document.check_fits(shapes.vertices.shape[1], shapes.faces)
    check_shapes_output(target)
    suffix = target.suffix.lower()
    if suffix == ".glb":
        return _save_clip(target, _in_memory(target, shapes), document, label, fps, tolerance, up)
    if suffix in CACHE_SUFFIXES:
        return _save_cache(target, shapes, document, fps)
    if suffix in USD_SUFFIXES:
        whole = _in_memory(target, shapes)
        with atomic_path(target) as temporary:
            write_usd(temporary, whole.vertices, shapes.faces, document, name=label, up=up, fps=fps)
    elif suffix == ".npz":
        named = {"names": np.array(shapes.names)} if shapes.names else {}
        write_npz(target, {"vertices": shapes.vertices, "faces": shapes.faces, **named})
    else:
        chosen = format or ("ply" if document is None else document.suffix)
        save_shape_files(target, shapes, chosen, _writer(shapes, chosen, document, up))
    return SavedShapes((target,))


def check_shapes_output(path: str | Path) -> None:
    """Check, before there are shapes, that `save_shapes` can write them to `path`.

    Raises:
        InputError: as `save_shapes` would raise.
    """
    target = checked_path(path, "path")
    suffix = target.suffix.lower()
    if suffix in USD_SUFFIXES:
        usd_library(target)
    if suffix in SEQUENCE_SUFFIXES:
        check_output_file(target)
    elif suffix in (*MESH_SUFFIXES, *_FOREIGN_SUFFIXES) and not target.is_dir():
        what = "one mesh file" if suffix in MESH_SUFFIXES else f"a file of format {suffix}"
        raise InputError(
            f"{target}: names {what}, expected one of {', '.join(SEQUENCE_SUFFIXES)} or a "
            "directory for a sequence; leave the suffix out or give another"
        )
    else:
        check_bare_output(target)


def check_shapes_size(path: str | Path, shapes: int, vertices: int) -> None:
    """Check, before there are shapes, that a file of so many can be written.

    NPZ, point caches and directories are written some shapes at a time, whatever their number; GLB
    and USD as a whole.

    Args:
        path: as of `save_shapes`.
        shapes: N.
        vertices: V of each.

    Raises:
        InputError: memory does not hold what the format needs at once.
    """
    target = checked_path(path, "path")
    N = checked_integer(shapes, "shapes", least=1)
    V = checked_integer(vertices, "vertices", least=1)
    if target.suffix.lower() not in (".glb", *USD_SUFFIXES):
        return
    try:
        check_memory(_COPIES * 24 * N * V, f"{target}: {N} shapes of {V} vertices")
    except InputError as error:
        raise InputError(
            f"{error}, or write .npz, .mdd, .pc2 or a directory, which need not be in memory"
        ) from None


def _in_memory(path: Path, shapes: ShapeSequence) -> MeshSequence:
    """Shapes whose positions are in memory, for a format that is written as a whole."""
    if isinstance(shapes, MeshSequence):
        return shapes
    check_shapes_size(path, *shapes.vertices.shape[:2])
    return MeshSequence(shapes.vertices[:], shapes.faces, shapes.names)


def _writer(
    shapes: ShapeSequence, format: str, document: Document | None, up: str
) -> Callable | None:
    """What writes one shape of a directory; None for positions and triangles as they are."""
    if document is None and (up == "y" or format.lower().removeprefix(".") != "glb"):
        return None

    def write(vertices: FloatArray, suffix: str) -> bytes:
        if document is None:
            data = mesh_bytes(Mesh(vertices, shapes.faces), suffix)
        else:
            data = document.write(vertices, suffix)
        return upright_glb(data, up, document) if suffix == ".glb" else data

    return write


def _save_clip(
    path: Path,
    shapes: MeshSequence,
    document: Document | None,
    name: str,
    fps: float,
    tolerance: float,
    up: str,
) -> SavedShapes:
    size = diagonal(shapes.vertices[0])
    found = morph_targets(shapes.vertices, tolerance * size, shapes.names)
    times = np.arange(len(shapes)) / fps
    rate = fps if found.principal else None
    clips = [Clip(name, times, found.weights, rate)] if len(found.targets) else []
    data = morph_glb(found.base, shapes.faces, found.targets, found.names, clips, document, name)
    with atomic_path(path) as temporary:
        temporary.write_bytes(upright_glb(data, up, document))
    error = found.error / size if size > 0 else found.error
    return SavedShapes((path,), len(found.targets), found.principal, error)


def _save_cache(
    path: Path, shapes: ShapeSequence, document: Document | None, fps: float
) -> SavedShapes:
    kind = ".obj" if document is None or document.suffix not in (".obj", ".ply") else None
    base = path.with_suffix(kind or (document.suffix if document else ".obj"))
    there = base.exists()
    if there:
        mesh = load_mesh(base)
        if not (
            len(mesh.vertices) == shapes.vertices.shape[1]
            and np.array_equal(mesh.faces, shapes.faces)
        ):
            raise InputError(
                f"{base}: is another mesh, expected that of the point cache {path.name} beside it; "
                "choose another name for the cache, or move the mesh away"
            )
    with atomic_path(path) as temporary:
        if path.suffix.lower() == ".mdd":
            write_mdd(temporary, shapes.vertices, fps)
        else:
            write_pc2(temporary, shapes.vertices)
        # Before the cache is in its place: an interrupt never leaves one without its mesh.
        if not there:
            save_mesh(base, Mesh(shapes.vertices[0], shapes.faces), document)
    return SavedShapes((path, base))
