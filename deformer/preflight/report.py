"""What the examination of shapes found: findings and facts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Severity = Literal["error", "warning", "info"]

_RANK = {"error": 0, "warning": 1, "info": 2}
_MOST_NAMED = 5


@dataclass(frozen=True)
class Finding:
    """One observation.

    Args:
        severity: "error" when training cannot work, "warning" when it may suffer, or "info".
        kind: one word for programs, e.g. "mirrored" or "units".
        message: one line: the defect, where it is, what was expected, and the remedy.
        shapes: indices of the shapes it is about; empty if it is about all.
        vertices: indices of the vertices it is about; empty if it is about whole shapes.
        faces: the same of faces.
        values: what a repair needs to know, JSON values by name.
    """

    severity: Severity
    kind: str
    message: str
    shapes: tuple[int, ...] = ()
    vertices: tuple[int, ...] = ()
    faces: tuple[int, ...] = ()
    values: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """Result of `examine`.

    Args:
        findings: errors first, then warnings, then information.
        facts: counts and measures by name; lengths in the units of the data, angles in radians.
    """

    findings: tuple[Finding, ...]
    facts: dict[str, Any]

    @property
    def usable(self) -> bool:
        """True if there is no error."""
        return all(finding.severity != "error" for finding in self.findings)

    def of_kind(self, kind: str) -> tuple[Finding, ...]:
        """The findings of one kind."""
        return tuple(finding for finding in self.findings if finding.kind == kind)

    def as_dict(self) -> dict[str, Any]:
        """The report as dictionaries and lists, for JSON."""
        return {
            "usable": self.usable,
            "facts": dict(self.facts),
            "findings": [asdict(finding) for finding in self.findings],
        }


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Errors first, then warnings, then information."""
    return tuple(sorted(findings, key=lambda finding: _RANK[finding.severity]))


class Labels:
    """How messages call shapes: by index, and by file where they come from files.

    Args:
        names: file name of each shape, or None.
    """

    def __init__(self, names: Sequence[str] | None) -> None:
        """Keep the names."""
        self._names = names

    def __call__(self, shapes: Sequence[int]) -> str:
        """ "shape 3 (walk_3.obj)", or "shapes 3 (walk_3.obj), 5 (walk_5.obj)" and so on."""
        shown = [
            str(i) if self._names is None else f"{i} ({self._names[i]})"
            for i in shapes[:_MOST_NAMED]
        ]
        more = len(shapes) - len(shown)
        listed = ", ".join(shown) + (f" and {more} more" if more else "")
        return f"shape{'s' if len(shapes) > 1 else ''} {listed}"
