"""What the processes that compute together must agree on."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib import metadata

# With other versions of these the parts of the program do not understand each other …
_SAME = ("python", "deformer", "distributed", "dask", "cloudpickle", "msgpack")
# … and with other versions of these the numbers differ.
_NUMERICAL = ("numpy", "scipy", "torch", "numba", "libigl", "potpourri3d")


def versions() -> dict[str, str]:
    """Name → version of this process's Python (without its patch) and packages."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in (*_SAME[1:], *_NUMERICAL):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "none"
    return found


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> tuple[str, str]:
    """What differs, as "numpy 2.0.0 there, 2.4.6 here"; empty texts where nothing does.

    Args:
        here, there: `versions` of two processes.

    Returns:
        Differences that prevent working together, and those that change numbers.
    """

    def told(names: tuple[str, ...]) -> str:
        unlike = [name for name in names if here[name] != there.get(name, "none")]
        return ", ".join(
            f"{name} {there.get(name, 'none')} there, {here[name]} here" for name in unlike
        )

    return told(_SAME), told(_NUMERICAL)
