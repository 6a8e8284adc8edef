"""Which executor an option names."""

from __future__ import annotations

from deformer.checks import checked_integer, checked_text
from deformer.errors import InputError
from deformer.parallel.executor import Executor, InProcess
from deformer.parallel.processes import Processes


def executor_of(processes: int = 1, cluster: str | None = None) -> Executor:
    """The executor for a number of processes, or for a cluster.

    Args:
        processes: 1 is this process, more are processes of this machine.
        cluster: address of the scheduler of a Dask cluster, "tcp://HOST:PORT"; or "local:N" for N
            workers on this machine. None is no cluster.

    Raises:
        InputError: an address that cannot be one, both options, or Dask is not installed.
    """
    checked_integer(processes, "processes", least=1)
    if cluster is None:
        return InProcess() if processes == 1 else Processes(processes)
    if processes != 1:
        raise InputError(
            f"processes: got {processes} with a cluster, which has its workers; leave one out"
        )
    try:
        from deformer.parallel.cluster import Cluster
    except ModuleNotFoundError as missing:
        if (missing.name or "").split(".")[0] not in ("dask", "distributed"):
            raise
        raise InputError(
            f'cluster: needs the package {missing.name}; pip install "deformer[cluster]"'
        ) from missing
    return Cluster(checked_text(cluster, "cluster"))
