from .document import (
    Document as Document,
    load_document as load_document,
)
from .saving import (
    save_mesh as save_mesh,
)
