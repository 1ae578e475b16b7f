"""The one error that bad input raises."""

import re


class InputError(ValueError):
    """Input that cannot be used: the message names the file, the row or key, and the remedy.

    Words of a thousand letters, which a damaged file may hold, are shortened.
    """

    def __init__(self, message: str = ""):
        super().__init__(re.sub(r"\S{1000,}", lambda quoted: f"{quoted[0][:60]}...", message))
