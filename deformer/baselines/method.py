"""What every compared method offers."""

from __future__ import annotations

from typing import ClassVar, Literal, Protocol, Self

from numpy.typing import ArrayLike

from deformer.mesh import FloatArray, MeshSequence

# What a method's components are made of.
Space = Literal["vertices", "gradients", "edges", "acap", "none"]


class Method(Protocol):
    """Learns components of example shapes, and poses a mesh by them.

    Settings are the constructor's; `fit` learns, and returns the method itself. A test shape is
    never seen by `fit`, nor by anything chosen there.
    """

    name: ClassVar[str]
    space: ClassVar[Space]

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components from the training shapes; shape 0 is the reference."""
        ...

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3) in one pass, without a search."""
        ...

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3)."""
        ...

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        ...

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) when only vertices (H,) are known to lie at targets (H, 3)."""
        ...
