"""A training of the small sequence, which tests start with torchrun: OPTIONS (JSON) OUTPUT."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.scaler import FeatureScaler
from deformer.geometry.geodesics import Geodesics
from deformer.network.config import resolve_config
from deformer.training import assist_training
from deformer.training.adam import fit
from shapes import sequence


def trained(training, *, until=None, checkpoint=None, resume=False):
    """Train; returns the losses of the steps and the result.

    Args:
        training: changes of the paper's settings.
        until: step after which to interrupt.
        checkpoint, resume: as of `fit`.
    """
    torch.set_num_threads(1)
    shapes = sequence(8)
    extractor = FeatureExtractor(shapes.mesh(0))
    q = extract_all(extractor, shapes.vertices)
    x = FeatureScaler.fit(q).scale(q)
    config = replace(resolve_config("paper", components=4), name="changed")
    losses = []

    def report(progress):
        losses.append([progress.reconstruction, progress.sparsity, progress.range])
        if progress.done == until:
            raise KeyboardInterrupt

    result = fit(
        x,
        extractor.indptr,
        extractor.rings,
        Geodesics(shapes.mesh(0)),
        config.with_training(**training),
        seed=3,
        device="cpu",
        checkpoint=checkpoint,
        resume=resume,
        on_progress=report,
    )
    return losses, result


def main():
    """Train in the first process, assist in the others."""
    if assist_training():
        return
    options, output = json.loads(sys.argv[1]), Path(sys.argv[2])
    if options.get("checkpoint"):
        options["checkpoint"] = Path(options["checkpoint"])
    losses, result = trained(**options)
    np.savez(output, losses=losses, interrupted=result.interrupted, **result.weights.arrays)


if __name__ == "__main__":
    main()
