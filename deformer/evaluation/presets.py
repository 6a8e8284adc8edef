"""Predefined studies: a quick one for the user's shapes, and the paper's tables and figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from deformer.errors import InputError
from deformer.evaluation.methods import has_components, known_methods
from deformer.evaluation.plan import LAMBDA_METHOD, Study
from deformer.evaluation.sources import Source
from deformer.evaluation.splits import sequence_split

# Options of a short `Study`.
QUICK: dict[str, Any] = {
    "protocols": ("reconstruction", "sparse_control", "rotation"),
    "components": (10,),
    "at": 10,
    "counts": (5, 20),
    "epochs": 100,
    "tests": 6,
}

# Test shapes of every paper data set but SCAPE: a fit to the largest takes minutes a shape.
_TESTS = 12

# The paper's data sets: (name, possible file names, options of Source).
_PAPER_SETS: tuple[tuple[str, tuple[str, ...], dict[str, Any]], ...] = (
    ("scape", ("scape-obj", "scape", "scape.npz"), {"up": "x"}),
    ("crane", ("crane.npz", "crane"), {"ordered": True, "align": True}),
    ("horse", ("horse-gallop.npz", "horse-gallop"), {"ordered": True}),
    ("face", ("ict-expressions.npz", "ict-expressions"), {}),
    ("humanoid", ("humanoid.npz", "humanoid"), {"up": "z"}),
)


def paper_sources(folder: Path) -> list[Source]:
    """The paper's data sets, or substitutes for them, found in a folder.

    Raises:
        InputError: the folder has none of them.
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
    """Studies for the tables and figures of Tan et al. 2018, and for robustness beside them.

    The tables are "moreevaluation" and "diff_lambda", the figures "gerror" and "sparse_control";
    further studies add noise and large rotations.

    Args:
        sources: the result of `paper_sources`.
        methods: names of the methods to compare; None compares all.
        epochs: as in `Study`.
        tests: upper bound on the number of test shapes; None is the default of each study.
    """
    chosen = methods or known_methods()
    coded = tuple(method for method in chosen if has_components(method))
    studies = []
    for source in sources:
        base = Study(
            source, chosen, ("reconstruction", "rotation"), epochs=epochs, tests=tests or _TESTS
        )
        if source.name == "scape":
            studies += _scape(replace(base, tests=tests), coded)
        elif source.name == "crane":
            control = replace(base, protocols=("sparse_control",), pictures=False)
            curve = replace(base, components=(10, 30, 50), methods=coded, pictures=False)
            studies += [base, curve, replace(control, counts=(5, 20, 80))]
        else:
            # The paper trains on one in ten of these, too, although not all are in order of time.
            splits = (sequence_split(source.count, 0),)
            studies.append(replace(base, splits=splits))
    return studies


def _scape(base: Study, coded: tuple[str, ...]) -> list[Study]:
    control = replace(base, protocols=("sparse_control",), splits=2, pictures=False)
    curve = replace(base, methods=coded, components=(10, 20, 30, 50, 70, 100), pictures=False)
    noise = replace(base, protocols=("noise",), counts=(20,), pictures=False)
    studies = [base, curve, replace(base, methods=coded, splits=2, pictures=False), control, noise]
    if LAMBDA_METHOD in coded:
        tried = replace(base, methods=(LAMBDA_METHOD,), protocols=("sensitivity",), pictures=False)
        studies.append(tried)
    return studies
