from .choice import executor_of as executor_of
from .executor import (
    Done as Done,
    Executor as Executor,
    Failed as Failed,
    InProcess as InProcess,
    Part as Part,
    WorkerLost as WorkerLost,
    ended as ended,
    results as results,
    run_to_end as run_to_end,
    stream as stream,
)
from .processes import Processes as Processes
from .threads import Threads as Threads
