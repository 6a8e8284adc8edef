from .document import (
    DOCUMENT_SUFFIXES as DOCUMENT_SUFFIXES,
    USD_SUFFIXES as USD_SUFFIXES,
    Document as Document,
    checked_document as checked_document,
    load_document as load_document,
)
from .glb_axes import upright_glb as upright_glb
from .glb_poses import posed_glb as posed_glb
from .glb_roots import rooted_glb as rooted_glb
from .saving import (
    Like as Like,
    check_mesh_output as check_mesh_output,
    document_of as document_of,
    save_mesh as save_mesh,
    up_of as up_of,
)
from .text_files import single_precision as single_precision
from .usd import write_usd as write_usd
