from . import batch_torch as batch_torch, posterior as posterior
from .arap import (
    DecodedSurface as DecodedSurface,
    schur_inverse as schur_inverse,
)
from .energy import (
    HandleEnergy as HandleEnergy,
)
from .handle_layout import (
    Layout as Layout,
    layout as layout,
)
from .handles import (
    Handle as Handle,
    Pose as Pose,
    target_noise as target_noise,
)
from .orientations import (
    local_rotations as local_rotations,
)
from .posterior import (
    Uncertainty as Uncertainty,
    uncertainty as uncertainty,
)
from .sequence import (
    SequenceFit as SequenceFit,
    fit_sequence as fit_sequence,
)
from .solver import (
    HandleSolver as HandleSolver,
)
from .units import (
    unit_warning as unit_warning,
)
