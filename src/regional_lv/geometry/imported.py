"""A hexahedral mesh from elsewhere: read, checked, and given the surfaces and the coordinates.

Every mistake that would show later only as a simulation that fails is an InputError here, with the
element's number.
"""

from collections.abc import Mapping
from pathlib import Path

import meshio
import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from regional_lv.errors import InputError
from regional_lv.geometry.abaqus import read_abaqus
from regional_lv.geometry.coordinates import longitudinal_coordinate, transmural_coordinate
from regional_lv.geometry.elements import exterior_faces
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, Mesh
from regional_lv.geometry.segment_tags import (
    check_segment_places,
    check_segment_tags,
    name_elements,
    read_segment_tags,
)
from regional_lv.geometry.summary import scaled_jacobians
from regional_lv.input_files import check_counts, reading

MM_PER = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
UNIT_NAMES = {"mm": "millimetres", "cm": "centimetres", "m": "metres"}
# Lengths (mm), base to epicardial apex, that a human left ventricle can have.
PLAUSIBLE_LENGTH_MM = (30.0, 200.0)
# The base is flat and at z = 0 to this share of the ventricle's length; then it is put there.
FLATNESS = 1e-3
# How the names of these surfaces begin in a mesh file.
STARTS = {ENDOCARDIUM: "endo", EPICARDIUM: "epi", BASE: "base"}
# Scaled Jacobians from here down are those of elements without volume.
DEGENERATE = 1e-6


def import_mesh(
    mesh_path: str | Path, segments_path: str | Path | None = None, unit: str = "mm"
) -> Mesh:
    """Linear `Mesh` from a file of eight-node hexahedra that meshio reads.

    mesh_path: Abaqus .inp, .vtu, .msh, ...; base in the plane z = 0, apex below, the long axis
    through the cavity. segments_path: CSV (`element`, `aha_segment`) or the paper's .mat file;
    None if the mesh has cell data `segment`. unit: of the mesh's coordinates (a key of `MM_PER`).
    Raises InputError that names file, elements and remedy.
    """
    points, cells, numbers, segment, named = _read(Path(mesh_path))
    points = points * MM_PER[unit]
    _check_length(mesh_path, points, unit)
    if segments_path is not None:
        segment = read_segment_tags(segments_path, numbers)
    elif segment is None:
        raise InputError(
            f"{mesh_path}: has no cell data `segment`; add it, or name a table of elements in "
            "geometry.imported.segments"
        )
    origin = segments_path or mesh_path
    check_segment_tags(segment, numbers, origin)
    facets, _ = exterior_faces(cells)
    none = np.zeros(0)
    mesh = Mesh(points, cells, np.asarray(segment, dtype=np.int32), facets, none, none, none)
    _check_elements(mesh_path, mesh, numbers)
    mesh.surface = (
        _named_surfaces(mesh_path, mesh, named) if named else _find_surfaces(mesh_path, mesh)
    )
    _check_axis(mesh_path, mesh)
    check_segment_places(mesh, origin)
    points[mesh.nodes_on(BASE), 2] = 0.0
    endo, epi = mesh.nodes_on(ENDOCARDIUM), mesh.nodes_on(EPICARDIUM)
    mesh.transmural = transmural_coordinate(mesh, endo, epi)
    apices = (points[nodes, 2].min() for nodes in (endo, epi))
    mesh.longitudinal = longitudinal_coordinate(points, mesh.transmural, *apices)
    return mesh


def _read(
    path: Path,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None, dict[int, np.ndarray]]:
    """(points, cells, element numbers, segment or None, facets by surface) of a mesh file."""
    named = {}
    with reading(path, "give geometry.imported.file a mesh, saved as .vtu or Abaqus .inp"):
        check_counts(path)
        if path.suffix.lower() == ".inp":
            raw, numbers, surfaces = read_abaqus(path, list(STARTS.values()))
            named = _three_surfaces(surfaces)
        else:
            raw, numbers = meshio.read(path), None
        return _hexahedra(path, raw, numbers, named)


def _hexahedra(
    path: Path, raw: meshio.Mesh, numbers: np.ndarray | None, named: Mapping[int, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None, dict[int, np.ndarray]]:
    """What `_read` returns, of meshio's mesh."""
    solid = [i for i, block in enumerate(raw.cells) if block.type == "hexahedron"]
    other = {block.type for block in raw.cells if block.dim == 3} - {"hexahedron"}
    if other or not solid:
        raise InputError(
            f"{path}: holds {', '.join(sorted(other)) or 'no volume'}; a mesh of eight-node "
            "hexahedra alone can be imported"
        )
    cells = np.concatenate([raw.cells[i].data for i in solid]).astype(np.int64)
    if not np.isfinite(raw.points).all() or raw.points.shape[1] != 3:
        raise InputError(f"{path}: its points are not three numbers each; export it again")
    if cells.min() < 0 or cells.max() >= len(raw.points):
        raise InputError(f"{path}: an element has a node that is not there; export it again")
    segment = None
    if "segment" in raw.cell_data:
        segment = np.concatenate([raw.cell_data["segment"][i] for i in solid]).ravel()
        if len(segment) != len(cells):
            raise InputError(
                f"{path}: cell data `segment` has {len(segment)} numbers for {len(cells)} "
                "elements; give each its AHA segment"
            )
    if numbers is None:
        numbers = np.arange(1, len(cells) + 1)
    # Nodes that no hexahedron has, such as a fibre's reference point, are left out.
    used, cells = np.unique(cells, return_inverse=True)
    new = np.full(len(raw.points), -1)
    new[used] = np.arange(len(used))
    named = {surface: new[facets] for surface, facets in named.items()}
    return raw.points[used], cells.reshape(-1, 8), numbers, segment, named


def _three_surfaces(surfaces: Mapping[str, np.ndarray]) -> dict[int, np.ndarray]:
    """Facets of endocardium, epicardium and base by the first letters of their names, or none."""
    found = {}
    for number, start in STARTS.items():
        mine = [facets for key, facets in surfaces.items() if key.lower().startswith(start)]
        if len(mine) != 1:
            return {}
        found[number] = mine[0]
    return found


def units_that_fit(length_mm: float, unit: str) -> list[str]:
    """Units in which a ventricle that has this length when read in `unit` has a possible one."""
    low, high = PLAUSIBLE_LENGTH_MM
    return [u for u, mm in MM_PER.items() if low <= length_mm / MM_PER[unit] * mm <= high]


def _check_length(path: str | Path, points: np.ndarray, unit: str) -> None:
    length = np.ptp(points[:, 2])
    low, high = PLAUSIBLE_LENGTH_MM
    if low <= length <= high:
        return
    fitting = units_that_fit(length, unit)
    if fitting:
        raise InputError(
            f"{path}: the ventricle is {length:g} mm long; the mesh looks like one in "
            f"{UNIT_NAMES[fitting[0]]}, set geometry.imported.unit to {fitting[0]}"
        )
    raise InputError(
        f"{path}: the ventricle is {length:g} mm long; between {low:g} and {high:g} are possible, "
        "its long axis being the z axis; correct its points"
    )


def _check_elements(path: str | Path, mesh: Mesh, numbers: np.ndarray) -> None:
    with np.errstate(invalid="ignore"):
        quality = scaled_jacobians(mesh)
    worst = np.where(np.isfinite(quality), quality, 0.0).min(axis=1)
    inverted, flat = worst < -DEGENERATE, np.abs(worst) <= DEGENERATE
    if inverted.all():
        raise InputError(
            f"{path}: every element is inside out; list the nodes of one face and then of the "
            "opposite one, as Abaqus and VTK do"
        )
    for wrong, what in ((inverted, "inverted"), (flat, "degenerate (without volume at a corner)")):
        if wrong.any():
            raise InputError(
                f"{path}: {name_elements(numbers[wrong])} {what}; correct the mesh or the order of "
                "their nodes"
            )


def _find_surfaces(path: str | Path, mesh: Mesh) -> np.ndarray:
    """Surface (k,) of the exterior facets: flat top, then inner and outer by connectivity."""
    z = mesh.points[:, 2]
    height = z[mesh.facets]
    base = (height > z.max() - FLATNESS * np.ptp(z)).all(axis=1)
    rest = mesh.facets[~base]
    rows, columns = rest[:, [0, 1, 2, 3]].ravel(), rest[:, [1, 2, 3, 0]].ravel()
    n = len(mesh.points)
    graph = sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    part = connected_components(graph, directed=False)[1][rest[:, 0]]
    parts = np.unique(part)
    if not base.any() or len(parts) != 2:
        raise InputError(
            f"{path}: without its top, the exterior falls into {len(parts)} pieces instead of "
            "endocardium and epicardium; the base must be flat, the wall closed at the apex, and "
            "neighbouring elements must share their nodes"
        )
    size = [np.prod(np.ptp(mesh.points[rest[part == p]].reshape(-1, 3), axis=0)) for p in parts]
    surface = np.full(len(mesh.facets), BASE, dtype=np.int32)
    surface[~base] = np.where(part == parts[np.argmin(size)], ENDOCARDIUM, EPICARDIUM)
    return surface


def _named_surfaces(path: str | Path, mesh: Mesh, named: Mapping[int, np.ndarray]) -> np.ndarray:
    """Surface (k,) of the exterior facets from the facets that the mesh file names."""
    number = {tuple(row): s for s, facets in named.items() for row in np.sort(facets, axis=1)}
    found = [number.get(tuple(row), 0) for row in np.sort(mesh.facets, axis=1)]
    surface = np.array(found, dtype=np.int32)
    if (surface == 0).any() or len(number) != len(surface):
        raise InputError(
            f"{path}: its surfaces of endocardium, epicardium and base name {len(number)} facets, "
            f"{(surface > 0).sum()} of the exterior's {len(surface)}; correct them, or take them "
            "out so that they are found by shape"
        )
    return surface


def _check_axis(path: str | Path, mesh: Mesh) -> None:
    """The base in the plane z = 0, and the z axis inside the cavity."""
    length = np.ptp(mesh.points[:, 2])
    base = mesh.points[mesh.nodes_on(BASE)]
    off = base[np.abs(base[:, 2]).argmax(), 2]
    if abs(off) > FLATNESS * length or mesh.points[:, 2].max() > FLATNESS * length:
        raise InputError(
            f"{path}: a node of the base is at z = {off:g} mm; the base must be the plane z = 0 "
            "with the apex below: turn and move the mesh"
        )
    rim = mesh.nodes_on(ENDOCARDIUM)
    if not surrounds_axis(mesh.points[rim[mesh.points[rim, 2] > -FLATNESS * length]]):
        raise InputError(
            f"{path}: the z axis does not run through the cavity; move the mesh so that the long "
            "axis is x = y = 0"
        )


def surrounds_axis(rim: np.ndarray) -> bool:
    """Whether points (n, 3) lie all around the z axis, without a gap of a quarter turn."""
    angle = np.sort(np.arctan2(rim[:, 1], rim[:, 0]))
    return bool(np.diff(angle, append=angle[0] + 2 * np.pi).max() <= np.pi / 2)
