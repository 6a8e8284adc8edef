"""The project's own autoencoder as one of the compared methods."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.baselines._checks import checked_codes, checked_handles, checked_shapes
from deformer.baselines.method import Space
from deformer.editing import HandleSolver, target_noise
from deformer.errors import InputError
from deformer.geometry import FloatArray, MeshSequence
from deformer.model import DeformationModel
from deformer.network import ModelConfig
from deformer.training import train


class Autoencoder:
    """The autoencoder of ACAP features (Tan et al., AAAI 2018) and the project's handle fit.

    Args:
        model: a trained model, usable without `fit`; `fit` replaces it.
        config: "default", "paper" or a ModelConfig, see `train`.
        epochs: number of training steps; None keeps the config's.
        device: "cpu", "cuda", "mps" or "auto".
        hard: true for exact handles with rigid relaxation; false for soft handles, whose shapes are
            decoded from a code.
    """

    name: ClassVar[str] = "autoencoder"
    space: ClassVar[Space] = "acap"

    def __init__(
        self,
        model: DeformationModel | None = None,
        *,
        config: str | ModelConfig = "default",
        epochs: int | None = None,
        device: str = "auto",
        hard: bool = True,
    ) -> None:
        """Store the model and the settings."""
        self.config, self.epochs, self.device, self.hard = config, epochs, device, hard
        self._model = model
        self._solver: HandleSolver | None = None
        self._noise = 0.0

    @property
    def model(self) -> DeformationModel:
        """The trained model; InputError without one."""
        if self._model is None:
            raise InputError("Autoencoder has no model yet; call fit first, or give it one")
        return self._model

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Train with K = `components` latent dimensions; shape 0 is the reference."""
        self._model = train(
            shapes,
            components,
            config=self.config,
            epochs=self.epochs,
            seed=seed,
            device=self.device,
        )
        self._solver = None
        return self

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3) by one pass of the encoder."""
        return self.model.encode(self._checked(vertices))

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3)."""
        return self.model.fit(self._checked(vertices))

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K), centroids at the reference's."""
        return self.model.decode(checked_codes(codes, self.model.components))

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """Most likely mesh (V, 3) when vertices (H,) are known to be at targets (H, 3).

        Handles with noise are soft, whatever `hard` is, with the noise of `target_noise`.
        """
        V = len(self.model.reference.vertices)
        index, goals, noise = checked_handles(vertices, targets, V, noise)
        if self._solver is None or noise != self._noise:
            used = target_noise(self.model, noise) if noise else None
            self._solver, self._noise = HandleSolver(self.model, noise=used), noise
        self._solver.set_handles(index, goals, hard=self.hard and not noise)
        return np.asarray(self._solver.solve().vertices, dtype=np.float64)

    def _checked(self, vertices: ArrayLike) -> FloatArray:
        return checked_shapes(vertices, len(self.model.reference.vertices))
