from .activations import (
    Activations as Activations,
)
from .components import (
    SUPPORT_THRESHOLD as SUPPORT_THRESHOLD,
    Component as Component,
    ComponentAnalysis as ComponentAnalysis,
)
from .familiarity import (
    Familiarity as Familiarity,
)
from .interpolation import (
    ShapePath as ShapePath,
    interpolate as interpolate,
    interpolate_codes as interpolate_codes,
)
from .mirroring import (
    mirrored_pose as mirrored_pose,
)
from .regions import (
    ComponentRegion as ComponentRegion,
    component_regions as component_regions,
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
