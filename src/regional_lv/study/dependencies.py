"""Which files of the library a step depends on, read off their import statements, and off what a
registry imports later (`registry.Later`)."""

import ast
import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from regional_lv.study.manifest import checksum

PACKAGE = "regional_lv"

_LATER = re.compile(rf"([\"']){PACKAGE}\.([\w.]+):\w+\1")

_checksum = cache(checksum)  # most rules share most files


def files(source: Path, modules: Iterable[str], without: Iterable[str] = ()) -> list[str]:
    """Files of `modules` (dotted names below the package) and of all that they import.

    source: the folder that holds the package. Modules named in `without` are left out, with what
    only they import. Paths are relative to the working directory. Raises ValueError for a module
    that does not exist.
    """
    waiting, seen = list(modules), {}
    while waiting:
        name = waiting.pop()
        if name in seen or name in without:
            continue
        path = _file(source, name)
        if path is None:
            raise ValueError(f"library module {PACKAGE}.{name} does not exist")
        seen[name] = os.path.relpath(path)
        waiting.extend(_imports(source, path))
    return sorted(seen.values())


def digest(files: Iterable[str | Path]) -> str:
    """Sixteen hexadecimal digits that change with the content of any of the files."""
    together = hashlib.sha256()
    for file in files:
        together.update(_checksum(file).encode())
    return together.hexdigest()[:16]


def _file(source: Path, name: str) -> Path | None:
    path = source / PACKAGE / name.replace(".", "/")
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((c for c in candidates if name and c.is_file()), None)


@cache  # most rules share most of the library, and parsing it was half of every dry run
def _imports(source: Path, path: Path) -> set[str]:
    text = path.read_text()
    found = {later[2] for later in _LATER.finditer(text)}
    for node in _statements(ast.parse(text)):
        if not isinstance(node, ast.ImportFrom):
            continue
        module = node.module or ""
        if module.split(".")[0] == PACKAGE:
            inside = module.removeprefix(PACKAGE).lstrip(".")
            names = [inside, *(f"{inside}.{alias.name}".lstrip(".") for alias in node.names)]
            found |= {name for name in names if _file(source, name)}
    return found


def _statements(block: ast.AST) -> Iterator[ast.AST]:
    """All statements in a block, without their expressions: most of a module, and no imports."""
    for field in ("body", "handlers", "cases", "orelse", "finalbody"):
        for statement in getattr(block, field, []):
            yield statement
            yield from _statements(statement)
