"""The library usd-core, which is optional and takes a while to import."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

from deformer.errors import InputError

_MODULES = ("Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdShade", "UsdSkel", "UsdUtils", "Vt")


def usd_library(name: object) -> SimpleNamespace:
    """The modules Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils and Vt of usd-core.

    Args:
        name: the file that needs them, for messages.

    Raises:
        InputError: usd-core is not installed.
    """
    try:
        return SimpleNamespace(**{m: importlib.import_module(f"pxr.{m}") for m in _MODULES})
    except ImportError as error:
        raise InputError(
            f'{name}: USD needs the package usd-core; install it with pip install "deformer[usd]"'
        ) from error
