"""Left ventricles of many shapes as two surfaces of triangles, to try the mesher with.

Each is a half ellipsoid with smooth waves, an apex off its axis, a wall of varying thickness and a
base that is cut obliquely, in a frame that is turned and shifted like a scanner's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial.transform import Rotation

from regional_lv.geometry.triangles import enclosed_volume
from regional_lv.geometry.ventricle import SIDES


@dataclass(frozen=True)
class Kind:
    """Ranges from which a group's ventricles are drawn.

    cavity_ml; slenderness, length over radius at the base; thickness_mm, of the wall at mid level;
    tilt_deg, between the base's normal and the long axis; apex, distance of the apex from the
    ellipsoid's axis over the radius; waves, standard deviation of the amplitude over the radius of
    each of the surface's waves; scar_mm, the wall's thickness in a scar of a sixth of the
    circumference, if any; thinning, share of its thickness that the wall loses at the base, if any.
    """

    cavity_ml: tuple[float, float] = (50, 150)
    slenderness: tuple[float, float] = (2.2, 3.6)
    thickness_mm: tuple[float, float] = (7, 11)
    tilt_deg: tuple[float, float] = (0, 10)
    apex: float = 0.25
    waves: float = 0.04
    scar_mm: tuple[float, float] | None = None
    thinning: tuple[float, float] | None = None


KINDS = {
    "ordinary": Kind(),
    "oblique base": Kind(tilt_deg=(15, 25)),
    "infarcted": Kind(cavity_ml=(80, 250), slenderness=(1.8, 2.8), scar_mm=(3, 5)),
    "dilated": Kind(cavity_ml=(200, 400), slenderness=(1.3, 2.4), thickness_mm=(5, 9)),
    "hypertrophied": Kind(cavity_ml=(40, 110), thickness_mm=(14, 22)),
    "small": Kind(cavity_ml=(20, 40), thickness_mm=(4, 9)),
    "uneven": Kind(apex=0.45, waves=0.07, tilt_deg=(0, 25)),
    "thin": Kind(cavity_ml=(60, 250), thickness_mm=(3, 4)),
    "thin at the base": Kind((40, 200), (1.8, 3.4), (6, 18), (0, 20), thinning=(0.2, 0.7)),
}


@dataclass(frozen=True)
class Shape:
    """A ventricle: its surfaces (mm), open in the base plane, and the direction of its septum."""

    kind: str
    endocardium: pyvista.PolyData
    epicardium: pyvista.PolyData
    septum: list[float]

    def write(self, folder: Path) -> dict:
        """Both as STL; the section `geometry.surfaces` that reads them."""
        section: dict = {"unit": "mm", "base": None, "insertions": None, "septum": self.septum}
        for side in SIDES:
            section[side] = str(folder / f"{side}.stl")
            getattr(self, side).save(section[side])
        return section


def shapes(count: int, seed: int = 0) -> Iterator[Shape]:
    """`count` ventricles of each of the `KINDS`, one of each after the other."""
    for index in range(count):
        for number, (name, kind) in enumerate(KINDS.items()):
            yield _draw(name, kind, np.random.default_rng([seed, number, index]))


def _draw(name: str, kind: Kind, rng: np.random.Generator) -> Shape:
    slender, thickness = rng.uniform(*kind.slenderness), rng.uniform(*kind.thickness_mm)
    tilt, around = np.radians(rng.uniform(*kind.tilt_deg)), rng.uniform(0, 2 * np.pi)
    phi, u = _grid()
    # With a radius of 1, until the cavity has its volume.
    wave = _waves(phi, u, kind.waves, rng)
    off = kind.apex * rng.uniform(0, 1) * np.array([np.cos(around), np.sin(around)])
    place = np.stack([np.cos(u) * np.cos(phi), np.cos(u) * np.sin(phi), -slender * np.sin(u)], -1)
    place[..., :2] *= (1 + wave)[..., None]
    place[..., :2] += np.sin(np.maximum(u, 0))[..., None] ** 2 * off
    apex = np.array([*off, -slender])
    # The base's normal is tilted in any direction from the line to the apex.
    axis = -apex / np.linalg.norm(apex)
    beside = np.cross(axis, [np.cos(rng.uniform(0, 6)), 1, 0])
    normal = np.cos(tilt) * axis + np.sin(tilt) * beside / np.linalg.norm(beside)
    cavity = _cut(place, normal)
    scale = (rng.uniform(*kind.cavity_ml) / enclosed_volume(cavity)) ** (1 / 3)
    place *= scale
    outwards = np.stack(
        [np.cos(u) * np.cos(phi), np.cos(u) * np.sin(phi), -np.sin(u) / slender], axis=-1
    )
    outwards /= np.linalg.norm(outwards, axis=-1)[..., None]
    wall = thickness * (1 + _waves(phi, u, 0.06, rng)) * (1 - 0.35 * np.maximum(np.sin(u), 0) ** 4)
    if kind.scar_mm is not None:
        middle, level = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 1.2)
        away = ((np.cos(phi - middle) - 1) / 0.25 - ((u - level) / 0.4) ** 2) / 2
        wall += (rng.uniform(*kind.scar_mm) - wall) * np.exp(away)
    if kind.thinning is not None:
        near = np.exp(-((np.maximum(u, 0) / rng.uniform(0.15, 0.4)) ** 2))
        wall *= 1 - rng.uniform(*kind.thinning) * near
    turn, shift = Rotation.random(random_state=rng), rng.uniform(-100, 100, 3)
    endocardium, epicardium = _cut(place, normal), _cut(place + wall[..., None] * outwards, normal)
    for surface in (endocardium, epicardium):
        surface.points = turn.apply(surface.points) + shift
    return Shape(name, endocardium, epicardium, turn.apply([1.0, 0.0, 0.0]).tolist())


def _grid(around: int = 72, along: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Angles and latitudes (along, around), from above the base to near the apex."""
    u = np.linspace(-0.75, np.pi / 2, along + 1)[:-1]
    phi, u = np.meshgrid(2 * np.pi * np.arange(around) / around, u)
    return phi, u


def _waves(phi, u, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """Waves of up to six around and six along, the shorter ones lower; smooth in the pole."""
    total = np.zeros_like(phi)
    for m in range(7):
        for n in range(1, 7):
            size, first, second = rng.normal(), *rng.uniform(0, 2 * np.pi, 2)
            wave = np.cos(m * phi + first) * np.cos(u) ** m * np.cos(2 * n * np.sin(u) + second)
            total += size / max(1, (m * m + n * n) / 4) * wave
    return amplitude * total


def _cut(points: np.ndarray, normal: np.ndarray) -> pyvista.PolyData:
    """The surface through a grid of points (along, around, 3) and the pole, below the plane through
    the origin with this normal."""
    along, around = points.shape[:2]
    pole = points[-1].mean(axis=0) + (points[-1] - points[-2]).mean(axis=0) / 2
    at = np.arange(along * around).reshape(along, around)
    ahead = np.roll(at, -1, axis=1)
    faces = [
        np.stack([at[:-1], at[1:], ahead[:-1]], -1),
        np.stack([ahead[:-1], at[1:], ahead[1:]], -1),
    ]
    faces.append(np.stack([at[-1:], np.full((1, around), at.size), ahead[-1:]], -1))
    triangles = np.concatenate([face.reshape(-1, 3) for face in faces])
    whole = pyvista.PolyData.from_regular_faces(
        np.concatenate([points.reshape(-1, 3), pole[None]]), triangles
    )
    return whole.clip(normal, origin=(0.0, 0.0, 0.0)).triangulate()
