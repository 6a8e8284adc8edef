"""How well methods do on shapes that they have not seen: splits, protocols, a resumable runner."""

from deformer.evaluation.material import Source
from deformer.evaluation.methods import Setting, known_methods
from deformer.evaluation.plan import PROTOCOLS, Study, make_plan
from deformer.evaluation.protocols import sparse_control
from deformer.evaluation.rows import COLUMNS, FAILURE, Row
from deformer.evaluation.runner import evaluate
from deformer.evaluation.splits import Split

__all__ = [
    "COLUMNS",
    "FAILURE",
    "PROTOCOLS",
    "Row",
    "Setting",
    "Source",
    "Split",
    "Study",
    "evaluate",
    "known_methods",
    "make_plan",
    "sparse_control",
]
