"""Rig: bones, weights and a clip; poses of bones to vertices, and the bones of given vertices."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import vertex_normals
from deformer.checks import LARGEST, check_memory, checked_array, checked_number
from deformer.documents import Like, document_of, up_of, upright_glb
from deformer.geometry import FloatArray, IntArray, Mesh, Seams, no_seams
from deformer.io import atomic_path, check_output_file
from deformer.rigging.matrices import Frame, local_matrices, world_matrices
from deformer.rigging.neighbourhoods import stray_share, surface_graph
from deformer.rigging.rig_glb import rig_glb
from deformer.rigging.transforms import fitted_transforms, moments, skinned


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """A mesh with bones: what `deformer.rig` makes of a model.

    A matrix (4, 4) of a bone takes points of its own frame, whose origin is its joint, to the
    world; all are rotations and translations. The vertex v of the reference is skinned to
    Σ_b w_b M_b R_b⁻¹ v, with R_b the bone's rest matrix.

    Args:
        reference: the mesh of V vertices in the pose in which the bones are bound to it.
        weights: (V, B) shares ≥ 0 of the bones in each vertex, with the sum 1.
        names: B names of the bones.
        parents: (B,) index of each bone's parent, which comes before it; −1 for the root.
        rest: (B, 4, 4) matrices of the bones in the reference: translations.
        clip: (N, B, 4, 4) matrices of the bones in the N training shapes.
        error: E_rms of the clip against the training shapes as the model decodes them, in the
            data's units, nothing aligned.
        joint_gap: root mean square distance by which bones come apart at their joints in the
            shapes that the rig was fitted to, in the data's units.
        seams: vertices of the reference that are one on its surface, as in the model; None is none.
    """

    reference: Mesh
    weights: FloatArray
    names: tuple[str, ...]
    parents: IntArray
    rest: FloatArray
    clip: FloatArray
    error: float
    joint_gap: float
    seams: Seams | None = None

    def __repr__(self) -> str:
        """One line: how many vertices, bones and shapes of the clip."""
        return (
            f"Rig({len(self.weights)} vertices, {len(self.names)} bones, {len(self.clip)} shapes "
            "in the clip)"
        )

    @property
    def influences(self) -> int:
        """Most bones that move one vertex."""
        return int((self.weights > 0).sum(axis=1).max())

    @cached_property
    def stray(self) -> float:
        """Share, 0…1, of the weights not connected over the surface to its bone's others."""
        seams = self._seams
        return stray_share(
            surface_graph(seams.close_mesh(self.reference)), seams.close(self.weights)
        )

    @property
    def _seams(self) -> Seams:
        return no_seams(len(self.weights)) if self.seams is None else self.seams

    def pose(self, matrices: ArrayLike) -> FloatArray:
        """Vertices (V, 3), or (n, V, 3), of the bones' matrices in a pose.

        Args:
            matrices: (B, 4, 4), or (n, B, 4, 4) of n poses, in the world; `rest` gives the
                reference.

        Raises:
            InputError: another shape of the array, or numbers that are not finite.
        """
        B, V = len(self.names), len(self.weights)
        given = self._checked(matrices)
        M = given.reshape(-1, B, 4, 4)
        check_memory(8 * len(M) * V * 24, f"matrices: {len(M)} poses of {V} vertices")
        T = (M @ np.linalg.inv(self.rest))[:, :, :3]
        vertices = skinned(self.weights, self.reference.vertices, T)
        return vertices[0] if given.ndim == 3 else vertices

    def local(self, matrices: ArrayLike) -> FloatArray:
        """Matrices relative to the parent's, as programs store them; the root's stay.

        Args:
            matrices: (B, 4, 4), or (n, B, 4, 4), in the world.

        Raises:
            InputError: as `pose`, or a matrix of a parent that has no inverse.
        """
        return local_matrices(self._checked(matrices), self.parents)

    def _checked(self, matrices: ArrayLike) -> FloatArray:
        """Matrices (B, 4, 4) or (n, B, 4, 4) of the bones; InputError for others."""
        B, remedy = len(self.names), "give those of all bones"
        shapes = (B, 4, 4), ("n", B, 4, 4)
        return checked_array(matrices, "matrices", *shapes, largest=LARGEST, remedy=remedy)

    def fit(self, vertices: ArrayLike) -> FloatArray:
        """Matrices (B, 4, 4), or (n, B, 4, 4), of the bones whose pose is closest to given shapes.

        Args:
            vertices: (V, 3), or (n, V, 3), in the reference's units.

        Raises:
            InputError: another shape of the array, or a position that is not finite.
        """
        V, B = self.weights.shape
        given = checked_array(
            vertices,
            "vertices",
            (V, 3),
            ("n", V, 3),
            largest=LARGEST,
            remedy="give all vertices of the reference",
        )
        shapes = given.reshape(-1, V, 3)
        check_memory(8 * len(shapes) * (12 * V + 32 * B), f"vertices: {len(shapes)} shapes")
        if not len(shapes):
            return np.empty((0, B, 4, 4))
        frame = Frame.of(self.reference)
        rest, moved = frame.inward(self.reference.vertices), frame.inward(shapes)
        T = fitted_transforms(moments(self.weights, rest, moved.transpose(1, 0, 2)))
        matrices = world_matrices(frame.outward(T), self.rest)
        return matrices[0] if given.ndim == 2 else matrices

    def glb(self, fps: float = 24.0, like: Like | None = None, *, up: str | None = None) -> bytes:
        """A GLB file: the skinned mesh, its skeleton, and the clip with one shape a frame.

        Args:
            fps: frames a second, above 0.
            like: what the mesh has beside positions and triangles: a document, a model with its
                document, or the path of a file or directory of shapes. Nodes, materials, textures,
                texture coordinates, colours and names are then those of the document as GLB
                (`Document.write`), and vertices are split where that splits them; an OBJ or PLY
                file without normals gets smooth ones. None writes positions, smooth normals and
                triangles.
            up: "y" or "z", the axis that points up; None is that of a model given as `like`, else
                y. GLB has y up, so that the bones of a rig that is not like a GLB document are on a
                node that turns z up, which `load_shapes` leaves out. Coordinates stay.

        Raises:
            InputError: `fps` or `up` is none, or a document of another mesh or a damaged one.
        """
        document = document_of(like)
        if document is not None:
            document.check_fits(len(self.weights), self.reference.faces)
        surface = self._seams.close_mesh(self.reference)
        normals = self._seams.open(vertex_normals(surface.vertices, surface.faces))
        up = up_of(like, up)
        data = rig_glb(
            self.reference,
            normals,
            self.weights,
            self.names,
            self.parents,
            self.rest,
            local_matrices(self.clip, self.parents),
            checked_number(fps, "fps", above=0, most=1e6),
            document,
        )
        return upright_glb(data, up, document)

    def save(
        self,
        path: str | Path,
        fps: float = 24.0,
        like: Like | None = None,
        *,
        up: str | None = None,
    ) -> None:
        """Write the GLB file `path`, under a temporary name first.

        Args:
            path: the file.
            fps: as of `glb`.
            like: as of `glb`.
            up: as of `glb`.

        Raises:
            InputError: no such folder, a path that cannot be written, or as `glb`.
        """
        check_output_file(path)
        data = self.glb(fps, like, up=up)
        with atomic_path(path) as temporary:
            temporary.write_bytes(data)
