"""Linear combinations of the autoencoder's components, an ablation of its decoder."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from deformer.acap import extract_all
from deformer.analysis import Activations
from deformer.baselines._data_driven import DataDrivenDeformation
from deformer.baselines._gradient_method import NOISES, GradientMethod
from deformer.baselines._gradient_space import GradientSpace
from deformer.baselines.autoencoder import Autoencoder
from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, MeshSequence
from deformer.model import DeformationModel, fit_prior
from deformer.network import ModelConfig
from deformer.training import HandleFit, choose_noise, fit_each_noise


class LinearComponents(GradientMethod):
    """Linear use of a trained autoencoder's components, an ablation of Tan et al. (AAAI 2018).

    Component k is the change of the features from the reference to its representative shape, which
    the paper's section on component analysis defines. Two latent codes equal the reference's but
    for entry k, which is its smallest or largest value over the training shapes; the representative
    shape is the one whose features are farther from the reference's. Features are the reference's
    plus a linear combination of these changes; least squares in scaled features gives the weights.
    `DataDrivenDeformation` fits handles.

    Args:
        model: a trained model; None trains one on the shapes given to `fit`.
        config: as of `train`, for that training.
        epochs: as of `train`, for that training.
        device: as of `train`, for that training.
        noise: σ of handle fits; None lets `fit` choose it. In that cross-validation the components
            remain those of all training shapes; only the prior leaves out the held-out ones.
    """

    name: ClassVar[str] = "linear components"
    space: ClassVar[Space] = "acap"

    def __init__(
        self,
        model: DeformationModel | None = None,
        *,
        config: str | ModelConfig = "default",
        epochs: int | None = None,
        device: str = "auto",
        noise: float | None = None,
    ) -> None:
        """Store the model and the settings; `fit` is needed even with a model, for the weights."""
        super().__init__(noise)
        self.config, self.epochs, self.device = config, epochs, device
        self._given = model
        self._model: DeformationModel | None = None

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components; shape 0 is the reference.

        Raises:
            InputError: the given model has another number of components or another connectivity,
                fewer than 2 shapes, or a noise that is not positive.
        """
        self._check_training(len(shapes), components)
        model = self._given
        if model is None:
            network = Autoencoder(config=self.config, epochs=self.epochs, device=self.device)
            model = network.fit(shapes, components, seed).model
        if model.components != components:
            raise InputError(
                f"components: the given model has {model.components}, got {components}; "
                "ask for as many, or give no model"
            )
        if not np.array_equal(model.reference.faces, shapes.faces):
            raise InputError("shapes: not of the connectivity that the given model was trained on")
        self._model = model
        q = self.extract(shapes.vertices)
        acts = Activations(model)
        # Of the vertices alone: the space has no links.
        V = q.shape[1]
        changes = np.stack([acts.change(k)[:V] for k in range(components)])
        space = GradientSpace(model.poisson, acts.base[:V], changes, model.scaler.gain)
        codes = space.project(q)

        def train_on(indices: IntArray) -> HandleFit:
            prior = fit_prior(codes[indices])
            return fit_each_noise(DataDrivenDeformation(space, prior, codes[indices]).fit)

        noise = self.noise or choose_noise(train_on, shapes, model.geodesics, NOISES, seed)
        self._set_deformation(DataDrivenDeformation(space, fit_prior(codes), codes), noise)
        return self

    def extract(self, vertices: FloatArray) -> FloatArray:
        """Features (N, V, 9) of shapes (N, V, 3), as the model extracts them."""
        if self._model is None:
            raise InputError("LinearComponents has learned nothing yet; call fit first")
        return extract_all(self._model.extractor, vertices)
