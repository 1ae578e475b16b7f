"""Abaqus input files of eight-node bricks: nodes, elements with their numbers, and surfaces.

meshio's reader takes one block of nodes and one spelling of each keyword, and leaves out element
numbers and surfaces.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import meshio
import numpy as np

from regional_lv.errors import InputError
from regional_lv.geometry.elements import exterior_faces
from regional_lv.input_files import check_file, without_mark

# Corners (meshio's, VTK's order) of the faces S1 ... S6 of an eight-node brick.
FACE_CORNERS = np.array(
    [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
)
FACES = ("S1", "S2", "S3", "S4", "S5", "S6")
BRICK = "c3d8"
# Keywords at which numbers of nodes begin anew: an assembly has some of its own beside its parts'.
SCOPES = {"part", "end part", "assembly", "instance", "end instance", "end assembly"}


class Block(NamedTuple):
    """A keyword and its options, in lower case but for the options' values, and its data lines,
    each split at the commas."""

    keyword: str
    options: dict
    rows: list


def read_abaqus(
    path: str | Path, starts: Sequence[str] = ("",)
) -> tuple[meshio.Mesh, np.ndarray, dict[str, np.ndarray]]:
    """(mesh, numbers, surfaces) of an .inp file of eight-node bricks.

    mesh: meshio's, with one block of cells. numbers (m,): the file's numbers of these elements.
    surfaces: for each `*Surface` whose name starts with one of `starts`, in any case, (k, 4) node
    indices of its facets: faces of element sets or of single elements, or those that are free.
    Nodes and elements may be in several blocks. Included files that are not there, such as fibre
    directions, are passed over.

    Raises InputError for other elements, for what is named and not there, for a row of a surface
    that names no face of a brick, and for an instance that is moved in the assembly.
    """
    path = Path(path)
    blocks = _blocks(path)
    for block in blocks:
        if block.keyword == "instance" and any(_float(x) for row in block.rows for x in row):
            raise InputError(
                f"{path}: moves the instance {block.options.get('name', '')} in the assembly; "
                "write the file without parts and assemblies, so that its nodes are where they "
                "belong"
            )
    points: list[list[float]] = []
    nodes: dict[int, dict[int, int]] = defaultdict(dict)
    for scope, block in _scopes(blocks, "node"):
        for number, *place in block.rows:
            nodes[scope][int(number)] = len(points)
            points.append([_float(x) for x in [*place, "", "", ""][:3]])
    cells, numbers = [], []
    sets: dict[str, list[int | str]] = defaultdict(list)
    for scope, block in _scopes(blocks, "element"):
        kind = block.options.get("type", "")
        if not kind.lower().startswith(BRICK):
            raise InputError(
                f"{path}: holds elements of type {kind or 'unknown'}; leave eight-node bricks "
                "alone (C3D8 or a variant of it)"
            )
        rows = np.array(_integers(block.rows), dtype=int).reshape(-1, 9)
        absent = set(rows[:, 1:].ravel()) - nodes[scope].keys()
        if absent:
            raise InputError(
                f"{path}: an element has the node {min(absent)}, which is not there; export the "
                "mesh again"
            )
        cells += [[nodes[scope][node] for node in row] for row in rows[:, 1:]]
        numbers += rows[:, 0].tolist()
        sets[block.options.get("elset", "").lower()] += rows[:, 0].tolist()
    place = {number: i for i, number in enumerate(numbers)}
    if not cells or len(place) < len(cells):
        says = "two elements have the same number" if cells else "holds no elements"
        raise InputError(f"{path}: {says}; give one part of eight-node bricks (C3D8)")
    for block in blocks:
        if block.keyword == "elset":
            sets[block.options.get("elset", "").lower()] += _listed(block)
    corners, surfaces = np.array(cells), {}
    skin, owner = exterior_faces(corners)
    for block in blocks:
        name = block.options.get("name", "")
        if block.keyword != "surface" or not name.lower().startswith(tuple(starts)):
            continue
        if block.options.get("type", "element").lower() != "element":
            continue
        facets = [np.zeros((0, 4), dtype=int)]
        for where, *faces in block.rows:
            members = _members(sets, where, path)
            absent = set(members) - place.keys()
            face = faces[0].upper() if faces else ""
            if absent or face not in ("", *FACES):
                says = (
                    f"has no element {min(absent)}" if absent else f"{face} is no face of a brick"
                )
                raise InputError(
                    f"{path}: *Surface {name}, row {', '.join([where, *faces])!r}: {says}; name "
                    "an element or a set of them, and its face, S1 to S6, or none for all that "
                    "are free"
                )
            at = [place[number] for number in members]
            if face:
                facets.append(corners[at][:, FACE_CORNERS[FACES.index(face)]])
            else:
                facets.append(skin[np.isin(owner, at)])
        surfaces[name] = np.concatenate(facets)
    return meshio.Mesh(points, [("hexahedron", corners)]), np.array(numbers), surfaces


def _blocks(path: Path) -> list[Block]:
    """The blocks of a file and of those that it includes, in their order."""
    check_file(path)
    blocks, header = [], ""
    # Split as bytes: in text of an 8-bit encoding, Python takes more than ends of lines for these.
    for raw in without_mark(path.read_bytes()).splitlines():
        line = raw.decode("latin-1").strip()
        if line.startswith("**") or not line:
            continue
        if line.startswith("*") or header:
            # A comma at the end of a keyword's line says that it goes on in the next.
            header += line
            if line.endswith(","):
                continue
            block, header = _block(header), ""
            file = block.options.get("input")
            if file is None:
                blocks.append(block)
            elif block.keyword == "include":
                blocks += _blocks(path.parent / file) if (path.parent / file).is_file() else []
            elif block.keyword in ("node", "element", "elset"):
                blocks.append(block._replace(rows=_data(path.parent / file)))
        elif blocks:
            blocks[-1].rows.append(_split(line))
    return blocks


def _block(header: str) -> Block:
    keyword, *rest = _split(header[1:])
    options = dict(part.partition("=")[::2] for part in rest)
    values = {key.strip().lower(): value.strip(' "') for key, value in options.items()}
    return Block(keyword.lower(), values, [])


def _data(path: Path) -> list[list[str]]:
    """Rows of a file that holds the data of one block."""
    content = without_mark(check_file(path).read_bytes())
    lines = [line.decode("latin-1").strip() for line in content.splitlines()]
    return [_split(line) for line in lines if line and not line.startswith("*")]


def _split(line: str) -> list[str]:
    return [part.strip() for part in line.split(",")]


def _scopes(blocks: Iterable[Block], keyword: str) -> Iterator[tuple[int, Block]]:
    """(scope, block) of every block with this keyword; the scope is what its numbers belong to."""
    scope = 0
    for block in blocks:
        scope += block.keyword in SCOPES
        if block.keyword == keyword:
            yield scope, block


def _float(text: str) -> float:
    """A number as Fortran writes it; nothing is 0."""
    return float(text.lower().replace("d", "e") or 0)


def _integers(rows: Iterable[Sequence[str]]) -> list[int]:
    return [int(text) for row in rows for text in row if text]


def _listed(block: Block) -> list[int | str]:
    """Numbers of elements and names of sets that a block `*Elset` lists."""
    if "generate" not in block.options:
        return [int(text) if text.isdigit() else text for row in block.rows for text in row if text]
    bounds = (_integers([row]) for row in block.rows)
    return [n for first, last, *step in bounds for n in range(first, last + 1, *step)]


def _members(sets: Mapping[str, Sequence[int | str]], name: int | str, path: Path) -> list[int]:
    """Numbers of the elements of a set, or of one element; names may begin with an instance's."""
    name = str(name).rpartition(".")[2].strip('"').lower()
    if name.isdigit():
        return [int(name)]
    if name not in sets:
        raise InputError(
            f"{path}: a *Surface names the element set {name}, which is not there; add it"
        )
    return [number for member in sets[name] for number in _members(sets, member, path)]
