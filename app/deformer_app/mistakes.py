"""What is said of errors that a person can do something about."""

from __future__ import annotations

import errno


def mistake(error: Exception) -> str:
    """Describe an error in a line: what the library or the system refused, and what to do."""
    return system_mistake(error) if isinstance(error, OSError) else str(error)


def system_mistake(error: OSError) -> str:
    """Describe what the system refused, and what to do."""
    remedies = {
        errno.ENOSPC: "free some space, or choose another place",
        errno.EDQUOT: "free some space, or choose another place",
        errno.EACCES: "change its permissions, or choose another place",
        errno.EPERM: "change its permissions, or choose another place",
        errno.EROFS: "choose another place",
        errno.EMFILE: "close other programs, or raise the limit (ulimit -n)",
    }
    remedy = remedies.get(error.errno or 0, "check the path and the disk")
    return f"{error.filename or 'system'}: {error.strerror or error}; {remedy}"
