"""The one error that bad input raises, and a hint for its message."""

import difflib
import re
from collections.abc import Iterable


class InputError(ValueError):
    """Input that cannot be used: the message names the file, the row or key, and the remedy.

    Words of a thousand letters, which a damaged file may hold, are shortened.
    """

    def __init__(self, message: str = ""):
        super().__init__(re.sub(r"\S{1000,}", lambda quoted: f"{quoted[0][:60]}...", message))


def closest(name, known: Iterable[str], cutoff: float = 0.6) -> str:
    """The one of the `known` names that is spelt nearly as `name`; "" if none is."""
    return next(iter(difflib.get_close_matches(str(name), known, n=1, cutoff=cutoff)), "")
