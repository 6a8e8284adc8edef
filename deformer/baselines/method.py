"""Protocols of the compared methods."""

from __future__ import annotations

from typing import ClassVar, Literal, Protocol, Self

from numpy.typing import ArrayLike

from deformer.geometry import FloatArray, MeshSequence

# Quantity that a method's components are linear in; "none" for a method without components.
Space = Literal["vertices", "gradients", "edges", "acap", "none"]


class PosingMethod(Protocol):
    """A method that poses a mesh by a few known vertices.

    Settings are arguments of the constructor; `fit` learns and returns the method itself. `fit`
    never sees a test shape. `space` is "none" for a method without components; all others are a
    `ComponentMethod`, too.
    """

    name: ClassVar[str]
    space: ClassVar[Space]

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn from the training shapes.

        Args:
            shapes: training shapes; shape 0 is the reference.
            components: number K of components; ignored by methods without.
            seed: seed of random choices.
        """
        ...

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """Most likely mesh (V, 3) when vertices (H,) are known to be at targets (H, 3).

        Args:
            vertices: (H,) indices.
            targets: (H, 3) positions.
            noise: standard deviation of each of the targets' coordinates, in the data's units; 0 if
                they are exact. Methods that can only have the handles at the targets ignore it.
        """
        ...


class ComponentMethod(PosingMethod, Protocol):
    """A method that learns K components of example shapes and encodes shapes in them."""

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3), by one pass of the encoder or one linear solve."""
        ...

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3)."""
        ...

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        ...
