from . import paper as paper
from .journal import (
    COLUMNS as COLUMNS,
    FAILURE as FAILURE,
    Row as Row,
)
from .methods import (
    Setting as Setting,
    known_methods as known_methods,
)
from .plan import (
    LAMBDA_METHOD as LAMBDA_METHOD,
    PROTOCOLS as PROTOCOLS,
    Study as Study,
    make_plan as make_plan,
)
from .presets import (
    QUICK as QUICK,
    paper_sources as paper_sources,
    paper_studies as paper_studies,
)
from .protocols import (
    sparse_control as sparse_control,
)
from .runner import (
    evaluate as evaluate,
)
from .sources import (
    Reading as Reading,
    Source as Source,
)
from .splits import (
    Split as Split,
)
from .summary import (
    Summary as Summary,
    Table as Table,
    summarise as summarise,
)
