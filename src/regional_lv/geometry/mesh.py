"""The mesh as the project passes it on, and its file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from regional_lv.errors import InputError

ENDOCARDIUM, EPICARDIUM, BASE = 1, 2, 3
# meshio's names of cells and facets by the number of a cell's nodes.
KINDS = {27: ("hexahedron27", "quad9"), 8: ("hexahedron", "quad")}
SURFACES = {ENDOCARDIUM: "endocardium", EPICARDIUM: "epicardium", BASE: "base"}


@dataclass
class Mesh:
    """Hexahedral mesh of the wall, quadratic or linear.

    points (n, 3) mm; cells (m, 27) node numbers in VTK's triquadratic order, or (m, 8) corners;
    segment (m,) AHA number 1-17; facets (k, 9) in VTK's biquadratic order, or (k, 4); surface (k,)
    1 endocardium, 2 epicardium, 3 base; transmural (n,) 0 endocardium to 1 epicardium;
    longitudinal (n,) 0 apex to 1 base.
    """

    points: np.ndarray
    cells: np.ndarray
    segment: np.ndarray
    facets: np.ndarray
    surface: np.ndarray
    transmural: np.ndarray
    longitudinal: np.ndarray

    def nodes_on(self, *surfaces: int) -> np.ndarray:
        """Sorted numbers of the nodes that lie on all of these surfaces."""
        on_each = (np.unique(self.facets[self.surface == s]) for s in surfaces)
        return reduce(np.intersect1d, on_each)


def read_mesh(vtu_path: str | Path) -> Mesh:
    """Read a mesh that `write_mesh` wrote (.vtu)."""
    import meshio  # here: the configuration is checked without it

    raw = meshio.read(vtu_path)
    kinds = [block.type for block in raw.cells]
    pair = next((pair for pair in KINDS.values() if sorted(kinds) == list(pair)), None)
    if pair is None:
        raise InputError(
            f"{vtu_path}: holds {sorted(set(kinds))}; expected one block of hexahedron27 and one "
            "of quad9 (or of hexahedron and quad), as the geometry's rules write them"
        )
    solid, skin = (kinds.index(kind) for kind in pair)
    return Mesh(
        points=raw.points,
        cells=raw.cells[solid].data.astype(np.int64),
        segment=raw.cell_data["segment"][solid],
        facets=raw.cells[skin].data.astype(np.int64),
        surface=raw.cell_data["surface"][skin],
        transmural=raw.point_data["transmural"],
        longitudinal=raw.point_data["longitudinal"],
    )


def write_mesh(
    mesh: Mesh,
    vtu_path: str | Path,
    point_data: Mapping[str, np.ndarray],
    cell_data: Mapping[str, np.ndarray] | None = None,
    zones: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Write a Mesh as one .vtu for ParaView.

    `point_data` adds fields of shape (n,) or (n, 3), `cell_data` values (m,) of the hexahedra,
    which are NaN on the facets. `zones`, AHA segments by name, adds the field `zone`, numbered from
    1 in their order.
    """

    import meshio

    solid, skin = len(mesh.cells), len(mesh.facets)
    none = [np.zeros(k, dtype=np.int32) for k in (solid, skin)]
    meshio.Mesh(
        mesh.points,
        list(zip(KINDS[mesh.cells.shape[1]], (mesh.cells, mesh.facets), strict=True)),
        point_data={
            "transmural": mesh.transmural,
            "longitudinal": mesh.longitudinal,
            **point_data,
        },
        cell_data={
            "segment": [mesh.segment.astype(np.int32), none[1]],
            **({"zone": [_zone_numbers(mesh.segment, zones), none[1]]} if zones else {}),
            "surface": [none[0], mesh.surface.astype(np.int32)],
            **{name: [values, np.full(skin, np.nan)] for name, values in (cell_data or {}).items()},
        },
    ).write(vtu_path)


def _zone_numbers(segment: np.ndarray, zones: Mapping[str, Sequence[int]]) -> np.ndarray:
    number = {s: k for k, segments in enumerate(zones.values(), start=1) for s in segments}
    return np.array([number[s] for s in segment.tolist()], dtype=np.int32)
