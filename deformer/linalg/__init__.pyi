from .device import (
    check_device as check_device,
    resolve_device as resolve_device,
)
from .levenberg_marquardt import (
    Damping as Damping,
    Descent as Descent,
    damped_step as damped_step,
    descend as descend,
)
from .nested_dissection import (
    Dissection as Dissection,
)
from .ridge import (
    ridge_regressions as ridge_regressions,
)
from .sparse_cholesky import (
    SparseCholesky as SparseCholesky,
)
from .threads import (
    CORES as CORES,
    in_parallel as in_parallel,
    one_blas_thread as one_blas_thread,
    over_parts as over_parts,
    over_ranges as over_ranges,
    ranges as ranges,
    run_calls as run_calls,
    scratch as scratch,
    start_calls as start_calls,
    use_cores as use_cores,
    wait_for as wait_for,
)
