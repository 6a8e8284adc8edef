"""A floor that shapes do not pass: its term of the energy, and the vertices that touch it.

The energy of a handle fit gets Σ_f max(0, h − n · p_f)² / (s D)² over a few vertices f, so that the
prior bends the body above the floor, and only along the floor's normal n: contacts slide freely.
What is left, a thousandth of the body's size or so, is projected onto the floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import LARGEST, checked_array, checked_instance, checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Examples whose lowest points say where the floor is, evenly spread.
_EXAMPLES = 24
# s, depth of a vertex that adds as much energy as one standard deviation of the prior.
_DEVIATION = 1e-3
# In bounding diagonals: a vertex deeper than this becomes a contact, and is one until it is so far
# above the floor; contacts are so far apart on the reference. The gap between the first two is what
# keeps contacts from coming and going with every frame.
_TOUCHING, _LEAVING, _APART = 5e-4, 1e-2, 3e-2
# The most contacts, and the most new ones of a solve, each of which costs a back-substitution; and
# those of a sequence, in which other vertices touch the floor in other frames.
MOST_CONTACTS, _MOST_NEW = 12, 4
_MOST_OF_SEQUENCE, _MOST_NEW_OF_SEQUENCE = 32, 12


@dataclass(frozen=True)
class Floor:
    """A plane that no vertex of a solved shape passes: n · p ≥ h for each of its points p.

    Args:
        height: h, of the floor along its normal, in the data's units.
        normal: n (3,), pointing to the side where the shape is, of any length.

    Raises:
        InputError: a number that is not finite, or a normal of zero.
    """

    height: float
    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        """Check the arguments, and make the normal's length 1."""
        n = checked_array(self.normal, "floor: normal", (3,), largest=LARGEST)
        length = float(np.sqrt((n**2).sum()))
        if not length > 0:
            raise InputError("floor: normal: expected another than zero, got [0, 0, 0]")
        x, y, z = (n / length).tolist()
        h = checked_number(self.height, "floor: height", least=-LARGEST, most=LARGEST)
        object.__setattr__(self, "normal", (x, y, z))
        object.__setattr__(self, "height", h)

    @classmethod
    def under(cls, model: DeformationModel) -> Floor:
        """The floor on which a model's examples stand.

        Its normal is the model's up axis; its height is the median of the examples' lowest points.
        """
        checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
        axis = "xyz".index(model.up)
        step = max(len(model.codes) // _EXAMPLES, 1)
        lowest = [model.decode(code)[:, axis].min() for code in model.codes[::step]]
        return cls.at(model, float(np.median(lowest)))

    @classmethod
    def at(cls, model: DeformationModel, height: float) -> Floor:
        """The floor at a height along a model's up axis, in the data's units."""
        checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
        x, y, z = np.eye(3)["xyz".index(model.up)].tolist()
        return cls(height, (x, y, z))

    def depths(self, points: ArrayLike) -> FloatArray:
        """Depths (...) of points (..., 3) under the floor; negative above it."""
        p = checked_array(points, "points", ("...", 3))
        return self.height - p @ np.array(self.normal)

    def above(self, vertices: ArrayLike) -> FloatArray:
        """Vertices (..., 3) with those under the floor projected onto it; a copy."""
        p = checked_array(vertices, "vertices", ("...", 3))
        return p + np.maximum(self.depths(p), 0.0)[..., None] * np.array(self.normal)


@dataclass(frozen=True, eq=False)
class FloorTerm:
    """The floor in a `HandleEnergy`.

    Args:
        floor: the floor.
        rows: (F,) indices of its contacts among the energy's handles.
        diagonal: D, bounding diagonal of the reference.
    """

    floor: Floor
    rows: IntArray
    diagonal: float

    def misfit(self, points: FloatArray) -> FloatArray:
        """Depths (..., F) of the contacts among handles (..., H, 3), in deviations; 0 above it."""
        depths = self.floor.depths(points[..., self.rows, :])
        return np.maximum(depths, 0.0) / (_DEVIATION * self.diagonal)

    def jacobian(self, tangents: FloatArray) -> FloatArray:
        """Derivative (..., F, n) of contacts' depths in deviations, of tangents (..., F, 3, n)."""
        n = np.array(self.floor.normal)
        return -np.einsum("c,...cn->...n", n, tangents) / (_DEVIATION * self.diagonal)


class FloorContacts:
    """Vertices of a surface that touch a floor; they change little from one pose to the next.

    Args:
        reference: (V, 3) vertices of the reference, on which distances between contacts are
            measured.
        diagonal: its bounding diagonal.

    Attributes:
        floor: the floor; None is none.
        vertices: the contacts.
    """

    def __init__(self, reference: FloatArray, diagonal: float) -> None:
        """Start without a floor."""
        self.floor: Floor | None = None
        self.vertices: list[int] = []
        self._reference, self._diagonal = reference, diagonal

    def update(self, surface: FloatArray | None) -> bool:
        """Choose the contacts of a surface, see `chosen`; True if they have changed."""
        before, self.vertices = self.vertices, self.chosen(surface)
        return self.vertices != before

    def chosen(self, surface: FloatArray | None) -> list[int]:
        """Contacts of a surface (V, 3), as many as possible of those before; None has none."""
        if self.floor is None or surface is None:
            return []
        depths = self.floor.depths(surface) / self._diagonal
        found = [v for v in self.vertices if depths[v] > -_LEAVING]
        return self._with_deepest(found, depths, min(len(found) + _MOST_NEW, MOST_CONTACTS))

    def add(self, depths: FloatArray) -> bool:
        """Add contacts where vertices are too deep in any frame of a sequence; True if any are.

        Args:
            depths: (V,) of the vertices in the frames where they are deepest, in the data's units.
        """
        most = min(len(self.vertices) + _MOST_NEW_OF_SEQUENCE, _MOST_OF_SEQUENCE)
        before = self.vertices
        self.vertices = self._with_deepest(list(before), depths / self._diagonal, most)
        return self.vertices != before

    def _with_deepest(self, found: list[int], depths: FloatArray, most: int) -> list[int]:
        """Contacts, and the deepest vertices (V,) in diagonals away from them, at most so many."""
        deep = depths > _TOUCHING
        for v in found:
            self._close(deep, v)
        while len(found) < most and deep.any():
            found.append(int(np.where(deep, depths, -np.inf).argmax()))
            self._close(deep, found[-1])
        return found

    def _close(self, deep: NDArray[np.bool_], vertex: int) -> None:
        """Leave out the vertices around a contact, which it stands for."""
        away = ((self._reference - self._reference[vertex]) ** 2).sum(axis=1)
        deep &= away > (_APART * self._diagonal) ** 2
