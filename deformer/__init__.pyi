from . import baselines as baselines, evaluation as evaluation, io as io
from .acap import (
    FeatureExtractor as FeatureExtractor,
    FeatureScaler as FeatureScaler,
    PoissonSystem as PoissonSystem,
    extract_features as extract_features,
    reconstruct as reconstruct,
    vertex_normals as vertex_normals,
)
from .analysis import (
    Activations as Activations,
    BlendSpace as BlendSpace,
    Component as Component,
    ComponentAnalysis as ComponentAnalysis,
    ComponentKeys as ComponentKeys,
    ComponentRegion as ComponentRegion,
    Familiarity as Familiarity,
    ShapePath as ShapePath,
    Synthesis as Synthesis,
    check_blend_space as check_blend_space,
    component_keys as component_keys,
    component_regions as component_regions,
    draw_codes as draw_codes,
    interpolate as interpolate,
    interpolate_codes as interpolate_codes,
    mirrored_pose as mirrored_pose,
    transfer as transfer,
    transfer_code as transfer_code,
)
from .animation import (
    SEQUENCE_SUFFIXES as SEQUENCE_SUFFIXES,
    SavedShapes as SavedShapes,
    check_shapes_output as check_shapes_output,
    check_shapes_size as check_shapes_size,
    save_shapes as save_shapes,
)
from .compilation_state import compiling as compiling
from .documents import (
    Document as Document,
    check_mesh_output as check_mesh_output,
    load_document as load_document,
    save_mesh as save_mesh,
)
from .editing import (
    BODIES as BODIES,
    Body as Body,
    Floor as Floor,
    Handle as Handle,
    HandleSolver as HandleSolver,
    Layout as Layout,
    Pose as Pose,
    SequenceFit as SequenceFit,
    SequenceMemory as SequenceMemory,
    Uncertainty as Uncertainty,
    axis_warning as axis_warning,
    fit_sequence as fit_sequence,
    fit_sequence_parts as fit_sequence_parts,
    layout as layout,
    local_rotations as local_rotations,
    posed_shape as posed_shape,
    poses_to_rest as poses_to_rest,
    remove_windows as remove_windows,
    sequence_memory as sequence_memory,
    solve_to_rest as solve_to_rest,
    surface_gaps as surface_gaps,
    target_noise as target_noise,
    uncertainty as uncertainty,
    unit_warning as unit_warning,
)
from .errors import (
    InputError as InputError,
)
from .geometry import (
    FaceStrain as FaceStrain,
    Geodesics as Geodesics,
    Mesh as Mesh,
    MeshSequence as MeshSequence,
    StoredShapes as StoredShapes,
    SurfacePoint as SurfacePoint,
    Symmetry as Symmetry,
    e_rms as e_rms,
    farthest_points as farthest_points,
    find_symmetry as find_symmetry,
    interpolate_rotations as interpolate_rotations,
    log_to_rotation as log_to_rotation,
    spread as spread,
    symmetry_about as symmetry_about,
    vertex_errors as vertex_errors,
)
from .io import (
    load_mesh as load_mesh,
    load_shapes as load_shapes,
)
from .model import (
    DeformationModel as DeformationModel,
    check_model_folder as check_model_folder,
    load_model as load_model,
    save_names as save_names,
    shipped_models as shipped_models,
)
from .network import (
    AdamSettings as AdamSettings,
    FactorisationSettings as FactorisationSettings,
    ModelConfig as ModelConfig,
)
from .preflight import (
    Finding as Finding,
    Repair as Repair,
    Report as Report,
    examine as examine,
    repair_shapes as repair_shapes,
)
from .rigging import (
    Rig as Rig,
    rig as rig,
)
from .training import (
    TrainingMemory as TrainingMemory,
    TrainingProgress as TrainingProgress,
    assist_training as assist_training,
    check_checkpoint as check_checkpoint,
    check_resumable as check_resumable,
    has_checkpoint as has_checkpoint,
    remove_checkpoint as remove_checkpoint,
    train as train,
    training_memory as training_memory,
)
from .workspace import (
    Workspace as Workspace,
)
