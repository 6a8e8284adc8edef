"""The memory that a training takes, estimated before it starts."""

from __future__ import annotations

from dataclasses import dataclass

from deformer.checks import check_memory, checked_integer, shortened
from deformer.errors import InputError
from deformer.geometry import ShapeSequence
from deformer.linalg import CORES
from deformer.network import FEATURES, AdamSettings, ModelConfig
from deformer.workspace import LARGE_SHARE, LEAST_MEMORY, Workspace

# Bytes a vertex of the factors of the Laplacian, of the heat method and of the features' system,
# and of what is prepared for the reference; and of all that does not depend on the shapes' number.
_OF_VERTEX, _OF_PART = 12000.0, 250e6
# Arrays of the components' size that are in memory at once.
_ARRAYS = 7
# Bytes a vertex of a handle fit in a trial, the components apart.
_OF_FIT = 1300.0


def working_memory(vertices: int, components: int) -> float:
    """Bytes that a factorisation takes beside libraries and shapes, however many there are.

    Args:
        vertices: V.
        components: K.
    """
    return _OF_PART + vertices * _OF_VERTEX + _components_memory(vertices, components)


def _components_memory(vertices: int, components: int) -> float:
    return _ARRAYS * 4.0 * FEATURES * vertices * components


@dataclass(frozen=True)
class TrainingMemory:
    """Memory that a training by factorisation is expected to take, in bytes.

    Args:
        least: the least limit (`Workspace`) that it can keep to.
        whole: the limit from which nothing is in temporary files.
        files: size of the temporary files with the least limit, and of the checkpoint.
    """

    least: float
    whole: float
    files: float


def training_memory(shapes: int, vertices: int, components: int = 50) -> TrainingMemory:
    """What a training on shapes and their mirror images takes, before there are any.

    Args:
        shapes: N.
        vertices: V.
        components: K.

    Raises:
        InputError: a number below 1.
    """
    N = checked_integer(shapes, "shapes", least=1)
    V = checked_integer(vertices, "vertices", least=1)
    K = checked_integer(components, "components", least=1)
    least = LEAST_MEMORY + working_memory(V, K)
    positions, features = 8.0 * 3 * N * V, 4.0 * FEATURES * 2 * N * V
    # The data are made beside the features, and no array takes more than a share of what is left.
    whole = least + positions + features + features / LARGE_SHARE
    return TrainingMemory(least, whole, 3 * positions + 3.5 * features)


def reserve_memory(shapes: ShapeSequence, settings: ModelConfig, workspace: Workspace) -> int:
    """Keep memory for what is always in memory.

    Args:
        shapes: the shapes of the file.
        settings: of the training.
        workspace: has the limit.

    Returns:
        Number of trials of settings, at least 1, that the limit lets run side by side.

    Raises:
        InputError: more components than features, or than memory holds.
    """
    (N, V), K = shapes.vertices.shape[:2], settings.components
    if K > FEATURES * V:
        raise InputError(
            f"components: expected at most {FEATURES * V}, {FEATURES} for each of {V} vertices, "
            f"got {shortened(K)}; ask for less"
        )
    what = f"training: {K} components, layers {settings.layers}, {V} vertices"
    if not isinstance(settings.training, AdamSettings):
        needed, trial = working_memory(V, K), _OF_FIT * V + _components_memory(V, K)
        workspace.reserve(needed, what)
        more = min(CORES - 1, int(LARGE_SHARE * workspace.left / trial))
        workspace.reserve(needed + more * trial, what)
        return 1 + more
    width, mixed = max(FEATURES, *settings.layers), settings.training.mixed_shapes
    # In single precision: the components with three arrays of their size, the features of the
    # examples, of their mirror images and of mixed shapes; in double precision, K by K matrices.
    size = 4 * V * width * (4 * K + 4 * N + 2 * mixed) + 4 * 8 * K * K
    check_memory(size, what)
    return 1
