from .examination import examine as examine
from .repair import (
    Repair as Repair,
    repair_shapes as repair_shapes,
)
from .report import (
    Finding as Finding,
    Report as Report,
)
