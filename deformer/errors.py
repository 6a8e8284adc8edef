"""The one exception type that stands for a user's mistake."""


class InputError(ValueError):
    """Bad input: a file, index or value that the user can correct.

    The message is one line that names what was found, what was expected and what to do.
    """
