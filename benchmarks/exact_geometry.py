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

import pandas as pd
from hidden_hearts import hearts_of, results_of

from regional_lv.hidden_effects.blind import reduced


def held(stiffness: list[dict], which: str, values: dict[str, float]) -> int:
    """Of the factors."""
    ends = [(values[one["name"]], *one[which]["interval95"]) for one in stiffness]
    return sum(low <= value <= high for value, low, high in ends)


def main(path: str) -> None:
    _, results = results_of(path)
    answers: dict[str, dict] = {}
    for file in sorted((results / "hidden_effects" / "findings").glob("*.json")):
        answers |= json.loads(file.read_text())
    rows = []
    for critic, truth, values in hearts_of(path):
        if truth["group"] != "misread" or critic.name not in answers:
            continue
        inputs = critic.inputs
        measured = [inputs.names[k] for k in inputs.of_role("measured").nonzero()[0]]
        critic.inputs = inputs.fixing(measured)
        found = reduced(critic.conclude([], has_simulator=False).findings)
        for way, content in (("measured", answers[critic.name]), ("exact", found)):
            named = [*content["named"], *map("|".join, content["groups"])]
            rows.append(
                {
                    "heart": critic.name,
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
