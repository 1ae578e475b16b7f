"""Strain curves of the heart that make_surfaces.py made: curves.csv (synthetic).

    python config/examples/surfaces/make_curves.py

The heart is inflated by the simulator, on a finer mesh than the study's, with a septum that is
twice as stiff as the rest. Its strains are written as strain software exports them: one curve per
segment and direction over the frames of a heartbeat, engineering strain in percent, zero at end
diastole. In systole the wall moves on beyond its unloaded state; in frame UNLOADED it is back in
it. The volume at end diastole, which config.yaml needs, is printed.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.geometry.mesh_config import finer
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.quantities import seth_hill
from regional_lv.session import Study
from regional_lv.simulation.subjects import simulate_subject

FOLDER = Path(__file__).parent
THETA = dict.fromkeys(StiffnessInputs().names, 1.0) | {"C_a_septal": 2.0}
NOISE = {"strain": 0.01, "volume": 1.0}
SEED = 1
# Logarithm of the stretch since end diastole, as a share of that of the unloaded heart, at some
# frames: end diastole, end systole, relaxation, the unloaded heart, filling and rest.
FRAMES, UNLOADED = 30, 14
SHARES = {1: 0.0, 10: 1.15, 13: 1.12, UNLOADED: 1.0, 20: 0.35, 25: 0.25, FRAMES: 0.0}


def measure(folder):
    """The heart's measured table: strains between end diastole and the unloaded state."""
    given = study_config.read(FOLDER / "config.yaml")
    # Its subject is what is made here.
    config = {key: given[key] for key in ("study", "geometry", "loading")} | {
        "synthetic_subjects": {"heart": {"theta": THETA, "noise": NOISE}},
        "subjects": {"heart": {"source": "synthetic"}},
    }
    config = study_config.load(config, folders=[FOLDER])
    study = Study(config | {"mesh": finer(config["mesh"])}, folder)
    heart = config["synthetic_subjects"]["heart"]
    files = folder / "measured.csv", folder / "truth.json"
    simulate_subject("heart", heart, study.make_heart(), study.physics, SEED, *files)
    return pd.read_csv(files[0], comment="#")


def curves_of(table):
    """Curves (percent) over the frames, of a measured table with strains alone."""
    names = table["quantity"] + "_" + table["segment"].astype(int).map("{:02d}".format)
    stretch = seth_hill.stretch(table["value"].to_numpy(), 2)
    frames = np.arange(1, FRAMES + 1)
    shares = np.interp(frames, [*SHARES], [*SHARES.values()])
    curves = pd.DataFrame(100 * (stretch ** shares[:, None] - 1), columns=names)
    curves.insert(0, "frame", frames)
    return curves.round(3)


def main():
    with tempfile.TemporaryDirectory() as folder:
        table = measure(Path(folder))
    of_volume = table["quantity"] == "volume"
    with open(FOLDER / "curves.csv", "w") as file:
        file.write("# synthetic: simulated, with noise; made by make_curves.py\n")
        curves_of(table[~of_volume]).to_csv(file, index=False)
    volume = table.loc[of_volume, "value"].item()
    print(f"volume at end diastole: {volume:.1f} mL, with an sd of {NOISE['volume']:g}")


if __name__ == "__main__":
    main()
