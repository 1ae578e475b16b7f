"""What more than end diastole tells: posteriors of one synthetic heart from more and more channels.

    python benchmarks/what_channels_tell.py docs/channels [folder]

Simulates the quick study's design at three loads with torsion and shortening (half an hour of one
core; kept in `folder`), trains one emulator on all channels, measures the default synthetic heart
with the noise of an MRI several times, and infers the factors from parts of each measured file.
Writes posterior_sd.csv and posterior_sd.png.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.channels import DEFAULT_QUANTITIES, Channels
from regional_lv.measured import read_measured, synthetic_subject, write_measured
from regional_lv.plots import style
from regional_lv.session import Study
from regional_lv.simulation.batches import make_runner

SUBJECT = "synthetic_lateral"
NOISE = {"strain": 0.02, "volume": 2.0, "torsion": 0.025, "shortening": 0.01}
REPEATS = 3
DESIGN = {"natural": 120, "log": 40}
CHANGES = {
    "loading": {"frames": [0.33, 0.67]},
    "observables": {
        "quantities": [*DEFAULT_QUANTITIES, "torsion", "shortening"],
        "places": {"torsion": ["basal-mid", "basal-apical"]},
    },
}
TWISTS = ("torsion", "shortening")
COLOURS = (style.GREY, style.SKY, style.BLUE, style.ORANGE)


def parts(channels: Channels) -> dict[str, list[str]]:
    """What is measured, by name: the channels of each part."""
    late = [c for c in channels if c.load_fraction == 1]
    plain = [c for c in channels if c.quantity not in TWISTS]
    return {
        "end diastole": [c.name for c in late if c.quantity not in TWISTS],
        "end diastole, torsion and shortening": [c.name for c in late],
        "three loads": [c.name for c in plain],
        "three loads, torsion and shortening": list(channels.names),
    }


def infer(study: Study) -> pd.DataFrame:
    """Posterior sd and error of log theta: a row per part, repeat and parameter."""
    emulator = study.train("gradient_gp")
    theta = study.config["synthetic_subjects"][SUBJECT]["theta"]
    truth = study.parameters.vector(theta)
    runner = make_runner(
        study.files.heart().mesh,
        study.physics,
        study.files.predictor(),
        sensitivities=False,
    )
    outputs, rows = runner.run(truth).observables, []
    for repeat in range(REPEATS):
        rng = np.random.default_rng(repeat)
        table = synthetic_subject(
            outputs, study.channels, NOISE, rng.standard_normal(len(study.channels))
        )
        for part, names in parts(study.channels).items():
            file = Path(study.files.measured(f"part-{repeat}"))
            file.parent.mkdir(exist_ok=True)
            write_measured(table[table["output"].isin(names)], file)
            assert len(read_measured(file)) == len(names)
            draws = study.infer(file, emulator, f"part-{repeat}").posterior["value"]
            logs = np.log(
                draws.sel(input=study.parameters.names).to_numpy().reshape(-1, len(truth))
            )
            rows += [
                {"channels": part, "count": len(names), "repeat": repeat, "parameter": name}
                | {"sd": sd, "error": error}
                for name, sd, error in zip(
                    study.parameters.names, logs.std(0), logs.mean(0) - np.log(truth), strict=True
                )
            ]
            print(repeat, part, logs.std(0).round(3), flush=True)
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame, png: Path) -> None:
    """Posterior sd of log theta by parameter, a bar per part, ends of the repeats as whiskers."""
    fig = style.figure(9.0, 3.6)
    ax = fig.subplots()
    groups = list(dict.fromkeys(table["channels"]))
    names = list(dict.fromkeys(table["parameter"]))
    for i, (group, colour) in enumerate(zip(groups, COLOURS, strict=True)):
        mine = table[table["channels"] == group].groupby("parameter", sort=False)["sd"]
        mean, low, high = (getattr(mine, f)().loc[names] for f in ("mean", "min", "max"))
        count = table.loc[table["channels"] == group, "count"].iloc[0]
        at = np.arange(len(names)) + (i - 1.5) * 0.2
        ax.bar(at, mean, 0.18, color=colour, label=f"{group} ({count} channels)")
        ax.vlines(at, low, high, color=style.BLACK, linewidth=0.8)
    ax.set_xticks(range(len(names)), [style.label(name) for name in names], rotation=30, ha="right")
    ax.set_ylabel("posterior sd of log factor")
    ax.legend(loc="upper left", ncols=2)
    ax.set_ylim(0, 1.3 * table["sd"].max())
    style.suptitle(fig, "Synthetic heart: what each set of channels leaves unknown")
    fig.savefig(png, dpi=style.DPI)


@style.context
def main(target: Path, folder: Path) -> None:
    """Simulate what is missing, infer, write."""
    config = study_config.read("config/study.yaml") | CHANGES
    config["study"], config["design"] = "channels", config["design"] | DESIGN
    config["efficiency"] = {"sizes": [60], "most_with_sensitivities": 100}
    study = Study(config, folder)
    if not Path(study.files.screened("train")).is_file():
        study.make_heart()
        study.simulate()
    table = infer(study)
    target.mkdir(parents=True, exist_ok=True)
    means = table.groupby(["channels", "count", "parameter"], sort=False)[["sd", "error"]]
    summary = means.agg(sd=("sd", "mean"), rms_error=("error", lambda e: np.sqrt((e**2).mean())))
    summary.reset_index().to_csv(target / "posterior_sd.csv", index=False, float_format="%.4g")
    draw(table, target / "posterior_sd.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "results/channels"))
