"""Configurations for tests."""

import pytest

from regional_lv import config
from regional_lv.errors import InputError


def changed(path: str, value) -> dict:
    """A minimal configuration with one key set."""
    root = {"study": "mine"}
    section = root
    *sections, key = path.split(".")
    for name in sections:
        section = section.setdefault(name, {})
    section[key] = value
    return root


def refused(given: dict, key: str, remedy: str) -> None:
    """A configuration is not loaded; the message names the file, the key and the remedy."""
    with pytest.raises(InputError) as error:
        config.load(given, source="mine.yaml")
    message = str(error.value)
    assert "mine.yaml: " in message
    assert key in message
    assert remedy in message
