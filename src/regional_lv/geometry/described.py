"""A ventricle between two smooth surfaces, described by a segment table.

The table's figures are means over segments (`surfaces`); the smoothest surfaces through them are
not those that they were read off, so that a described ventricle is another one. By how much tell
the volumes of wall and cavity in the quarters of each segment.
"""

import json
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from regional_lv.aha import SEGMENTS
from regional_lv.geometry.fitted import FittedSurfaces, aha_sectors, sector_table
from regional_lv.geometry.imported import import_mesh
from regional_lv.geometry.surfaces import QUARTER, Surfaces, Wall
from regional_lv.geometry.table import check_segments
from regional_lv.geometry.triangulated import read_configured
from regional_lv.geometry.ventricle import SIDES
from regional_lv.geometry.wall_lines import LEVEL_ENDS

ANGLES, LATITUDES = 12, 8
"""Places of a segment at which its figures are taken."""

ALONG = np.linspace(0, QUARTER, 400)
"""Latitudes of the wall's lines at which a meridian of a surface is known."""

THICKEST = 0.8
"""Of a wall, as a share of the cavity's length."""

HALVES = ("upper_wall", "lower_wall", "upper_cavity", "lower_cavity")
"""Of segments, of equal ranges of latitude: between the surfaces themselves, and between the
endocardium and the long axis."""

VOLUME_COLUMNS = tuple(f"{half}_{side}_ml" for half in HALVES for side in ("first", "second"))
"""Columns of a described table: volumes of the `HALVES` in the first and in the second half of the
segment's range of angles."""

FILES = ("endocardium", "epicardium", "file", "segments")
"""Keys of a section that name files of surfaces or of a mesh."""

UNSNAPPED = 720
"""Mesh lines around the axis, between which no borders of sectors are joined."""

Side = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Points (n, 3) of a surface at angles and latitudes of its lines (n,)."""


class TableOfHeart(NamedTuple):
    """A segment table, as `table.read_segments` reads it, and the apices that go with it. Of a mesh
    and of surfaces it has `VOLUME_COLUMNS`, too."""

    table: pd.DataFrame
    endo_apex_z_mm: float
    epi_apex_z_mm: float


def describe_surfaces(endocardium: Side, epicardium: Side, sectors: pd.DataFrame) -> TableOfHeart:
    """The wall between two surfaces.

    sectors: aha_segment, angle_from_deg, angle_to_deg, z_top_mm and z_bottom_mm (17 rows).
    """
    pole = np.zeros(1), np.full(1, QUARTER)
    inner, outer = (-float(side(*pole)[0, 2]) for side in (endocardium, epicardium))
    places = [_places(row, inner) for row in sectors.itertuples()]
    phi, u = (np.concatenate(each) for each in zip(*places, strict=True))
    radius = Meridians(endocardium, phi).radius(-inner * np.sin(u))
    around = Meridians(epicardium, phi)
    # The lines along which the table's thickness lies depend on its mean: once more with that.
    mean = outer - inner
    for _ in range(3):
        tilt = (outer - inner) / mean * np.sin(u)
        length = np.hypot(np.cos(u), tilt)
        cosine, sine = np.cos(u) / length, tilt / length
        low, high = np.zeros(len(u)), np.full(len(u), THICKEST * inner)
        for _ in range(30):
            middle = (low + high) / 2
            z = -inner * np.sin(u) - middle * sine
            within = (radius + middle * cosine < around.radius(z)) & (z > -outer)
            low, high = np.where(within, middle, low), np.where(within, high, middle)
        thickness = low.reshape(len(SEGMENTS), -1).mean(axis=1)
        mean = thickness.mean()
    table = sectors.assign(
        name=[segment.name for segment in SEGMENTS],
        wall_thickness_mm=thickness,
        endo_radius_mm=radius.reshape(len(SEGMENTS), -1).mean(axis=1),
    )
    table.loc[table.index[-1], "z_bottom_mm"] = -outer
    return TableOfHeart(table, -inner, -outer)


def _places(row: Any, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles and latitudes (n,) spread evenly over a segment."""
    ends = np.arcsin(np.clip(-np.array([row.z_top_mm, row.z_bottom_mm]) / length, 0, 1))
    at = (np.arange(LATITUDES) + 0.5) / LATITUDES
    around = (np.arange(ANGLES) + 0.5) / ANGLES
    low, high = np.radians([row.angle_from_deg, row.angle_to_deg])
    phi, u = np.meshgrid(low + (high - low) * around, ends[0] + (ends[1] - ends[0]) * at)
    return phi.ravel(), u.ravel()


class Meridians:
    """Curves of a surface in half planes at the angles phi (n,)."""

    def __init__(self, side: Side, phi: np.ndarray) -> None:
        angles, self._of = np.unique(phi, return_inverse=True)
        points = side(np.repeat(angles, len(ALONG)), np.tile(ALONG, len(angles)))
        x, y, z = points.reshape(len(angles), len(ALONG), 3).transpose(2, 0, 1)[:, :, ::-1]
        self._radius, self._height = np.hypot(x, y), z

    def radius(self, z: np.ndarray) -> np.ndarray:
        """Distance (n,) from the axis at heights; below the apex 0, above the rim as there."""
        found = np.empty(len(z))
        for k, (height, radius) in enumerate(zip(self._height, self._radius, strict=True)):
            at = self._of == k
            found[at] = np.interp(z[at], height, radius)
        return found


def part_volumes_ml(wall: Wall, sectors: pd.DataFrame) -> np.ndarray:
    """Volumes (17, 8) in mL, as `VOLUME_COLUMNS`. sectors: as of `describe_surfaces`."""
    turns = np.radians(sectors[["angle_from_deg", "angle_to_deg"]].to_numpy(float))
    heights = sectors[["z_top_mm", "z_bottom_mm"]].to_numpy(float)
    rings = 1 - np.arcsin(np.clip(heights / wall.endo_apex, 0, 1)) / QUARTER
    phi, rho = (
        ends[:, :1] + np.diff(ends) * np.linspace(0, 1, count + 1)
        for ends, count in ((turns, ANGLES), (rings, LATITUDES))
    )
    grid = np.broadcast_arrays(phi[:, :, None, None], rho[:, None, :, None], [0.0, 1.0])
    around, down, through = (each.ravel() for each in grid)
    points = wall.wall(around, down, through, rings[-1, 0]).reshape(*grid[0].shape, 3)
    inner = points[:, :, :, :1]
    cavity = np.concatenate([inner * (0, 0, 1), inner], axis=3)
    # Around the axis, chords cut something off.
    step = np.diff(turns) / ANGLES
    volumes = []
    for cells in map(_hexahedra, (points, cavity)):
        parts = cells.reshape(len(cells), 2, ANGLES // 2, 2, LATITUDES // 2).sum(axis=(2, 4))
        volumes.append(parts.swapaxes(1, 2).reshape(len(cells), -1) * step / np.sin(step))
    return np.hstack(volumes) / 1e3


def _hexahedra(points: np.ndarray) -> np.ndarray:
    """Volumes (n, a, b) of small ones between points (n, a + 1, b + 1, 2, 3)."""
    edges = []
    for along in (1, 2, 3):
        edge = np.diff(points, axis=along)
        for across in {1, 2, 3} - {along}:
            edge = _between(edge, across)
        edges.append(edge[:, :, :, 0])
    a, b, c = edges
    return np.abs((a * np.cross(b, c)).sum(axis=-1))


def _between(values: np.ndarray, axis: int) -> np.ndarray:
    """Means of neighbours."""
    many = values.shape[axis]
    return (values.take(range(1, many), axis) + values.take(range(many - 1), axis)) / 2


def log_volumes(table: pd.DataFrame, endo_apex_z_mm: float, epi_apex_z_mm: float) -> np.ndarray:
    """How the volumes between the surfaces that a table describes differ from those between the
    smooth surfaces through its figures, (17, 8). Columns 0-3: log(given / smooth) of each of the
    `HALVES`. Columns 4-7: the same of its second half of angles minus that of the first. 0 where
    the table does not tell (`VOLUME_COLUMNS`)."""
    if not {*VOLUME_COLUMNS} <= {*table}:
        return np.zeros((len(table), 2 * len(HALVES)))
    smooth = part_volumes_ml(Surfaces(table, endo_apex_z_mm, epi_apex_z_mm), table)
    found = (table[list(VOLUME_COLUMNS)].to_numpy(float), smooth)
    its, theirs = (each.reshape(len(table), len(HALVES), 2) for each in found)
    growth = np.diff(np.log(its / theirs))[..., 0]
    return np.hstack([np.log(its.sum(axis=2) / theirs.sum(axis=2)), growth])


def section_by_table(geometry: Mapping, table: str | Path) -> dict:
    """Section `geometry` of a configuration with a segment table in place of surfaces or a mesh;
    the table (CSV) is written. Raises InputError as `table_of_heart`."""
    found = table_of_heart(geometry)
    Path(table).parent.mkdir(parents=True, exist_ok=True)
    found.table.to_csv(table, index=False)
    return {
        **geometry,
        "source": "segments",
        "segments": str(table),
        "endo_apex_z_mm": found.endo_apex_z_mm,
        "epi_apex_z_mm": found.epi_apex_z_mm,
    }


def table_of_heart(geometry: Mapping) -> TableOfHeart:
    """Of a heart from surfaces or a mesh, the section `geometry` of a configuration. Raises
    InputError for files that cannot be used, and for a segment that no left ventricle can have."""
    source = {"surfaces": "surfaces", "mesh": "imported"}[geometry["source"]]
    given = geometry[source]
    states = [Path(given[key]).stat() for key in FILES if Path(given.get(key) or "").is_file()]
    as_they_are = tuple((state.st_mtime_ns, state.st_size) for state in states)
    return _cached(source, json.dumps(given), as_they_are)


@lru_cache(maxsize=4)
def _cached(source: str, given: str, _as_they_are: tuple) -> TableOfHeart:
    """Kept while the files are as they were: inputs of one study are made several times."""
    section = json.loads(given)
    found = {"surfaces": of_surfaces, "imported": of_mesh}[source](section)
    rows = found.table.set_axis([f"segment {segment.number}" for segment in SEGMENTS])
    files = ", ".join(section[key] for key in FILES if section.get(key))
    return found._replace(table=check_segments(rows, files).reset_index(drop=True))


def of_mesh(imported: Mapping) -> TableOfHeart:
    """Of a mesh from elsewhere, `geometry.imported` of a configuration: its own segments."""
    mesh = import_mesh(imported["file"], imported["segments"], imported["unit"])
    surfaces = FittedSurfaces.of_mesh(mesh)
    return _with_volumes(surfaces, sector_table(mesh, surfaces, UNSNAPPED))


def of_surfaces(surfaces: Mapping) -> TableOfHeart:
    """Of two files of triangles, `geometry.surfaces` of a configuration: the AHA's segments."""
    heart = read_configured(surfaces["endocardium"], surfaces["epicardium"], surfaces)
    inner, outer = (heart.smooth[side] for side in SIDES)
    fitted = FittedSurfaces.of_lines(inner, outer, LEVEL_ENDS)
    return _with_volumes(fitted, aha_sectors(fitted))


def _with_volumes(surfaces: FittedSurfaces, sectors: pd.DataFrame) -> TableOfHeart:
    inner, outer = surfaces.sides
    found = describe_surfaces(inner, outer, sectors)
    volumes = dict(zip(VOLUME_COLUMNS, part_volumes_ml(surfaces, found.table).T, strict=True))
    return found._replace(table=found.table.assign(**volumes))
