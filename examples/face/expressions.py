"""Expressions as mixtures of the kit's, which are added to the neutral face as weighted offsets.

A name is an action of the kit, without the side where there is one for each side. Left out are
eyeLook…, the lids' small share of a gaze, as the mesh has no eyeballs; mouthClose closes the lips
of an open jaw, and is never drawn without it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from face.kit import EXPRESSIONS, Face

SINGLE = tuple(n for n in EXPRESSIONS if not n.startswith("eyeLook") and n != "mouthClose")
PAIRED = tuple(n.removesuffix("_L") for n in SINGLE if n.endswith("_L"))
CLOSED_JAW = "jawOpen+mouthClose"
CLOSED_MOST = 0.5  # of it: lips cannot close over a wide open jaw
# Regions of the face, the share of mixtures that use each, and the actions of which one is drawn.
REGIONS = {
    "brows": (0.5, ("browDown", "browInnerUp", "browOuterUp", "browInnerUp+browOuterUp")),
    "eyes": (0.5, ("eyeBlink", "eyeSquint", "eyeWide")),
    "cheeks": (0.4, ("cheekPuff", "cheekRaiser", "cheekSquint", "noseSneer")),
    "corners": (
        0.7,
        ("mouthSmile", "mouthSmile", "mouthFrown", "mouthDimple", "mouthStretch", "mouthPress"),
    ),
    "lips": (
        0.4,
        (
            *("mouthPucker", "mouthFunnel", "mouthRollLower+mouthRollUpper", "mouthShrugLower"),
            *("mouthShrugUpper", "mouthLowerDown", "mouthUpperUp", "mouthLeft", "mouthRight"),
        ),
    ),
    "jaw": (0.5, ("jawOpen", "jawOpen", CLOSED_JAW, "jawLeft", "jawRight", "jawForward")),
}
BOTH_SIDES = 0.7  # share of two-sided actions that both sides do alike


def draw_weights(rng: np.random.Generator) -> dict[str, float]:
    """Weights, 0.15 to 1, of the expressions in one mixture: at most one action a region."""
    weights: dict[str, float] = {}
    while not weights:
        for share, actions in REGIONS.values():
            if rng.random() >= share:
                continue
            strength = rng.uniform(0.3, 1.0)
            action = actions[rng.integers(len(actions))]
            if action == CLOSED_JAW:
                strength *= CLOSED_MOST
            for name in action.split("+"):
                weights |= _sided(name, strength, rng)
    return weights


def _sided(name: str, strength: float, rng: np.random.Generator) -> dict[str, float]:
    if name not in PAIRED:
        return {name: strength}
    if rng.random() < BOTH_SIDES:
        return {f"{name}_L": strength, f"{name}_R": strength}
    return {f"{name}_{'LR'[rng.integers(2)]}": strength}


def mix(face: Face, weights: dict[str, float]) -> NDArray:
    """Vertices (V, 3) of the neutral face plus weighted expressions."""
    return face.neutral + sum(w * face.offsets[name] for name, w in weights.items())


def schedule(mixtures: int, seed: int) -> list[tuple[str, dict[str, float]]]:
    """Names and weights of all shapes of the set, the neutral face first.

    Every single expression, every two-sided one on both sides, and `mixtures` drawn ones.
    """
    found: list[tuple[str, dict[str, float]]] = [("neutral", {})]
    found += [(name, {name: 1.0}) for name in SINGLE]
    found.append((CLOSED_JAW, dict.fromkeys(CLOSED_JAW.split("+"), CLOSED_MOST)))
    found += [(name, {f"{name}_L": 1.0, f"{name}_R": 1.0}) for name in PAIRED]
    for number in range(mixtures):
        weights = draw_weights(np.random.default_rng([seed, number]))
        found.append((f"mixture {number}", weights))
    return found
