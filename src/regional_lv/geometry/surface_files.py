"""Files of triangulated surfaces: what VTK's readers make of them.

Readers of VTK do not take every valid variant of their formats. What they are given is a copy with
the same content in the variant that they take.
"""

import re
import struct
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from regional_lv.errors import InputError
from regional_lv.geometry.vtk_triangles import read_triangles
from regional_lv.input_files import check_counts, check_file, reading, without_mark

# Bytes of a binary STL file before its triangles, the last four their number, and of a triangle.
STL_HEADER, STL_TRIANGLE = 84, 50
# Share of the triangles that may be missing: faces without area make none.
LOST = 0.01

PLY_TYPES = {
    **dict.fromkeys(["char", "int8"], "b"),
    **dict.fromkeys(["uchar", "uint8"], "B"),
    **dict.fromkeys(["short", "int16"], "h"),
    **dict.fromkeys(["ushort", "uint16"], "H"),
    **dict.fromkeys(["int", "int32"], "i"),
    **dict.fromkeys(["uint", "uint32"], "I"),
    **dict.fromkeys(["float", "float32"], "f"),
    **dict.fromkeys(["double", "float64"], "d"),
}
"""PLY's names of types and those of `struct`."""
PLY_ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}


def read_surface(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (m, 3) of an STL, PLY, OBJ, VTP or legacy VTK file.

    Text or binary; polygons, strips and six-node faces become triangles. Raises InputError for a
    file that is damaged, of another kind, or without faces.
    """
    path = Path(path)
    check_file(path)
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(
            f"{path}: the format {path.suffix or 'without a suffix'} is not read; save it as "
            ".stl, .ply, .obj, .vtp or .vtk"
        )
    with reading(path, "export the surface again"), tempfile.TemporaryDirectory() as folder:
        check_counts(path)
        copy = Path(folder) / f"surface{kind}"
        copy.write_bytes(KINDS[kind](path, without_mark(path.read_bytes())))
        points, triangles, share = read_triangles(copy)
    if len(triangles) == 0:
        raise InputError(
            f"{path}: holds no triangles, or is no {kind[1:].upper()} file; export the surface "
            "again"
        )
    if np.min(triangles) < 0 or np.max(triangles) >= len(points):
        raise InputError(f"{path}: a triangle has a point that is not there; export it again")
    if share < 1 - LOST:
        raise InputError(
            f"{path}: {100 * (1 - share):.0f} % of its faces cannot be divided into triangles, "
            "because they cross themselves; export it again as triangles"
        )
    return points, triangles


def _stl(path: Path, content: bytes) -> bytes:
    announced = int.from_bytes(content[STL_HEADER - 4 : STL_HEADER], "little")
    held = (len(content) - STL_HEADER) // STL_TRIANGLE
    if held >= announced and held >= 0:
        # What follows the triangles is another program's own.
        return content[: STL_HEADER + announced * STL_TRIANGLE]
    text = content.lower()
    if not text.lstrip().startswith(b"solid") and len(content) >= STL_HEADER:
        raise InputError(
            f"{path}: announces {announced} triangles and holds {held}; it is cut off or damaged: "
            "export it again"
        )
    return text


def _ply(path: Path, content: bytes) -> bytes:
    """Vertices and faces alone, in this order, as VTK expects them."""
    # After a mere \r, the first byte of the data may be that of \n.
    line = rb"\r" if re.match(rb"ply[ \t]*\r(?!\n)", content, re.IGNORECASE) else rb"\r?\n"
    end = re.search(rb"(?<=[\r\n])end_header[ \t]*" + line, content, re.IGNORECASE)
    if not end or content[:3].lower() != b"ply":
        raise InputError(f"{path}: its header is not that of a PLY file; export it again")
    header = content[: end.start()].lower().splitlines()
    lines = [text.decode("latin-1").split() for text in header]
    form = ""
    elements: dict[str, tuple[int, list[list[str]]]] = {}
    for kind, *rest in filter(None, lines):
        if kind == "format":
            form = rest[0]
        elif kind == "element":
            properties = elements.setdefault(rest[0], (int(rest[1]), []))[1]
        elif kind == "property":
            properties.append(rest)
    if form not in PLY_ORDERS:
        raise InputError(
            f"{path}: its format `{form}` is none of {', '.join(PLY_ORDERS)}; export it again"
        )
    order = PLY_ORDERS[form]
    data: Any = content[end.end() :] if order else content[end.end() :].split()
    parts, at = {}, 0
    for name, (count, properties) in elements.items():
        begin = at
        try:
            at = _ply_end(data, begin, count, properties, order)
        except (IndexError, struct.error):
            at = len(data) + 1
        if at > len(data):
            raise InputError(
                f"{path}: ends before the {count} of its element `{name}` do; it is cut off or "
                "damaged: export it again"
            )
        parts[name] = data[begin:at]
    kept, body = [f"ply\nformat {form} 1.0\n"], []
    for name in ("vertex", "face"):
        if name not in parts:
            raise InputError(f"{path}: has no element `{name}`; export the surface as triangles")
        count, properties = elements[name]
        kept.append(f"element {name} {count}\n")
        for *words, key in properties:
            # Of coordinates that are integers in text, VTK makes others.
            words = ["double"] if order is None and words[0] != "list" else words
            kept.append(" ".join(["property", *words, key]) + "\n")
        body.append(parts[name] if order else b"\n".join([*parts[name], b""]))
    return "".join([*kept, "end_header\n"]).encode("latin-1") + b"".join(body)


def _ply_end(
    data: Any,
    at: int,
    count: int,
    properties: Sequence[Sequence[str]],
    order: str | None,
) -> int:
    """Where `count` rows of an element end that begin at `at`: in words of text (`order` None), or
    in bytes."""

    def size(kind: str) -> int:
        return struct.calcsize(order + PLY_TYPES[kind]) if order else 1

    if all(words[0] != "list" for words in properties):
        return at + count * sum(size(words[0]) for words in properties)
    for _ in range(count):
        for kind, *rest in properties:
            if kind != "list":
                at += size(kind)
                continue
            counts, items = rest[:2]
            if order:
                n = struct.unpack_from(order + PLY_TYPES[counts], data, at)[0]
            else:
                n = int(data[at])
            if n < 0:
                raise IndexError(f"a list of {n} items")
            at += size(counts) + n * size(items)
    return at


def _obj(path: Path, content: bytes) -> bytes:
    return content.lower()


def _vtp(path: Path, content: bytes) -> bytes:
    return content


def _vtk(path: Path, content: bytes) -> bytes:
    """Its first line is compared letter by letter."""
    return re.sub(rb"\A\s*# vtk datafile version", b"# vtk DataFile Version", content, flags=re.I)


KINDS = {".obj": _obj, ".ply": _ply, ".stl": _stl, ".vtk": _vtk, ".vtp": _vtp}
"""By the ending of a file, what makes the variant of its bytes that VTK reads."""
