from .document import (
    DOCUMENT_SUFFIXES as DOCUMENT_SUFFIXES,
    Document as Document,
    checked_document as checked_document,
    load_document as load_document,
)
from .saving import (
    save_mesh as save_mesh,
)
