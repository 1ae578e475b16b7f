"""What several effects do to each other: simulated, and as the criticism's emulators have it.

    python benchmarks/effects_at_once.py <configuration> [hearts]

Of a study with extensions (`snakemake --configfile <configuration> -- extensions`), from the folder
that holds its results. Random hearts with two or three of its effects are simulated on the mesh of
the extensions: with all effects, with each alone, without any. What all together do beyond the sum
of each is what they do to each other. It is compared with nothing, which is what effects side by
side would do, and with `ExtendedEmulator`, in sds of a good measurement's noise (0.01, 1 mL).
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import config as study_config
from regional_lv.criticism.discretisation import load_emulator
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.hypotheses import NoiseHypothesis
from regional_lv.criticism.injection import Ventricles, random_subjects, read_effects
from regional_lv.criticism.observations import noise_units
from regional_lv.parameters import Parameterisation
from regional_lv.physics import physics_of


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main(configuration: str, hearts: int) -> None:
    config = study_config.load(configuration)
    physics, results = physics_of(config), Path("results") / config["study"]
    name = study_config.final_emulator(config)
    emulator = load_emulator(results / "emulators" / f"{name}.pt")
    known = read_extensions(sorted((results / "criticism" / "extensions").glob("*.pt")))
    changing = [e for e in known if not isinstance(e.hypothesis, NoiseHypothesis)]
    by_place = {(e.hypothesis.name, e.component): e for e in changing}
    unit = noise_units(emulator.channels, emulator.output_sd.numpy())

    def emulated(theta, effects):
        extensions = [by_place[e.hypothesis.name, e.component] for e in effects]
        scaled = [e.hypothesis.scale(e.value) for e in effects]
        both = ExtendedEmulator(emulator, extensions)
        at = torch.as_tensor(theta), torch.tensor(scaled, dtype=torch.float64)
        return both.mean(*(part[None] for part in at))[0].numpy()

    own = results / "geometry" / "extensions" / "mesh.vtu"
    ventricles = Ventricles(own if own.exists() else results / "geometry" / "mesh.vtu", physics)
    hypotheses = {e.hypothesis.name: e.hypothesis for e in changing}
    kinds = {"pairs": hearts - hearts // 4, "triples": hearts // 4}
    rows = []
    for entry in random_subjects(kinds, 1, hypotheses, Parameterisation.from_config(config)):
        theta, effects = np.array([*entry["theta"].values()]), read_effects(entry["effects"])
        subsets = [[], effects, *([e] for e in effects)]
        try:
            simulated = [ventricles.outputs(theta, subset) for subset in subsets]
        except ArithmeticError as error:
            print(f"left out: {error}")
            continue
        beyond = []
        for none, everything, *alone in (simulated, [emulated(theta, s) for s in subsets]):
            beyond.append((everything - none - sum(one - none for one in alone)) / unit)
        what = " + ".join(
            f"{e.hypothesis.name} {f'{e.component} ' if e.component else ''}{e.value:.3g}"
            for e in effects
        )
        rows.append({"effects": what, "side by side": rms(beyond[0])})
        rows[-1]["on top of each other"] = rms(beyond[0] - beyond[1])
        print(
            pd.DataFrame(rows[-1:]).to_csv(index=False, header=len(rows) == 1), end="", flush=True
        )
    table = pd.DataFrame(rows).set_index("effects")
    summary = {"median": table.median(), "rms": table.apply(rms), "largest": table.max()}
    print(f"{len(table)} hearts")
    print(pd.DataFrame(summary).round(2).to_string())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 48)
