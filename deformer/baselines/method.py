"""What every compared method offers."""

from __future__ import annotations

from typing import ClassVar, Literal, Protocol, Self

from numpy.typing import ArrayLike

from deformer.geometry import FloatArray, MeshSequence

# What a method's components are made of.
Space = Literal["vertices", "gradients", "edges", "acap", "none"]


class Poser(Protocol):
    """Poses a mesh by a few known vertices; whether it has components, `space` says.

    Settings are the constructor's; `fit` learns, and returns the method itself. A test shape is
    never seen by `fit`, nor by anything chosen there. A method whose space is "none" has no
    components and is no more than this.
    """

    name: ClassVar[str]
    space: ClassVar[Space]

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components from the training shapes; shape 0 is the reference."""
        ...

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) when only vertices (H,) are known to lie at targets (H, 3)."""
        ...


class Method(Poser, Protocol):
    """Learns components of example shapes, and poses a mesh by them."""

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3) in one pass, without a search."""
        ...

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3)."""
        ...

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        ...
