"""Methods that deform a mesh by examples, or by rigidity alone, behind one protocol."""

from __future__ import annotations

from collections.abc import Callable

from deformer.baselines.biharmonic import Biharmonic, NearestBiharmonic
from deformer.baselines.method import Method, Poser
from deformer.baselines.rigid import Arap, NearestArap

# Makes an untrained method by its name, in the order of tables.
METHODS: dict[str, Callable[[], Poser]] = {
    method.name: method for method in (Arap, NearestArap, Biharmonic, NearestBiharmonic)
}

__all__ = ["METHODS", "Method", "Poser"]
