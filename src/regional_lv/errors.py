"""The one error that bad input raises."""


class InputError(ValueError):
    """Input that cannot be used: the message names the file, the row or key, and the remedy."""
