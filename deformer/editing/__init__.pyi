from . import batch_torch as batch_torch, posterior as posterior
from .arap import (
    DecodedSurface as DecodedSurface,
)
from .axes import axis_warning as axis_warning
from .bodies import (
    BODIES as BODIES,
    Body as Body,
)
from .energy import (
    HandleEnergy as HandleEnergy,
)
from .exact_rows import (
    schur_inverse as schur_inverse,
)
from .finished_windows import (
    remove_windows as remove_windows,
)
from .fit_memory import (
    SequenceMemory as SequenceMemory,
    sequence_memory as sequence_memory,
)
from .floor import (
    Floor as Floor,
)
from .gaps import (
    surface_gaps as surface_gaps,
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
from .lifted_surface import (
    LiftedSurface as LiftedSurface,
)
from .orientations import (
    local_rotations as local_rotations,
)
from .posterior import (
    Uncertainty as Uncertainty,
    uncertainty as uncertainty,
)
from .rest import (
    poses_to_rest as poses_to_rest,
    solve_to_rest as solve_to_rest,
)
from .sequence import (
    SequenceFit as SequenceFit,
    fit_sequence as fit_sequence,
    fit_sequence_parts as fit_sequence_parts,
)
from .solution_shape import posed_shape as posed_shape
from .solver import (
    HandleSolver as HandleSolver,
)
from .units import (
    unit_warning as unit_warning,
)
