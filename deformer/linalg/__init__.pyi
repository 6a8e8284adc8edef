from .device import (
    resolve_device as resolve_device,
)
from .nested_dissection import (
    Dissection as Dissection,
)
from .sparse_cholesky import (
    SparseCholesky as SparseCholesky,
)
from .threads import (
    CORES as CORES,
    begin as begin,
    each as each,
    finish as finish,
    one_blas_thread as one_blas_thread,
    over_ranges as over_ranges,
    ranges as ranges,
    scratch as scratch,
    together as together,
)
