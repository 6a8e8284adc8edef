"""Components of two methods behind one interface: strength, support, and share of motion.

Strength is that of the paper's component analysis (Tan et al., AAAI 2018): in the reference's code,
one entry takes its least or its greatest value over the training shapes, whichever changes the
features more; the size of that change is the component's strength. Features are the method's own.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from deformer import DeformationModel, e_rms
from deformer.baselines import EdgeSplocs
from flag.noise import CORNER_GAIN, noise_profile
from flag.quality import swing_angles


class Components(Protocol):
    """Components of a method, and its codes without their rigid motion.

    Attributes:
        name: name in tables.
        reference: (K,) code of the reference.
        extremes: (K,) value of each component in its representative shape.
        strengths: (K,) distance of that shape's features from the reference's.
    """

    name: str
    reference: NDArray
    extremes: NDArray
    strengths: NDArray

    def codes(self, vertices: NDArray) -> NDArray:
        """Codes (N, K) of shapes (N, V, 3)."""
        ...

    def shapes(self, codes: NDArray) -> NDArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        ...

    def support(self, component: int) -> NDArray:
        """Size (V,) of a component's weights at every vertex, the largest 1."""
        ...


class NetworkComponents:
    """Components of a trained autoencoder."""

    name = "Deformer"

    def __init__(self, model: DeformationModel) -> None:
        """Compare the features of both ends of every component with the reference's."""
        self._model = model
        self.reference = model.encode(model.reference.vertices)
        base = self._features(self.reference)
        ends = np.stack([model.codes.min(axis=0), model.codes.max(axis=0)])
        far = np.empty_like(ends)
        for end, k in np.ndindex(*ends.shape):
            code = self.reference.copy()
            code[k] = ends[end, k]
            far[end, k] = np.linalg.norm(self._features(code) - base)
        self.extremes = np.where(far[0] > far[1], ends[0], ends[1])
        self.strengths = far.max(axis=0)

    def _features(self, code: NDArray) -> NDArray:
        return self._model.scaler.scale(self._model.decoder.features(code))

    def codes(self, vertices: NDArray) -> NDArray:
        """Codes (N, K) of shapes (N, V, 3)."""
        return self._model.encode(vertices)

    def shapes(self, codes: NDArray) -> NDArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        return self._model.decode(codes)

    def support(self, component: int) -> NDArray:
        """Size (V,) of a component's weights at every vertex, the largest 1."""
        weights = self._model.weights.C[:, :, component].astype(np.float64)
        return _relative(np.linalg.norm(weights, axis=1))


class EdgeComponents:
    """Components of SPLOCS on edge lengths and dihedral angles, after Wang et al. (2017).

    Args:
        method: the trained method.
        training: (N, V, 3) its training shapes, the reference first.
    """

    name = EdgeSplocs.name

    def __init__(self, method: EdgeSplocs, training: NDArray) -> None:
        """Find the extremes: features are linear in the weights, so the farthest weight is one."""
        self._method = method
        weights = method.weights(training)
        self.reference = weights[0]
        away = np.abs(weights - weights[0])
        farthest = away.argmax(axis=0)
        self.extremes = np.take_along_axis(weights, farthest[None], axis=0)[0]
        self.strengths = away.max(axis=0) * np.linalg.norm(method.components, axis=(1, 2))

    def codes(self, vertices: NDArray) -> NDArray:
        """Weights (N, K) of shapes (N, V, 3)."""
        return self._method.weights(vertices)

    def shapes(self, codes: NDArray) -> NDArray:
        """Shapes (N, V, 3) of weights (N, K), rigidly aligned to the reference."""
        return self._method.decode(np.column_stack([codes, np.zeros((len(codes), 3))]))

    def support(self, component: int) -> NDArray:
        """Largest weight (V,) of a component on the edges of every vertex, the largest 1."""
        sizes = np.linalg.norm(self._method.components[component], axis=1)
        at = np.zeros(self._method.edges.max() + 1)
        np.maximum.at(at, self._method.edges, sizes[:, None])
        return _relative(at)


def _relative(sizes: NDArray) -> NDArray:
    return sizes / (sizes.max() or 1.0)


def strongest(components: Components, count: int = 4) -> NDArray:
    """Indices of the strongest components, the strongest first."""
    return np.argsort(-components.strengths, kind="stable")[:count]


def motion_shares(components: Components, clean: NDArray, noisy: NDArray) -> NDArray:
    """Share (K,) of motion in each activation's variance; the rest is noise.

    It is var z / (var z + var(z′ − z)), with z the activations of frames without noise and z′ those
    of the same frames with noise.

    Args:
        components: components learned from noisy frames.
        clean, noisy: (N, V, 3) the same test frames without and with noise.
    """
    z, disturbed = components.codes(clean), components.codes(noisy)
    motion, noise = z.var(axis=0), (disturbed - z).var(axis=0)
    return motion / np.maximum(motion + noise, np.finfo(float).tiny)


def swing_explained(
    components: Components, clean: NDArray, noisy: NDArray, kept: NDArray, shape: tuple[int, int]
) -> float:
    """Share of the swing's variance that a linear function of some noisy activations explains (R²).

    Args:
        components: components learned from noisy frames.
        clean, noisy: (N, V, 3) the same test frames without and with noise. The swing is that of
            the clean ones, the activations are those of the noisy ones.
        kept: indices of the components whose activations are used.
        shape: columns and rows of the flag's vertices.
    """
    angle = swing_angles(clean, shape)
    columns = np.column_stack([np.ones(len(angle)), components.codes(noisy)[:, kept]])
    residual = angle - columns @ np.linalg.lstsq(columns, angle, rcond=None)[0]
    return float(1.0 - residual.var() / angle.var())


def corner_shares(components: Components, rest: NDArray) -> NDArray:
    """Share (K,) of each component's support in the two noisy corners.

    They are the vertices where the noise is more than half as strong as at the corner itself.
    """
    corner = noise_profile(rest) > CORNER_GAIN / 2
    supports = np.array([components.support(k) for k in range(len(components.strengths))])
    return supports[:, corner].sum(axis=1) / supports.sum(axis=1)


def rebuilt(components: Components, noisy: NDArray, kept: NDArray) -> NDArray:
    """Shapes (N, V, 3) of noisy frames from some components, all others as in the reference."""
    codes = np.tile(components.reference, (len(noisy), 1))
    codes[:, kept] = components.codes(noisy)[:, kept]
    return components.shapes(codes)


def on_pole(shapes: NDArray, rest: NDArray) -> NDArray:
    """Shapes (N, V, 3) moved, not turned, so that the middle of the pole is where it is at rest."""
    pole = rest[:, 0] == rest[:, 0].min()
    away = rest[pole].mean(axis=0) - shapes[:, pole].mean(axis=1)
    return shapes + away[:, None]


def explained(clean: NDArray, estimate: NDArray, rest: NDArray, rigid: bool = False) -> float:
    """Share of the frames' deformation that an estimate reproduces; 0 is that of the flat flag.

    It is 1 − (E_rms of the estimate / E_rms of the flat flag)².

    Args:
        clean: (N, V, 3) frames without noise.
        estimate: (N, V, 3) estimates of them.
        rest: (V, 3) the flat flag.
        rigid: true to align the estimate and the flat flag rigidly to every frame: the swing of the
            whole flag, which lengths and angles do not determine, then counts no longer. Otherwise
            both are translated to the pole.
    """
    flat = np.broadcast_to(rest, clean.shape)
    if not rigid:
        estimate = on_pole(estimate, rest)
    align = "rigid" if rigid else "none"
    return 1.0 - (e_rms(clean, estimate, align) / e_rms(clean, flat, align)) ** 2
