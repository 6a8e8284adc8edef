"""The compared methods by name."""

from __future__ import annotations

from collections.abc import Callable

from deformer.baselines.acap import AcapSplocs
from deformer.baselines.biharmonic import Biharmonic, NearestBiharmonic
from deformer.baselines.clustered_pca import ClusteredPCA
from deformer.baselines.edges import EdgeSplocs
from deformer.baselines.gradients import GradientSplocs
from deformer.baselines.method import PosingMethod
from deformer.baselines.pca import PCA
from deformer.baselines.rigid import Arap, NearestArap
from deformer.baselines.splocs import SPLOCS
from deformer.baselines.structured_factors import StructuredFactors

METHODS: dict[str, Callable[[], PosingMethod]] = {
    "pca": PCA,
    "clustered-pca": ClusteredPCA,
    "splocs": SPLOCS,
    "structured-factors": StructuredFactors,
    "splocs-gradients": GradientSplocs,
    "splocs-edges": EdgeSplocs,
    "splocs-acap": AcapSplocs,
    "arap": Arap,
    "arap-nearest": NearestArap,
    "biharmonic": Biharmonic,
    "biharmonic-nearest": NearestBiharmonic,
}
"""Constructors of untrained methods by name, in the order of tables."""
