from .displacements import (
    link_lever as link_lever,
    undisplaced as undisplaced,
)
from .features import (
    FeatureExtractor as FeatureExtractor,
    extract_all as extract_all,
    extract_each as extract_each,
    extract_features as extract_features,
    vertex_normals as vertex_normals,
)
from .gradients import (
    STRETCH_COLUMNS as STRETCH_COLUMNS,
    STRETCH_ROWS as STRETCH_ROWS,
    features_to_gradients as features_to_gradients,
)
from .jacobians import (
    gradient_tangents as gradient_tangents,
    position_jacobian as position_jacobian,
    position_sensitivities as position_sensitivities,
    positions_from_features as positions_from_features,
)
from .mirror_map import (
    MirrorMap as MirrorMap,
)
from .poisson import (
    PoissonSystem as PoissonSystem,
    reconstruct as reconstruct,
)
from .scaler import (
    FeatureScaler as FeatureScaler,
)
