"""What changes where a segment table describes two surfaces: `data/described_surfaces.csv`.

    python benchmarks/described_surfaces.py FOLDER <heart>_endo.stl ...

Beside each endocardium lies the epicardium, `<heart>_epi.stl` (mm, septum along -z, as in the
hearts of MESA in the Cardiac Atlas Project). These hearts and drawn ones (`verification.shapes`)
are meshed from their surfaces and from the table that describes them, and both are simulated at
stiffnesses of their own, on the mesh of the emulator of any heart; FOLDER keeps that, a file a
heart. Into it goes the table as well, whose columns `regional_lv.hearts.by_surfaces` describes:
differences of outputs as linear functions, by least squares with a ridge. `sd` is of hearts that
are left out, real or drawn ones, whichever is larger.
"""

import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from other_hearts import real_surfaces

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.geometry.described import log_volumes
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.by_surfaces import (
    OF_SHAPE,
    ONE,
    SHARES,
    shape_of,
    stiffness_of,
)
from regional_lv.hearts.reach import by_table
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.layout import HeartFiles
from regional_lv.verification.shapes import shapes

STUDY = Path(__file__).parents[1] / "config" / "heart_emulator.yaml"
FACTORS = 10
RIDGE = 0.03
"""Beside the mean square of each column."""

THINNING, THINNING_DRAWN, DRAWN_OF_A_KIND, SEED = "thin at the base", 24, 2, 3
"""Most of the drawn ventricles have walls that thin at the base, as real ones do."""


def stiffness_of_hearts(number: int) -> np.ndarray:
    """Logarithms (12, 10) of C_a and C_b of the zones in turn: a table says the less of a heart the
    more its zones differ."""
    low, high = np.log(np.tile((0.2, 0.12), 5)), np.log(4.0)
    return np.random.default_rng(100 + number).uniform(low, high, (12, FACTORS))


def stiffness_of_drawn(number: int) -> np.ndarray:
    """The same (6, 10), so that thin and dilated ones converge."""
    low, high = np.log(np.tile((0.25, 0.2), 5)), np.log(3.5)
    return np.random.default_rng(50).uniform(low, high, (number + 1, 6, FACTORS))[-1]


def simulated(surfaces: dict, logs: np.ndarray, study: dict) -> dict[str, np.ndarray]:
    """`log_stiffness` (N, 10), `table` and `surfaces`, the outputs (N, D), and `log_volumes`."""
    own = study | {"geometry": study["geometry"] | {"source": "surfaces", "surfaces": surfaces}}
    found = {"log_stiffness": logs}
    with tempfile.TemporaryDirectory() as folder:
        described = by_table(own, Path(folder) / "segments.csv")
        for name, config in (("surfaces", own), ("table", described)):
            inputs = Inputs.from_config(sections_of(config)).simulated
            heart = Ventricles(make_heart(config, HeartFiles(f"{folder}/{name}/")), inputs)
            found[name] = np.stack([heart.outputs(theta) for theta in np.exp(logs)])
        geometry = described["geometry"]
        apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
        found["log_volumes"] = log_volumes(read_segments(geometry["segments"]), *apices)
    return found


def hearts(endocardia: Sequence[str], folder: Path) -> Iterator[tuple[str, dict, np.ndarray]]:
    """Name, section `geometry.surfaces` and logarithms of the stiffness."""
    for n, endocardium in enumerate(endocardia):
        yield Path(endocardium).stem, real_surfaces(endocardium), stiffness_of_hearts(n)
    drawn = [shape for shape in shapes(DRAWN_OF_A_KIND, SEED) if shape.kind != THINNING]
    drawn += [shape for shape in shapes(THINNING_DRAWN, SEED) if shape.kind == THINNING]
    for n, shape in enumerate(drawn):
        place = folder / f"drawn_{n}"
        place.mkdir(exist_ok=True)
        yield place.name, shape.write(place), stiffness_of_drawn(n)


class Differences:
    """By table and surfaces, of `SHARES` as shares of the former, of the outputs of a quantity and
    level of all hearts.

    by: `ONE` and names of `stiffness_of`. columns: of each heart (n, c), `OF_SHAPE` times each of
    these. changes: (n,).
    """

    def __init__(
        self, found: Sequence[dict], channels: Channels, at: Sequence[int], zones: Mapping
    ):
        self.by = [ONE, *stiffness_of(zones, channels[at[0]].segment)]
        self.columns, self.changes = [], []
        for each in found:
            table, logs = each["table"][:, at], each["log_stiffness"]
            size = table if channels[at[0]].quantity in SHARES else 1.0
            self.changes.append(((table - each["surfaces"][:, at]) / size).T.ravel())
            rows, one = [], np.ones((len(logs), 1))
            for segment in (channels[d].segment for d in at):
                weights = np.array([*stiffness_of(zones, segment).values()])
                by = np.hstack([one, logs @ weights.T])
                rows.append(np.kron(by, shape_of(each["log_volumes"], segment)))
            self.columns.append(np.concatenate(rows))

    def fit(self, hearts: Sequence[int]) -> np.ndarray:
        """Change per unit of each column."""
        columns = np.concatenate([self.columns[h] for h in hearts])
        changes = np.concatenate([self.changes[h] for h in hearts])
        # A column that has nothing keeps nothing.
        ridge = RIDGE * np.square(columns).sum(axis=0) + 1e-9
        return np.linalg.solve(columns.T @ columns + np.diag(ridge), columns.T @ changes)

    def left(self, groups: Sequence[Sequence[int]]) -> float:
        """The largest root mean square of what is left, of groups of hearts, of each one that is
        left out."""
        every = range(len(self.columns))
        squares = [
            np.square(self.changes[h] - self.columns[h] @ self.fit([k for k in every if k != h]))
            for h in every
        ]
        return max(float(np.sqrt(np.mean([squares[h].mean() for h in group]))) for group in groups)


def main(folder: str, *endocardia: str) -> None:
    study = study_config.load(STUDY) | {"inputs": {}}
    channels, place, found = Channels.from_config(study), Path(folder), []
    zones = StiffnessInputs.from_config(study).zones
    place.mkdir(parents=True, exist_ok=True)
    for name, surfaces, logs in hearts(endocardia, place):
        kept = place / f"{name}.npz"
        if not kept.exists():
            np.savez(kept, **simulated(surfaces, logs, study))
        found.append(dict(np.load(kept)))
        print(f"{name}: simulated", flush=True)
    levels: dict[tuple[str, str], list[int]] = {}
    for d, channel in enumerate(channels):
        levels.setdefault((channel.quantity, channel.level), []).append(d)
    real, rows = len(endocardia), []
    for (quantity, level), at in levels.items():
        differences = Differences(found, channels, at, zones)
        fitted = differences.fit(range(len(found))).reshape(len(differences.by), -1)
        sd = differences.left((range(real), range(real, len(found))))
        for by, slopes in zip(differences.by, fitted, strict=True):
            row = {"quantity": quantity, "level": level, "by": by, "sd": sd}
            rows.append(row | dict(zip(OF_SHAPE, slopes, strict=True)))
    table = pd.DataFrame(rows).round(5)
    table.to_csv(place / "described_surfaces.csv", index=False)


if __name__ == "__main__":
    main(*sys.argv[1:])
