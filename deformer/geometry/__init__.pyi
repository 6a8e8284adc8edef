from .axes import (
    PROPER_AXES as PROPER_AXES,
    axes_text as axes_text,
    axis_turn as axis_turn,
)
from .geodesics import (
    Geodesics as Geodesics,
    SiteGeodesics as SiteGeodesics,
)
from .laplacian import (
    cotan_weights as cotan_weights,
    graph_laplacian as graph_laplacian,
    rhs_ as rhs_,
    rhs_adjoint_ as rhs_adjoint_,
    rhs_matrix as rhs_matrix,
)
from .mesh import (
    FARTHEST as FARTHEST,
    FloatArray as FloatArray,
    IntArray as IntArray,
    Mesh as Mesh,
    MeshSequence as MeshSequence,
    checked_faces as checked_faces,
    connected_components as connected_components,
    connectivity_hash as connectivity_hash,
    edges as edges,
    one_rings as one_rings,
    site_rings as site_rings,
)
from .metrics import (
    e_rms as e_rms,
    sted as sted,
    sted_spatial as sted_spatial,
    vertex_errors as vertex_errors,
)
from .rotations import (
    align as align,
    checked_rotations as checked_rotations,
    closest_rotation_ as closest_rotation_,
    closest_rotations as closest_rotations,
    exp_ as exp_,
    interpolate_rotations as interpolate_rotations,
    log_ as log_,
    log_to_rotation as log_to_rotation,
    polar as polar,
    procrustes as procrustes,
    right_jacobian as right_jacobian,
    right_jacobian_ as right_jacobian_,
    rotation_to_log as rotation_to_log,
)
from .sampling import (
    farthest_points as farthest_points,
    farthest_rows as farthest_rows,
    spread as spread,
)
from .seams import (
    SEAM_TOLERANCE as SEAM_TOLERANCE,
    Seams as Seams,
    find_seams as find_seams,
    no_seams as no_seams,
    same_place as same_place,
)
from .stored_shapes import (
    ShapeSequence as ShapeSequence,
    StoredShapes as StoredShapes,
    joined_shapes as joined_shapes,
    map_shapes as map_shapes,
    shape_sequence as shape_sequence,
)
from .strain import (
    FaceStrain as FaceStrain,
)
from .surface_points import (
    MOST_ORIENTATION_WEIGHT as MOST_ORIENTATION_WEIGHT,
    FramePoint as FramePoint,
    RowPoint as RowPoint,
    SurfacePoint as SurfacePoint,
    SurfacePoints as SurfacePoints,
    plain_point as plain_point,
)
from .symmetry import (
    Symmetry as Symmetry,
    find_symmetry as find_symmetry,
    most_symmetric as most_symmetric,
    symmetry_about as symmetry_about,
)
