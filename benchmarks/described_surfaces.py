"""What changes where a segment table describes two surfaces: `data/described_surfaces.csv`.

    python benchmarks/described_surfaces.py described_surfaces.csv <heart>_endo.stl ...

Beside each endocardium lies the epicardium, `<heart>_epi.stl` (mm, septum along -z, as in the
hearts of MESA in the Cardiac Atlas Project). Each heart is meshed from its surfaces and from the
table that describes them, and both are simulated at eight stiffnesses, on the mesh of the emulator
of any heart. `shift`: mean of the outputs by the table less those by the surfaces; `sd`: root mean
square of what a heart, left out of the mean, differs from it; of `hearts.sectors.SHARES`, shares of
the former.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.geometry.from_config import make_heart
from regional_lv.hearts.reach import by_table
from regional_lv.hearts.sectors import SHARES
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.layout import HeartFiles

STUDY = Path(__file__).parents[1] / "config" / "heart_emulator.yaml"
SEPTUM = (0, 0, -1)
STIFFNESSES = 8
LOWEST, HIGHEST = (0.25, 0.15), 4.0
"""Of C_a and C_b, each zone's own: a table says the less of a heart the more its zones differ."""


def stiffnesses() -> np.ndarray:
    """(STIFFNESSES, 10): C_a and C_b of the zones in turn, uniform in the logarithm."""
    low, high = np.log(np.tile(LOWEST, 5)), np.log(HIGHEST)
    return np.exp(np.random.default_rng(1).uniform(low, high, (STIFFNESSES, 10)))


def changes(endocardium: str, study: dict, channels: Channels) -> np.ndarray:
    """Outputs (STIFFNESSES, D) of a heart by the table less those by its surfaces, of `SHARES` as
    shares of the former."""
    surfaces = {
        "endocardium": endocardium,
        "epicardium": endocardium.replace("_endo", "_epi"),
        "septum": SEPTUM,
        "unit": "mm",
    }
    own = study | {"geometry": study["geometry"] | {"source": "surfaces", "surfaces": surfaces}}
    with tempfile.TemporaryDirectory() as folder:
        outputs = []
        for name, config in (("own", own), ("table", by_table(own, Path(folder) / "segments.csv"))):
            inputs = Inputs.from_config(sections_of(config)).simulated
            heart = Ventricles(make_heart(config, HeartFiles(f"{folder}/{name}/")), inputs)
            outputs.append(np.stack([heart.outputs(theta) for theta in stiffnesses()]))
    shares = np.array([channel.quantity in SHARES for channel in channels])
    return (outputs[1] - outputs[0]) / np.where(shares, outputs[1], 1.0)


def main(table: str, *endocardia: str) -> None:
    study = study_config.load(STUDY) | {"inputs": {}}
    channels = Channels.from_config(study)
    found = []
    for endocardium in endocardia:
        found.append(changes(endocardium, study, channels))
        print(f"{endocardium}: volume {100 * found[-1][:, 0].mean():+.2f} %", flush=True)
    found = np.stack(found)  # (hearts, STIFFNESSES, D)
    others = (found.sum(axis=0) - found).mean(axis=1, keepdims=True) / (len(found) - 1)
    rows = {
        "quantity": [channel.quantity for channel in channels],
        "segment": pd.array([channel.segment for channel in channels], dtype="Int64"),
        "shift": found.mean((0, 1)),
        "sd": np.sqrt(np.square(found - others).mean((0, 1))),
    }
    pd.DataFrame(rows).round(4).to_csv(table, index=False)


if __name__ == "__main__":
    main(*sys.argv[1:])
