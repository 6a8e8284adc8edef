from .features import (
    STRETCH_COLUMNS as STRETCH_COLUMNS,
    STRETCH_ROWS as STRETCH_ROWS,
    FeatureExtractor as FeatureExtractor,
    FeatureScaler as FeatureScaler,
    extract_all as extract_all,
    extract_features as extract_features,
    features_to_gradients as features_to_gradients,
    vertex_normals as vertex_normals,
)
from .jacobians import (
    arm_jacobian as arm_jacobian,
    arm_positions as arm_positions,
    arm_sensitivities as arm_sensitivities,
    gradient_tangents as gradient_tangents,
)
from .poisson import (
    PoissonSystem as PoissonSystem,
    reconstruct as reconstruct,
)
