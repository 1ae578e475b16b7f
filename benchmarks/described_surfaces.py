"""What changes where a segment table describes two surfaces: `data/described_surfaces.csv`.

    python benchmarks/described_surfaces.py FOLDER <heart>_endo.stl ...

Beside each endocardium lies the epicardium, `<heart>_epi.stl` (mm, septum along -z, as in the
hearts of MESA in the Cardiac Atlas Project). Each heart is meshed from its surfaces and from the
table that describes them, and both are simulated at twelve stiffnesses of its own, on the mesh of
the emulator of any heart; FOLDER keeps that, a file a heart. Into it goes the table as well, whose
columns `regional_lv.hearts.by_surfaces` describes: differences of outputs as linear functions of
the segment's wall and of the stiffness, by least squares. `sd` is of hearts left out.
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.geometry.described import log_walls
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.by_surfaces import SHARES
from regional_lv.hearts.reach import by_table
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.layout import HeartFiles

STUDY = Path(__file__).parents[1] / "config" / "heart_emulator.yaml"
SEPTUM = (0, 0, -1)
STIFFNESSES, SEED = 12, 100
LOWEST, HIGHEST = (0.2, 0.12), 4.0
"""Of C_a and C_b, each zone's own: a table says the less of a heart the more its zones differ."""

RIDGE = 0.1
"""Beside the mean square of a logarithm, for slopes about it."""

APEX = LEVELS["apex"]


def simulated(endocardium: str, study: dict, seed: int) -> dict[str, np.ndarray]:
    """`log_stiffness` (N, 10), `table` and `surfaces`, the outputs (N, D), and `log_walls`."""
    low, high = np.log(np.tile(LOWEST, 5)), np.log(HIGHEST)
    logs = np.random.default_rng(seed).uniform(low, high, (STIFFNESSES, 10))
    surfaces = {
        "endocardium": endocardium,
        "epicardium": endocardium.replace("_endo", "_epi"),
        "septum": SEPTUM,
        "unit": "mm",
    }
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
        found["log_walls"] = log_walls(read_segments(geometry["segments"]), *apices)
    return found


class Hearts:
    """Differences (H, N, D) by table and surfaces, of `SHARES` as shares of the former."""

    def __init__(self, found: Sequence[dict[str, np.ndarray]], channels: Channels):
        self.channels = channels
        self.logs, table, surfaces, self.walls = (
            np.stack([each[name] for each in found])
            for name in ("log_stiffness", "table", "surfaces", "log_walls")
        )
        shares = np.array([channel.quantity in SHARES for channel in channels])
        self.changes = (table - surfaces) / np.where(shares, table, 1.0)
        self.groups: dict[tuple, list[int]] = {}
        for d, channel in enumerate(channels):
            level = [name for name, at in LEVELS.items() if channel.segment in at]
            self.groups.setdefault((channel.quantity, *level), []).append(d)

    def wall(self, hearts: Sequence[int], segment: int | None) -> np.ndarray:
        """Of each simulation (H N,); none of the whole, and of the tip, whose wall ends alike."""
        none = segment is None or segment in APEX
        of_hearts = np.zeros(len(hearts)) if none else self.walls[hearts, segment - 1]
        return np.repeat(of_hearts, self.logs.shape[1])

    def fit(self, hearts: Sequence[int]) -> np.ndarray:
        """Shift, its slope about the wall and those about logarithms of stiffness (D, 12), of some
        of the hearts; the slope about the wall is one of a quantity and level."""
        found = np.zeros((len(self.channels), 2 + self.logs.shape[2]))
        logs = self.logs[hearts].reshape(-1, self.logs.shape[2])
        for group in self.groups.values():
            each = np.eye(len(group))
            walls = [self.wall(hearts, self.channels[d].segment) for d in group]
            design = np.hstack(
                [
                    np.kron(each, np.ones((len(logs), 1))),
                    np.concatenate(walls)[:, None],
                    np.kron(each, logs),
                ]
            )
            penalty = np.full(design.shape[1], RIDGE * len(logs))
            penalty[: len(group) + 1] = 1e-9
            changes = self.changes[hearts][..., group].reshape(-1, len(group)).T.ravel()
            solved = np.linalg.solve(design.T @ design + np.diag(penalty), design.T @ changes)
            found[group, 0], found[group, 1] = solved[: len(group)], solved[len(group)]
            found[group, 2:] = solved[len(group) + 1 :].reshape(len(group), -1)
        return found

    def expected(self, fitted: np.ndarray, heart: int) -> np.ndarray:
        """Differences (N, D)."""
        walls = np.stack([self.wall([heart], channel.segment) for channel in self.channels], axis=1)
        return fitted[:, 0] + fitted[:, 1] * walls + self.logs[heart] @ fitted[:, 2:].T

    def left(self) -> np.ndarray:
        """Root mean squares (D,) of what is left of hearts left out."""
        every = range(len(self.changes))
        residuals = [
            self.changes[h] - self.expected(self.fit([k for k in every if k != h]), h)
            for h in every
        ]
        return np.sqrt(np.square(residuals).mean(axis=(0, 1)))


def main(folder: str, *endocardia: str) -> None:
    study = study_config.load(STUDY) | {"inputs": {}}
    channels, names = Channels.from_config(study), Inputs.from_config(sections_of(study)).names
    place, found = Path(folder), []
    place.mkdir(parents=True, exist_ok=True)
    for n, endocardium in enumerate(endocardia):
        kept = place / f"{Path(endocardium).stem}.npz"
        if not kept.exists():
            np.savez(kept, **simulated(endocardium, study, SEED + n))
        found.append(dict(np.load(kept)))
        print(f"{endocardium}: simulated", flush=True)
    hearts = Hearts(found, channels)
    fitted = hearts.fit(range(len(found)))
    rows = {
        "quantity": [channel.quantity for channel in channels],
        "segment": pd.array([channel.segment for channel in channels], dtype="Int64"),
        **dict(zip(("shift", "by_wall", *names), fitted.T, strict=True)),
        "sd": hearts.left(),
    }
    pd.DataFrame(rows).round(4).to_csv(place / "described_surfaces.csv", index=False)


if __name__ == "__main__":
    main(*sys.argv[1:])
