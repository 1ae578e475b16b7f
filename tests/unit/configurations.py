"""Configurations for tests."""


def changed(path: str, value) -> dict:
    """A minimal configuration with one key set."""
    root = {"study": "mine"}
    section = root
    *sections, key = path.split(".")
    for name in sections:
        section = section.setdefault(name, {})
    section[key] = value
    return root
