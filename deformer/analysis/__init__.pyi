from .activations import (
    Activations as Activations,
    Familiarity as Familiarity,
)
from .components import (
    SUPPORT_THRESHOLD as SUPPORT_THRESHOLD,
    Component as Component,
    ComponentAnalysis as ComponentAnalysis,
)
from .interpolation import (
    ShapePath as ShapePath,
    interpolate as interpolate,
)
from .shape_keys import (
    ComponentKeys as ComponentKeys,
    component_keys as component_keys,
)
from .synthesis import (
    BlendSpace as BlendSpace,
    Synthesis as Synthesis,
    check_blend_space as check_blend_space,
    draw_codes as draw_codes,
    transfer as transfer,
    transfer_code as transfer_code,
)
