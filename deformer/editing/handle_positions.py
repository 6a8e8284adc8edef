"""Handle positions p_h(z) = Σ_i T_i(z) a_h,i of the latent code, with their derivatives.

T_i are deformation gradients, a_h,i their coefficients (`PoissonSystem.position_coefficients`).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from deformer.acap import position_jacobian, position_sensitivities, positions_from_features
from deformer.geometry import FloatArray
from deformer.network import Decoder


class HandlePositions(Protocol):
    """Handle positions as a function of the latent code, relative to the shape's centroid."""

    def at(self, z: FloatArray) -> Evaluation:
        """Evaluate at a latent code z (K,); the derivative is computed when it is asked for."""
        ...


class Evaluation(Protocol):
    """Handle positions (H, 3) at one latent code, relative to the shape's centroid."""

    positions: FloatArray

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        ...


class DenseHandlePositions:
    """Handle positions Σ_i T_i(z) a_h,i over a decoder's vertices.

    Args:
        decoder: decoder of n vertices.
        coefficients: (H, n, 3) coefficients a_h,i.
        fast: true to compute in single precision.
    """

    def __init__(self, decoder: Decoder, coefficients: FloatArray, fast: bool = False) -> None:
        """Store the coefficients in both precisions."""
        self.decoder, self.coefficients = decoder, coefficients
        self.fast = fast
        self.single_coefficients = coefficients.astype(np.float32)

    def at(self, z: FloatArray) -> DenseEvaluation:
        """Evaluate at a latent code z (K,); the derivative is computed when it is asked for."""
        return DenseEvaluation(self, z)


class DenseEvaluation:
    """`DenseHandlePositions` at one latent code."""

    def __init__(self, handles: DenseHandlePositions, z: FloatArray) -> None:
        """Evaluate the positions (H, 3)."""
        self._handles, self._z = handles, z
        decoder = handles.decoder
        self._q = decoder.single_features(z) if handles.fast else decoder.features(z)
        self.positions = positions_from_features(self._q, handles.coefficients)

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        decoder, coefficients = self._handles.decoder, self._handles.coefficients
        if self._handles.fast and decoder.pointwise:
            slope = decoder.pointwise_slope(self._q)
            return position_jacobian(
                self._q, slope, decoder.matrix, self._handles.single_coefficients
            )
        g = position_sensitivities(self._q, coefficients)
        J = decoder.pull_back(self._z, g.reshape(-1, *g.shape[2:]))
        return J.reshape(len(coefficients), 3, len(self._z))


class CorrectedHandlePositions:
    """Handle positions p(z) by landmarks with a linear correction: p(z) + correction z + offset.

    Args:
        landmarks: positions p (H, 3) by landmarks.
        correction: (H, 3, K) derivative by all vertices minus that by landmarks; None is zero.
    """

    def __init__(self, landmarks: HandlePositions, correction: FloatArray | None = None) -> None:
        """Start with an offset of zero."""
        self._landmarks, self._correction = landmarks, correction
        self._offset: FloatArray | float = 0.0

    def at(self, z: FloatArray) -> CorrectedEvaluation:
        """Evaluate at a latent code z (K,); the derivative is computed when it is asked for."""
        return CorrectedEvaluation(self._landmarks.at(z), z, self._correction, self._offset)

    def match(self, z: FloatArray, p: FloatArray) -> CorrectedEvaluation:
        """Choose the offset that makes the positions at z (K,) equal to p (H, 3).

        Returns:
            The evaluation at z.
        """
        here = self.at(z)
        self._offset = self._offset + p - here.positions
        here.positions = p
        return here


class CorrectedEvaluation:
    """`CorrectedHandlePositions` at one latent code."""

    def __init__(
        self,
        here: Evaluation,
        z: FloatArray,
        correction: FloatArray | None,
        offset: FloatArray | float,
    ) -> None:
        """Evaluate the positions (H, 3)."""
        self._here, self._correction = here, correction
        self.positions = here.positions + offset
        if correction is not None:
            self.positions += correction @ z

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        J = self._here.derivative()
        return J if self._correction is None else J + self._correction
