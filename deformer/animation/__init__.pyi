from .clips import (
    Clip as Clip,
    morph_glb as morph_glb,
)
from .saving import (
    SEQUENCE_SUFFIXES as SEQUENCE_SUFFIXES,
    SavedShapes as SavedShapes,
    check_shapes_output as check_shapes_output,
    save_shapes as save_shapes,
)
