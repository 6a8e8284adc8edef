from .atomic import (
    atomic_path as atomic_path,
    check_output_file as check_output_file,
    read_bytes as read_bytes,
)
from .copies import (
    check_copy as check_copy,
    copied_path as copied_path,
    save_copy as save_copy,
)
from .directories import (
    atomic_directory as atomic_directory,
    begins_with as begins_with,
    check_directory as check_directory,
    digest as digest,
)
from .file_kinds import (
    SHAPE_SUFFIXES as SHAPE_SUFFIXES,
    expecting as expecting,
    kind_of as kind_of,
    wrong_kind as wrong_kind,
)
from .glb_builder import (
    INDICES as INDICES,
    VERTICES as VERTICES,
    GlbBuilder as GlbBuilder,
    glb_of as glb_of,
)
from .gltf import (
    GltfAsset as GltfAsset,
    read_gltf as read_gltf,
)
from .gltf_marks import (
    clip_extras as clip_extras,
    is_upright_node as is_upright_node,
    scene_up as scene_up,
    upright_node as upright_node,
)
from .gltf_meshes import (
    GltfScene as GltfScene,
    VertexRange as VertexRange,
)
from .gltf_packing import packed_gltf as packed_gltf
from .handle_files import (
    HandleBody as HandleBody,
    HandleFile as HandleFile,
    HandlePrior as HandlePrior,
    HandleStart as HandleStart,
    HandleTarget as HandleTarget,
    load_handles as load_handles,
)
from .json_files import (
    load_split as load_split,
    read_json as read_json,
    write_json as write_json,
)
from .json_values import (
    LARGEST as LARGEST,
    JsonValue as JsonValue,
    parse_value as parse_value,
    read_value as read_value,
)
from .loading import (
    load_mesh as load_mesh,
    load_shapes as load_shapes,
    shape_files as shape_files,
)
from .locks import locked as locked
from .meshes import (
    MESH_SUFFIXES as MESH_SUFFIXES,
    check_shapes_output as check_shapes_output,
    mesh_bytes as mesh_bytes,
    save_mesh as save_mesh,
    save_shape_files as save_shape_files,
    save_shapes as save_shapes,
    write_npz as write_npz,
)
from .ply import (
    PlyElement as PlyElement,
    PlyProperty as PlyProperty,
    ply_header as ply_header,
    ply_row as ply_row,
)
from .references import with_reference as with_reference
from .row_files import (
    read_rows as read_rows,
    write_rows as write_rows,
)
from .system_names import folded_name as folded_name
from .tensors import (
    read_metadata as read_metadata,
    read_tensors as read_tensors,
    write_tensors as write_tensors,
)
from .track_arrays import (
    HandleTracks as HandleTracks,
    handle_tracks as handle_tracks,
)
from .usd import (
    UsdScene as UsdScene,
    open_usd as open_usd,
)
from .usd_meshes import UsdMesh as UsdMesh
from .usd_modules import usd_library as usd_library
