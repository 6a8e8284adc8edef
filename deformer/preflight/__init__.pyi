from .examination import examine as examine
from .report import (
    Finding as Finding,
    Report as Report,
)
