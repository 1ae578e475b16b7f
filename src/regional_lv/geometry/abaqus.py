"""Abaqus input files: what meshio reads, and the element numbers and surfaces it leaves out."""

import re
import tempfile
from pathlib import Path

import meshio
import numpy as np

from regional_lv.errors import InputError

# Corners (meshio's, VTK's order) of the faces S1 ... S6 of an eight-node brick.
FACE_CORNERS = np.array(
    [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
)


def read_abaqus(path):
    """(mesh, numbers, surfaces) of an .inp file of eight-node bricks.

    mesh: meshio's. numbers (m,): the file's element numbers in meshio's order. surfaces: for each
    `*Surface` of whole element sets or single elements, (k, 4) node indices of its facets. Included
    files that are not there, such as fibre directions, are passed over.
    """
    path = Path(path)
    text = path.read_text()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_text(re.sub(r"(?im)^\*include.*$", lambda m: _include(m[0], path), text))
        mesh = meshio.read(copy, file_format="abaqus")
    if len(mesh.cells) != 1 or mesh.cells[0].type != "hexahedron":
        raise InputError(
            f"{path}: holds {', '.join(block.type for block in mesh.cells)}; give one block of "
            "eight-node bricks (C3D8 or a variant of it)"
        )
    blocks = _blocks(text)
    numbers = np.concatenate(
        [
            _integers(lines).reshape(-1, 9)[:, 0]
            for keyword, _, lines in blocks
            if keyword == "element"
        ]
    )
    cells, place = mesh.cells[0].data, {n: i for i, n in enumerate(numbers)}
    surfaces = {}
    for keyword, options, lines in blocks:
        if keyword != "surface" or options.get("type", "element") != "element":
            continue
        facets = [np.zeros((0, 4), dtype=int)]
        for line in lines:
            where, face = (part.strip() for part in line.split(",")[:2])
            members = [place[int(where)]] if where.isdigit() else _members(mesh, where, path)
            facets.append(cells[members][:, FACE_CORNERS[int(face[1]) - 1]])
        surfaces[options["name"]] = np.concatenate(facets)
    return mesh, numbers, surfaces


def _include(line, path):
    """The line with the whole path of the included file, or a comment if there is none."""
    file = path.parent / line.split("=")[-1].strip()
    return f"*INCLUDE,INPUT={file.resolve()}" if file.is_file() else f"** not there: {line}"


def _blocks(text):
    """(keyword, options, lines) of every keyword; keyword, options' keys and type in lower case."""
    blocks = []
    for line in text.splitlines():
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            keyword, *rest = (part.strip() for part in line[1:].split(","))
            options = dict(part.split("=", 1) for part in rest if "=" in part)
            options = {key.strip().lower(): value.strip() for key, value in options.items()}
            if "type" in options:
                options["type"] = options["type"].lower()
            blocks.append((keyword.lower(), options, []))
        elif blocks:
            blocks[-1][2].append(line)
    return blocks


def _integers(lines):
    return np.array([int(n) for line in lines for n in line.split(",") if n.strip()], dtype=int)


def _members(mesh, name, path):
    sets = {key.lower(): value for key, value in mesh.cell_sets.items()}
    if name.lower() not in sets:
        raise InputError(f"{path}: a *Surface names the element set {name}, which is not there")
    return sets[name.lower()][0]
