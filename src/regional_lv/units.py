"""Conversions between units, and how one is written."""

KPA_PER_MMHG = 0.133322387415


def after_number(unit: str) -> str:
    """What is written after a number: a space and the unit, or nothing of what has none ("1")."""
    return "" if unit == "1" else f" {unit}"
