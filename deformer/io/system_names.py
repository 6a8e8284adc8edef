"""Names of files as other systems see them."""

from __future__ import annotations

import os
import re
import unicodedata

from deformer.checks import checked_text

WINDOWS = os.name == "nt"
_DEVICE = re.compile(r"(?:con|prn|aux|nul|(?:com|lpt)[\d¹²³])", re.IGNORECASE)
_FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]')


def windows_fault(name: str) -> str | None:
    """Why Windows cannot have a file of a name, for a message; None if it can."""
    if _DEVICE.fullmatch(name.split(".")[0].rstrip()):
        return "is the name of a device on Windows"
    forbidden = _FORBIDDEN.search(name)
    if forbidden:
        return f"has the character {forbidden[0]!r}, which names on Windows cannot have"
    if name.endswith((".", " ")):
        return "ends in a dot or a space, which Windows leaves out"
    return None


def folded_name(name: str) -> str:
    """A key that is equal for names which some file system takes for one.

    Those of Windows and macOS ignore case, and macOS ignores how accents are composed.

    Raises:
        InputError: no text.
    """
    name = checked_text(name, "name")
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
