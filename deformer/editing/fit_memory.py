"""The memory that fitting a sequence takes, estimated before it starts."""

from __future__ import annotations

from dataclasses import dataclass

from deformer.checks import checked_integer
from deformer.editing.sequence_windows import sizes
from deformer.editing.unknowns import MOTION
from deformer.network import FEATURES
from deformer.workspace import LEAST_MEMORY

# Bytes a vertex of the model's factors and of what is prepared for the reference; and arrays of the
# components' size, in single precision.
_OF_VERTEX, _ARRAYS = 9000.0, 3
# Arrays of a window's normal equations, with their factor.
_EQUATIONS = 6


@dataclass(frozen=True)
class SequenceMemory:
    """Memory that `fit_sequence_parts` is expected to take, in bytes.

    Args:
        least: the least limit (`Workspace`) that it can keep to, whatever the number of frames.
        frame: of the shape of each frame, in memory or in a temporary file.
    """

    least: float
    frame: float


def sequence_memory(vertices: int, components: int = 50, handles: int = 20) -> SequenceMemory:
    """What fitting a sequence takes, before there is one.

    Args:
        vertices, components, handles: V, K and H.

    Raises:
        InputError: a number that is too small.
    """
    V = checked_integer(vertices, "vertices", least=1)
    K = checked_integer(components, "components", least=1)
    H = checked_integer(handles, "handles", least=0)
    window = 8.0 * sum(sizes()) * (3 * H * K + _EQUATIONS * (K + MOTION) ** 2)
    least = LEAST_MEMORY + window + V * (_OF_VERTEX + _ARRAYS * 4 * FEATURES * K)
    return SequenceMemory(least, 24.0 * V)
