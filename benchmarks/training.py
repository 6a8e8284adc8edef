"""Time of the default training and of a plain full-batch loop to the same error.

    python benchmarks/training.py SHAPES [--components 50] [--train 36] [--limit 300]

Both learn from the same shapes in the same run. The default comes first; its error is the squared
difference of scaled features after encoding and decoding, summed over a shape and averaged over
shapes. The plain loop is Adam on all shapes at once, with the paper's network, loss and learning
rate; it runs until its reconstruction term is as small, or until the time limit. Prints both times,
their ratio, and the peak memory of the process.
"""

import argparse
import resource
import time

import numpy as np
import torch
from rich.console import Console
from rich.progress import Progress

from deformer.acap import FeatureExtractor, FeatureScaler, extract_all
from deformer.geometry import Geodesics
from deformer.io import load_shapes
from deformer.network import AdamSettings, Decoder, MeshAutoencoder, losses, resolve_config
from deformer.training.factorisation import factor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes")
    parser.add_argument("--components", type=int, default=50)
    parser.add_argument("--train", type=int, default=36, help="shapes, evenly spread")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds of the plain loop")
    options = parser.parse_args()
    console = Console(width=100)
    shapes = load_shapes(options.shapes)
    chosen = np.unique(np.linspace(0, len(shapes) - 1, options.train).round().astype(int))
    reference = shapes.mesh(int(chosen[0]))
    extractor, geodesics = FeatureExtractor(reference), Geodesics(reference)
    q = extract_all(extractor, shapes.vertices[chosen])
    scaler = FeatureScaler.fit(q)
    x = scaler.scale(q)
    rings = extractor.indptr, extractor.rings

    config = resolve_config("default", components=options.components).with_training(sparsity=2.0)
    begun = time.perf_counter()
    result = factor(x, scaler, geodesics, config)
    seconds = time.perf_counter() - begun
    decoder = Decoder(result.weights, scaler, *rings)
    back = [scaler.scale(decoder.features(decoder.project(features))) for features in q]
    goal = float(np.square(np.array(back) - x).sum() / len(x))
    console.print(f"{len(x)} shapes of {x.shape[1]} vertices, K = {options.components}")
    console.print(f"default: {seconds:.1f} s to an error of {goal:.3f}")

    paper = resolve_config("paper", components=options.components)
    adam = paper.training
    assert isinstance(adam, AdamSettings)
    torch.manual_seed(0)
    network = MeshAutoencoder(*rings, paper.components, paper.layers)
    optimiser = torch.optim.Adam(network.parameters(), lr=adam.learning_rate)
    locality = losses.Locality(geodesics, paper.d_min, paper.d_max)
    batch = torch.tensor(np.swapaxes(x, 0, 1), dtype=torch.float32)
    error, begun, steps = np.inf, time.perf_counter(), 0
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("plain loop", total=options.limit)
        while error > goal and (spent := time.perf_counter() - begun) < options.limit:
            optimiser.zero_grad()
            estimate, z = network(batch)
            loss = losses.loss(batch, estimate, z, network.C, locality.update(network.C))
            loss.total.backward()
            optimiser.step()
            error, steps = loss.reconstruction.item(), steps + 1
            progress.update(task, completed=spent)
    spent = time.perf_counter() - begun
    reached = error <= goal
    console.print(f"plain loop: {spent:.1f} s, {steps} steps to an error of {error:.3f}")
    console.print(f"ratio: {'' if reached else 'more than '}{spent / seconds:.1f}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    console.print(f"peak memory: {peak:.2f} GiB")


if __name__ == "__main__":
    main()
