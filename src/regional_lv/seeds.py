"""Seeds for every random step, derived from the one seed of the config."""

import hashlib


def derive(seed: int, *names: object) -> int:
    """Return a 31-bit seed that depends on `seed` and on the names of the step that asks.

    Hashing (SHA-256) instead of adding an offset keeps steps independent of one another and of
    the order in which they run, so that one core or two give the same numbers.
    """
    text = "/".join([str(seed), *map(str, names)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") >> 1
