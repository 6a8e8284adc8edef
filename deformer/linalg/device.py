"""The device that torch computes on."""

from __future__ import annotations

import torch

from deformer.errors import InputError


def resolve_device(device: str) -> torch.device:
    """The torch device of "cpu", "cuda", "mps" or "auto" (the first of cuda, mps, cpu present)."""
    available = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    if device == "auto":
        return torch.device(next(name for name, there in available.items() if there))
    if device.split(":")[0] not in available:
        raise InputError(f"device: expected cpu, cuda, mps or auto, got {device!r}")
    if not available[device.split(":")[0]]:
        raise InputError(f"device {device!r} is not available here; use cpu or auto")
    return torch.device(device)
