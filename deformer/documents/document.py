"""A mesh file kept as it is, so that other positions can be written into it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import (
    checked_array,
    checked_choice,
    checked_instance,
    checked_integer,
    checked_number,
    checked_path,
    checked_text,
    shortened,
)
from deformer.documents.glb import rewritten_glb
from deformer.documents.glb_polygons import glb_of_polygons, glb_polygons
from deformer.documents.obj import (
    ObjFile,
    material_colours,
    material_libraries,
    obj_of,
)
from deformer.documents.off import off_of
from deformer.documents.ply import ply_of, ply_polygons, rewritten_ply
from deformer.documents.polygons import PolygonMesh
from deformer.documents.usd_file import flattened_usd, opened_usd, rewritten_usd, up_axis
from deformer.documents.usd_polygons import usd_polygons
from deformer.errors import InputError
from deformer.geometry import FARTHEST, FloatArray, IntArray, Mesh, checked_faces
from deformer.io import (
    SHAPE_SUFFIXES,
    GltfAsset,
    GltfScene,
    load_mesh,
    mesh_bytes,
    open_usd,
    packed_gltf,
    read_bytes,
    read_gltf,
    scene_up,
    shape_files,
)

DOCUMENT_SUFFIXES = (".obj", ".ply", ".glb", ".usdc")
USD_SUFFIXES = (".usd", ".usda", ".usdc")
T = TypeVar("T")
_MOST_LIBRARY = 10_000_000  # bytes of a material library


@dataclass(frozen=True, eq=False, repr=False)
class Document:
    """A mesh file with all that it has beside positions and triangles.

    Args:
        suffix: ".obj", ".ply", ".glb" or ".usdc", the format of `data`.
        data: contents of the file; a GLB has all buffers and images inside, and a USD stage all
            layers, but no textures.
        name: stem of the file's name.
        vertex_count: V.
        faces: (F, 3) the file's triangles, as `load_shapes` reads them.
        colours: base colours, linear RGBA of 0 to 1, of materials that the file names and another
            file describes, by name.

    Raises:
        InputError: another suffix, faces that are not those of so many vertices, or a part of
            another type.
    """

    suffix: str
    data: bytes
    name: str
    vertex_count: int
    faces: IntArray
    colours: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the parts."""
        remedy = "load one with load_document"
        checked_choice(self.suffix, "suffix", DOCUMENT_SUFFIXES, remedy=remedy)
        checked_instance(self.data, "data", bytes, remedy=remedy)
        checked_text(self.name, "name", remedy=remedy)
        count = checked_integer(self.vertex_count, "vertex_count", least=1, remedy=remedy)
        object.__setattr__(self, "faces", checked_faces(self.faces, count))
        checked_instance(self.colours, "colours", Mapping, remedy=remedy)
        for name, colour in self.colours.items():
            checked_text(name, "colours", remedy=remedy)
            rows = checked_array(colour, f"colours: {shortened(name)}", (4,), remedy=remedy)
            for number in rows.tolist():
                checked_number(number, f"colours: {shortened(name)}", least=0, most=1)

    def __repr__(self) -> str:
        """One line: name and vertices."""
        return f"Document({self.name}{self.suffix}, {self.vertex_count} vertices)"

    @property
    def libraries(self) -> tuple[str, ...]:
        """Names of the material libraries that an OBJ document refers to; else none."""
        return tuple(material_libraries(self.data)) if self.suffix == ".obj" else ()

    def check_fits(self, vertex_count: int, faces: IntArray) -> None:
        """Raise InputError unless a mesh has the document's vertices and faces.

        Args:
            vertex_count: vertices of the mesh.
            faces: (F, 3) its triangles.
        """
        if vertex_count != self.vertex_count or not np.array_equal(faces, self.faces):
            raise InputError(
                f"document {self.name}{self.suffix}: {self.vertex_count} vertices and "
                f"{len(self.faces)} triangles, and the mesh has {vertex_count} and {len(faces)}, "
                "or others; give the document of the mesh's own file, or none"
            )

    def write(self, vertices: ArrayLike, suffix: str | None = None) -> bytes:
        """The file with other positions, or what another format knows of it.

        In the document's own format everything else stays; normals and tangents are recomputed
        where the file has them, split as they were. Into another format go polygons, texture
        coordinates, normals, vertex colours, names and base colours of materials, and names of
        objects and groups, as far as it has them; never textures.

        Args:
            vertices: (V, 3) positions, in the file's order.
            suffix: suffix of a mesh format; None for the document's own. A USD document is written
                as .usd, .usda or .usdc.

        Raises:
            InputError: an array of another shape, positions that are not finite or too large for
                the format, an unknown suffix, a file that is damaged beside its positions and
                triangles, or a USD document without usd-core.
        """
        points = checked_array(vertices, "vertices", (self.vertex_count, 3), largest=FARTHEST)
        target = self.suffix if suffix is None else checked_text(suffix, "suffix").lower()
        if self.suffix == ".usdc" and target in USD_SUFFIXES:
            return self.rewritten_usd(points[None], target)
        if target == self.suffix:
            return self.guarded(lambda: self._rewritten(points))
        if target in _WRITERS:
            polygons = self.polygons()
            return self.guarded(lambda: _WRITERS[target](points, polygons, self.faces))
        return mesh_bytes(Mesh(points, self.faces), target)

    def rewritten_usd(self, shapes: FloatArray, suffix: str, fps: float | None = None) -> bytes:
        """The stage of a USD document with the positions of several shapes.

        Args:
            shapes: (F, V, 3) positions; one without `fps`.
            suffix: ".usd", ".usda" or ".usdc".
            fps: frames a second of time samples; None for a pose without.

        Raises:
            InputError: as of `write`.
        """
        return self.guarded(lambda: rewritten_usd(self.data, shapes, suffix, self._label, fps))

    def guarded(self, write: Callable[[], T]) -> T:
        """What a function returns that works on the document's contents.

        Raises:
            InputError: the function fails in any way.
        """
        try:
            return write()
        except InputError:
            raise
        # The reader has looked at positions and triangles alone; the rest may hold anything.
        except Exception as error:
            raise InputError(
                f"document {self.name}{self.suffix}: damaged in a way that stops the writer "
                f"({type(error).__name__}); write positions and triangles alone, or export the "
                "file again and train on it"
            ) from error

    @property
    def _label(self) -> str:
        return f"document {self.name}{self.suffix}"

    @cached_property
    def _up(self) -> str | None:
        return self.guarded(lambda: up_axis(opened_usd(self.data, self._label)))

    @property
    def up(self) -> str | None:
        """The axis of the data that points up, "y" or "z"; None for formats that do not say.

        That of GLB is y, but z where this program has put the data on a node that turns it.

        Raises:
            InputError: a USD document that is damaged, or usd-core is missing.
        """
        if self.suffix == ".usdc":
            return self._up
        if self.suffix != ".glb":
            return None
        return self.guarded(lambda: scene_up(GltfAsset(self.data, self._label).json))

    @cached_property
    def _usd_polygons(self) -> PolygonMesh:
        return usd_polygons(opened_usd(self.data, self._label))

    @cached_property
    def _obj(self) -> ObjFile:
        """The parsed text of an OBJ file."""
        return ObjFile(self.data)

    def _rewritten(self, points: FloatArray) -> bytes:
        match self.suffix:
            case ".obj":
                return self._obj.written(points)
            case ".ply":
                return rewritten_ply(self.data, points, self.faces)
            case _:
                return rewritten_glb(self.data, points)

    def polygons(self) -> PolygonMesh:
        """What the document has of all that mesh formats have in common.

        Raises:
            InputError: the document is damaged.
        """
        return self.guarded(self._read_polygons)

    def _read_polygons(self) -> PolygonMesh:
        match self.suffix:
            case ".obj":
                return self._obj.polygons(self.colours)
            case ".ply":
                return ply_polygons(self.data)
            case ".usdc":
                return self._usd_polygons
            case _:
                return glb_polygons(self.data)


_WRITERS: dict[str, Callable[[FloatArray, PolygonMesh, IntArray], bytes]] = {
    ".obj": lambda vertices, mesh, _: obj_of(vertices, mesh),
    ".ply": lambda vertices, mesh, _: ply_of(vertices, mesh),
    ".off": lambda vertices, mesh, _: off_of(vertices, mesh),
    ".glb": lambda vertices, mesh, faces: glb_of_polygons(vertices, mesh, faces)[0],
}


def load_document(path: str | Path) -> Document | None:
    """The document of shapes that `load_shapes` loads: their first file.

    Args:
        path: as of `load_shapes`.

    Returns:
        the document; None for files that have nothing beside positions and triangles, which are
        NPZ, OFF and STL.

    Raises:
        InputError: the file is missing, broken or of another kind.
    """
    files = shape_files(checked_path(path, "path"))
    file = files[0]
    suffix = file.suffix.lower()
    if suffix in (*USD_SUFFIXES, ".usdz"):
        return _usd_document(file, len(files) == 1)
    if suffix not in (*DOCUMENT_SUFFIXES, ".gltf"):
        if suffix not in (*SHAPE_SUFFIXES, ".npz"):
            load_mesh(file)
        return None
    if suffix in (".glb", ".gltf"):
        scene = GltfScene(read_gltf(file))
        count, faces = scene.vertex_count, scene.faces
    else:
        mesh = load_mesh(file)
        count, faces = len(mesh.vertices), mesh.faces
    data = read_bytes(file)
    if suffix == ".gltf" or (suffix == ".glb" and _has_other_files(file)):
        suffix, data = ".glb", packed_gltf(file)
    colours = _library_colours(file, data) if suffix == ".obj" else {}
    return Document(suffix, data, file.stem, count, faces, colours)


def _usd_document(file: Path, alone: bool) -> Document:
    """The document of a USD file; `alone` is true if it is no file of a directory of several."""
    mesh = load_mesh(file)
    scene = open_usd(file)
    faces = scene.faces(base=alone)
    try:
        data = flattened_usd(scene, file.parent)
    except InputError:
        raise
    # What the library says of a stage that it cannot flatten is as varied as stages are.
    except Exception as error:
        raise InputError(
            f"{file}: cannot be flattened ({type(error).__name__}); export one flattened file"
        ) from error
    return Document(".usdc", data, file.stem, len(mesh.vertices), faces)


def _has_other_files(file: Path) -> bool:
    """True if a GLB has buffers or images outside of itself."""
    description = read_gltf(file).json
    items = [*description.get("buffers", []), *description.get("images", [])]
    return any("uri" in item for item in items)


def _library_colours(file: Path, data: bytes) -> dict[str, tuple[float, ...]]:
    """Base colours in the material libraries beside an OBJ file; a missing one has none."""
    found: dict[str, tuple[float, ...]] = {}
    for name in material_libraries(data):
        # A library is looked for in the file's own folder alone, whatever its path.
        library = file.parent / name.replace("\\", "/").rpartition("/")[2]
        if library.is_file() and 0 < library.stat().st_size <= _MOST_LIBRARY:
            found |= material_colours(read_bytes(library))
    return found


def checked_document(document: object, name: str) -> Document | None:
    """A document or None; InputError for anything else."""
    if document is None:
        return None
    return checked_instance(document, name, Document, remedy="load one with load_document")
