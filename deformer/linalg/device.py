"""The device that torch computes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deformer.errors import InputError

if TYPE_CHECKING:
    import torch


def resolve_device(device: str) -> torch.device:
    """The torch device of a name.

    Args:
        device: "cpu", "cuda", "cuda:1", …, "mps", or "auto": the first of cuda, mps and cpu that
            this machine has.

    Raises:
        InputError: another name, or a device that this machine does not have.
    """
    import torch  # the import takes seconds, and most programs never need torch

    available = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    if device == "auto":
        return torch.device(next(name for name, usable in available.items() if usable))
    if device.split(":")[0] not in available:
        raise InputError(f"device: expected cpu, cuda, mps or auto, got {device!r}")
    if not available[device.split(":")[0]]:
        raise InputError(f"device {device!r} is not available here; use cpu or auto")
    return torch.device(device)
