"""Deformer: drag a few points of a mesh; a prior learned from example shapes moves the rest."""

from deformer.acap import (
    FeatureExtractor,
    FeatureScaler,
    PoissonSystem,
    extract_features,
    reconstruct,
    vertex_normals,
)
from deformer.analysis import (
    Activations,
    Component,
    ComponentAnalysis,
    Familiarity,
    ShapePath,
    Synthesis,
    draw_codes,
    interpolate,
    transfer,
    transfer_code,
)
from deformer.editing import (
    Handle,
    HandleSolver,
    Pose,
    SequenceFit,
    Uncertainty,
    fit_sequence,
    uncertainty,
)
from deformer.errors import InputError
from deformer.geometry import (
    FaceStrain,
    Geodesics,
    Mesh,
    MeshSequence,
    Symmetry,
    e_rms,
    farthest_points,
    find_symmetry,
    symmetry_about,
)
from deformer.io import load_mesh, load_shapes, save_mesh, save_shapes
from deformer.model import DeformationModel, load_model, save_names, shipped_models
from deformer.network import ModelConfig
from deformer.training import train

__all__ = [
    "Activations",
    "Component",
    "ComponentAnalysis",
    "DeformationModel",
    "FaceStrain",
    "Familiarity",
    "FeatureExtractor",
    "FeatureScaler",
    "Geodesics",
    "Handle",
    "HandleSolver",
    "InputError",
    "Mesh",
    "MeshSequence",
    "ModelConfig",
    "PoissonSystem",
    "Pose",
    "SequenceFit",
    "ShapePath",
    "Symmetry",
    "Synthesis",
    "Uncertainty",
    "draw_codes",
    "e_rms",
    "extract_features",
    "farthest_points",
    "find_symmetry",
    "fit_sequence",
    "interpolate",
    "load_mesh",
    "load_model",
    "load_shapes",
    "reconstruct",
    "save_mesh",
    "save_names",
    "save_shapes",
    "shipped_models",
    "symmetry_about",
    "train",
    "transfer",
    "transfer_code",
    "uncertainty",
    "vertex_normals",
]
