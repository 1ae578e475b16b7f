"""Keys of a model, or of the physics: nested mappings that are never changed in place."""

from collections.abc import Mapping


def value_at(model: Mapping, path: tuple[str, ...]):
    """What a model, or the physics, say at `path`, a section and the keys below it."""
    for key in path:
        model = model[key]
    return model


def with_value(model: Mapping, path: tuple[str, ...], value) -> dict:
    """`model` with one key set, the rest shared. path: a section and the keys below it."""
    first, *rest = path
    return {**model, first: with_value(model[first], tuple(rest), value) if rest else value}
