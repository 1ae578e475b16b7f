"""What a step depends on, read off the library's source without importing it: files, by import
statements and what a registry imports later (`registry.Lazy`); values, by a function's signature.
"""

import ast
import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from regional_lv.study.manifest import checksum

PACKAGE = "regional_lv"

_LAZY = re.compile(rf"([\"']){PACKAGE}\.([\w.]+):\w+\1")

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
        seen[name] = os.path.relpath(_existing(source, name))
        waiting.extend(_read(source, name).imports)
    return sorted(seen.values())


def required(source: Path, call: str) -> list[str]:
    """Names of the arguments without a default of the function that `call` (<module>:<function>)
    names; source: as of `files`. Raises ValueError for a function that does not exist."""
    module, _, function = call.partition(":")
    functions = _read(source, module).required
    if function not in functions:
        raise ValueError(f"library function {PACKAGE}.{call} does not exist")
    return functions[function]


def digest(files: Iterable[str | Path]) -> str:
    """Sixteen hexadecimal digits that change with the content of any of the files."""
    together = hashlib.sha256()
    for file in files:
        together.update(_checksum(file).encode())
    return together.hexdigest()[:16]


class _Module(NamedTuple):
    imports: set[str]
    required: dict[str, list[str]]


def _file(source: Path, name: str) -> Path | None:
    path = source / PACKAGE / name.replace(".", "/")
    candidates = (path.with_suffix(".py"), path / "__init__.py")
    return next((c for c in candidates if name and c.is_file()), None)


def _existing(source: Path, name: str) -> Path:
    path = _file(source, name)
    if path is None:
        raise ValueError(f"library module {PACKAGE}.{name} does not exist")
    return path


@cache  # most rules share most of the library, and parsing it was half of every dry run
def _read(source: Path, name: str) -> _Module:
    text = _existing(source, name).read_text()
    tree = ast.parse(text)
    found = {later[2] for later in _LAZY.finditer(text)}
    for node in _statements(tree):
        if not isinstance(node, ast.ImportFrom):
            continue
        module = node.module or ""
        if module.split(".")[0] == PACKAGE:
            inside = module.removeprefix(PACKAGE).lstrip(".")
            names = [inside, *(f"{inside}.{alias.name}".lstrip(".") for alias in node.names)]
            found |= {name for name in names if _file(source, name)}
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return _Module(found, {function.name: _required(function.args) for function in functions})


def _required(arguments: ast.arguments) -> list[str]:
    plain = arguments.args[: len(arguments.args) - len(arguments.defaults)]
    named = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    return [argument.arg for argument in plain] + [a.arg for a, default in named if default is None]


def _statements(block: ast.AST) -> Iterator[ast.AST]:
    """All statements in a block, without their expressions: most of a module, and no imports."""
    for field in ("body", "handlers", "cases", "orelse", "finalbody"):
        for statement in getattr(block, field, []):
            yield statement
            yield from _statements(statement)
