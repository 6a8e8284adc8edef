"""Predefined studies: a short one, and those for the tables and figures of the paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from deformer.errors import InputError
from deformer.evaluation.methods import has_components, known_methods
from deformer.evaluation.plan import LAMBDA_METHOD, Study
from deformer.evaluation.sources import Source
from deformer.evaluation.splits import sequence_split

QUICK: dict[str, Any] = {
    "protocols": ("reconstruction", "sparse_control", "rotation"),
    "components": (10,),
    "at": 10,
    "counts": (5, 20),
    "epochs": 100,
    "tests": 6,
}
"""Options of a short `Study`, for any data set."""

# Largest number of test shapes, but for SCAPE: a fit to a shape of the largest set takes minutes.
_TESTS = 12

# The paper's data sets, or substitutes: (name, possible file names, options of `Source.at`).
_PAPER_SETS: tuple[tuple[str, tuple[str, ...], dict[str, Any]], ...] = (
    ("scape", ("scape-obj", "scape", "scape.npz"), {"up": "x"}),
    ("crane", ("crane.npz", "crane"), {"ordered": True, "align": True}),
    ("horse", ("horse-gallop.npz", "horse-gallop"), {"ordered": True}),
    ("face", ("ict-expressions.npz", "ict-expressions"), {}),
    ("humanoid", ("humanoid.npz", "humanoid"), {"up": "z"}),
)


def paper_sources(folder: Path) -> list[Source]:
    """Those of the paper's data sets, or their substitutes, that are in a folder.

    Args:
        folder: directory with the files or folders of the sets.

    Raises:
        InputError: none of them is there.
    """
    found = [
        Source.at(name, str(folder / file), **options)
        for name, files, options in _PAPER_SETS
        if (file := next((file for file in files if (folder / file).exists()), None))
    ]
    if not found:
        names = ", ".join(files[0] for _, files, _ in _PAPER_SETS)
        raise InputError(f"{folder}: holds none of {names}; give the folder with the data sets")
    return found


def paper_studies(
    sources: list[Source],
    methods: tuple[str, ...] | None = None,
    epochs: int | None = None,
    tests: int | None = None,
) -> list[Study]:
    """Studies for tables and figures of Tan et al. 2018, and for robustness.

    The tables have the labels "moreevaluation" and "diff_lambda" in the paper's source, the figures
    "gerror" and "sparse_control". Further studies measure robustness to noise and large rotations.

    Args:
        sources: data sets, from `paper_sources`.
        methods: names of the methods to compare; None is all.
        epochs: upper bound on a network's number of training steps; None is its configuration's.
        tests: upper bound on the number of test shapes; None is all of SCAPE and 12 of the others.
    """
    chosen = methods or known_methods()
    with_components = tuple(method for method in chosen if has_components(method))
    studies = []
    for source in sources:
        base = Study(
            source, chosen, ("reconstruction", "rotation"), epochs=epochs, tests=tests or _TESTS
        )
        if source.name == "scape":
            studies += _scape(replace(base, tests=tests), with_components)
        elif source.name == "crane":
            control = replace(base, protocols=("sparse_control",), pictures=False)
            curve = replace(base, components=(10, 30, 50), methods=with_components, pictures=False)
            studies += [base, curve, replace(control, counts=(5, 20, 80))]
        else:
            # One shape in ten for training, as in the paper, although not all sets are sequences.
            splits = (sequence_split(source.count, 0),)
            studies.append(replace(base, splits=splits))
    return studies


def _scape(base: Study, with_components: tuple[str, ...]) -> list[Study]:
    control = replace(base, protocols=("sparse_control",), splits=2, pictures=False)
    curve = replace(
        base, methods=with_components, components=(10, 20, 30, 50, 70, 100), pictures=False
    )
    noise = replace(base, protocols=("noise",), counts=(20,), pictures=False)
    studies = [
        base,
        curve,
        replace(base, methods=with_components, splits=2, pictures=False),
        control,
        noise,
    ]
    if LAMBDA_METHOD in with_components:
        sensitivity = replace(
            base, methods=(LAMBDA_METHOD,), protocols=("sensitivity",), pictures=False
        )
        studies.append(sensitivity)
    return studies
