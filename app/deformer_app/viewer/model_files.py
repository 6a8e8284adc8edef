"""The model and session to open first, and the codes that a model can start from."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, InputError
from deformer_app.viewer.session import Session

T = TypeVar("T")


def of_open_model(part: T | None) -> T:
    """Return what there is only while a model is open.

    Raises:
        InputError: it is None.
    """
    if part is None:
        raise InputError("no model is open; open one first")
    return part


def first_model(model: str | None, session: Path | None) -> tuple[str | None, Session | None]:
    """Find the model to open first, and the session to open with it, before there is a window.

    Args:
        model: shipped name or path; None takes the session's.
        session: a session's file, or None.

    Returns:
        The model's name or path, None without either argument; and the session, if one is named.

    Raises:
        InputError: no such model, a session that is damaged, missing or of another model.
    """
    saved = Session.load(session) if session is not None else None
    name = model or (saved.model.path if saved else None)
    if name is None:
        return None, None
    loaded = deformer.load_model(name)
    if saved is not None and session is not None:
        saved.check_fits(loaded, name, session)
    return name, saved


def start_codes(model: DeformationModel) -> dict[str, NDArray[np.float64]]:
    """Latent codes (K,) to start from, by name: the reference, the mean, every training shape."""
    train = model.split.get("train") or range(len(model.codes))
    codes = {f"Shape {n}": z for n, z in zip(train, model.codes, strict=False)}
    first = codes.get(f"Shape {model.summary.get('reference', 0)}")
    if first is None:
        first = model.encode(model.reference.vertices)
    return {"Reference": first, "Mean": model.latent_mean, **codes}
