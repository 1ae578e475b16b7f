"""Hearts whose segment table was misread, criticised with and without that in mind.

    python benchmarks/exact_geometry.py CONFIG

CONFIG: of the benchmark of hidden effects (`config/hidden_effects.yaml`); run it where its
`results` lie. Every thickness of these hearts is wrong by 10 % and every radius by 3 % (sd). The
benchmark has these figures as measured inputs; here they count as exact. Of each heart: what is
named, the p-value of the model as it is, and how many factors the 95 % intervals hold, averaged and
of the model as it is. No simulation confirms.
"""

import json
import sys
from pathlib import Path

import pandas as pd

from regional_lv import config as study_config
from regional_lv.criticism.benchmark import fixed, measured_of, reduced
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import Critic, Settings
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.inputs.space import sections_of


def held(stiffness: list[dict], which: str, values: dict[str, float]) -> int:
    """Of the factors."""
    ends = [(values[one["name"]], *one[which]["interval95"]) for one in stiffness]
    return sum(low <= value <= high for value, low, high in ends)


def main(path: str) -> None:
    config = study_config.load(study_config.read(path), path, [str(Path(path).parent)])
    physics, results = sections_of(config), Path("results") / config["study"]
    settings = settings_of(config) | {"bootstrap": config["criticism"]["benchmark"]["bootstrap"]}
    emulator = JointGP.load(results / "all_inputs" / "finer" / "emulator.pt")
    rows = []
    for file in sorted((results / "hidden_effects" / "findings").glob("*.json")):
        table = results / "{}" / file.with_suffix(".parquet").name
        subjects, truth = (
            pd.read_parquet(str(table).format(folder)).set_index("subject", drop=False)
            for folder in ("hidden_effects/subjects", "truth/hidden_effects")
        )
        measured = json.loads(file.read_text())
        for name in truth.index[truth["group"] == "misread"]:
            given, seed = Settings.from_config(settings), config["seed"]
            tables = {name: measured_of(subjects.loc[name])}
            critic = Critic(name, tables, emulator, physics, given, seed)
            inputs = critic.inputs
            left = subjects.loc[name, "left_out"].split()
            exact = [*left, *(inputs.names[k] for k in inputs.of_role("measured").nonzero()[0])]
            critic.inputs = fixed(inputs, exact)
            found = reduced(critic.conclude([], has_simulator=False).findings)
            values = json.loads(truth.loc[name, "values"])
            for way, content in (("measured", measured[name]), ("exact", found)):
                named = [*content["named"], *map("|".join, content["groups"])]
                rows.append(
                    {
                        "heart": name,
                        "geometry": way,
                        "named": " ".join(named),
                        "p_value": content["misfit_p_value"],
                        "averaged": held(content["stiffness"], "averaged", values),
                        "as_it_is": held(content["stiffness"], "as_it_is", values),
                    }
                )
            print(pd.DataFrame(rows[-2:]).to_string(index=False, header=False), flush=True)
    found = pd.DataFrame(rows)
    print(found.groupby("geometry")[["averaged", "as_it_is"]].agg(["sum", "size"]))
    print((found["named"] != "").groupby(found["geometry"]).sum())


if __name__ == "__main__":
    main(*sys.argv[1:])
