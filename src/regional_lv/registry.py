"""Named things of one kind: those of the package, and those that a plugin adds from outside.

A plugin is a Python file or module that calls `add` of a registry, for instance

    from regional_lv.mechanics.materials import MATERIALS
    MATERIALS.add(MyLaw)

It is found in two ways: named in the configuration (`plugins`), which the workflow hands to every
job through the environment variable REGIONAL_LV_PLUGINS, or installed with an entry point of the
group `regional_lv`.
"""

import contextlib
import importlib
import importlib.metadata
import importlib.util
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from regional_lv.errors import InputError, closest
from regional_lv.seeds import derive

VARIABLE = "REGIONAL_LV_PLUGINS"
"""Environment variable: paths of plugins, separated as in PATH."""

GROUP = "regional_lv"
"""Group of entry points under which installed plugins are found."""


_registries: list["Registry"] = []


@dataclass(frozen=True)
class Lazy:
    """In place of a thing of the package: imported when it is first asked for.

    where: `<module>:<attribute>`.
    """

    name: str
    where: str

    def thing(self):
        return _attribute(self.where)


def _attribute(where: str):
    """What `<module>:<attribute>` names."""
    module, _, attribute = where.partition(":")
    return getattr(importlib.import_module(module), attribute)


class Registry(Mapping):
    """Name -> thing, where every thing has an attribute `name`.

    Parameters
    ----------
    kind: what they are, for messages ("material law").
    key: key of the configuration that chooses among them, for messages.
    items: those of the package, in order; `Lazy` for what takes seconds to import.
    listed_in: `<module>:<attribute>`, more of the package in a room that nothing imports; read when
        the registry is first looked into.

    Raises InputError for a name that is not there.
    """

    def __init__(self, kind: str, key: str, items: Iterable = (), listed_in: str = ""):
        self.kind, self.key = kind, key
        self._items = {item.name: item for item in items}
        self._listed_in = listed_in
        _registries.append(self)

    def add(self, item):
        """Register `item` under its name; returned, so that `add` can decorate a class.

        The same name again replaces what it stood for, such as an item of the package.
        """
        self._items[item.name] = item
        return item

    def _complete(self) -> None:
        """Take in what is listed in another room, and what plugins add."""
        where, self._listed_in = self._listed_in, ""
        for item in _attribute(where) if where else ():
            self._items.setdefault(item.name, item)
        load_plugins()

    def __getitem__(self, name: str):
        item = self.entry(name)
        return item.thing() if isinstance(item, Lazy) else item

    def entry(self, name: str):
        """What is registered: the thing, or what stands for it until it is asked for."""
        self._complete()
        if name not in self._items:
            close = closest(name, self._items)
            hint = f"did you mean {close}?" if close else f"choose among {', '.join(self)}"
            raise InputError(f"{self.key}: {name!r} is not a known {self.kind}; {hint}")
        return self._items[name]

    def __contains__(self, name) -> bool:
        self._complete()
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        self._complete()
        return iter(self._items)

    def __len__(self) -> int:
        self._complete()
        return len(self._items)


_loaded: set[str] = set()
"""Resolved paths of plugins; "" stands for all that are installed."""


def load_plugins(paths: Iterable[str | Path] = ()) -> None:
    """Import the plugins at `paths`, those of the environment and the installed ones, each once.

    Raises InputError for a file that is not there or that fails.
    """
    with _once("") as is_new:
        for entry in importlib.metadata.entry_points(group=GROUP) if is_new else ():
            entry.load()
    named = *map(str, paths), *os.environ.get(VARIABLE, "").split(os.pathsep)
    for path in filter(None, named):
        resolved = os.path.realpath(path)
        with _once(resolved) as is_new:
            if is_new:
                _import(Path(path), f"{GROUP}_plugin_{Path(path).stem}_{derive(0, resolved):x}")


@contextlib.contextmanager
def _once(plugin: str) -> Iterator[bool]:
    """Whether a plugin is not loaded yet; it is from the beginning, since it looks into registries
    itself, unless it fails."""
    is_new = plugin not in _loaded
    _loaded.add(plugin)
    try:
        yield is_new
    except BaseException:
        _loaded.discard(plugin)
        raise


def _import(path: Path, name: str) -> None:
    if not path.is_file():
        raise InputError(f"plugins: there is no file {path}; give the path of a Python file")
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"plugins: {path} is no Python file; name one that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"plugins: {path} fails ({error!r}); correct it or remove it") from error


@contextlib.contextmanager
def temporary() -> Iterator[None]:
    """What is registered and which plugins are loaded inside is taken back at the end."""
    before = [(each, dict(each._items), each._listed_in) for each in _registries]
    loaded = set(_loaded)
    try:
        yield
    finally:
        for registry, items, listed_in in before:
            registry._items, registry._listed_in = items, listed_in
        _loaded.intersection_update(loaded)
