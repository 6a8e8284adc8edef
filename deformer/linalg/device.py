"""The device that torch computes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deformer.checks import shortened
from deformer.errors import InputError

if TYPE_CHECKING:
    import torch


def check_device(device: str) -> None:
    """Check the name of a device as `resolve_device` does, without torch for "cpu" and "auto".

    Raises:
        InputError: another name, or a device that this machine does not have.
    """
    if not isinstance(device, str) or device not in ("cpu", "auto"):
        resolve_device(device)


def resolve_device(device: str) -> torch.device:
    """The torch device of a name.

    Args:
        device: "cpu", "cuda", "cuda:1", …, "mps", or "auto": the first of cuda, mps and cpu that
            this machine has.

    Raises:
        InputError: another name, or a device that this machine does not have.
    """
    kind, _, number = device.partition(":") if isinstance(device, str) else ("", "", "")
    known = kind in ("cpu", "cuda", "mps") and (":" not in device or number.isdecimal())
    if not known and not (isinstance(device, str) and device == "auto"):
        raise InputError(
            f"device: expected cpu, cuda, mps or auto, got {shortened(device)}; choose one"
        )
    import torch  # the import takes seconds, and most programs never need torch

    available = {
        "cuda": torch.cuda.device_count() if torch.cuda.is_available() else 0,
        "mps": int(torch.backends.mps.is_available()),
        "cpu": 1,
    }
    if device == "auto":
        return torch.device(next(name for name, count in available.items() if count))
    if int(number[:9] or 0) >= available[kind]:
        raise InputError(f"device {shortened(device)} is not available here; use cpu or auto")
    return torch.device(device)
