from .clips import (
    Clip as Clip,
    morph_glb as morph_glb,
)
from .saving import (
    SEQUENCE_SUFFIXES as SEQUENCE_SUFFIXES,
    SavedShapes as SavedShapes,
    check_shapes_output as check_shapes_output,
    check_shapes_size as check_shapes_size,
    save_shapes as save_shapes,
)
