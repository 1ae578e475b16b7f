"""Tables of the emulators: what they are, how they rank, what they learn from."""

import json
from pathlib import Path

import pandas as pd

from regional_lv.emulators import architecture_of, label_of
from regional_lv.tables.writing import written

HOLDOUT_COLUMNS = (
    "param_mse_least_squares",
    "param_mse_weighted",
    "output_mse",
    "predictive_mse",
    "predictive_coverage95",
)
"""Errors of a ranking that are shown for a second test set, too."""


@written
def architectures(fits: list[Path]) -> pd.DataFrame:
    """The paper's Table 1 with what each emulator was fitted with.

    fits: reports of training (JSON). Columns: emulator, base_method, training_scope,
    output_structure, deep_component, input_transform, kernel, simulations (that one fit learns
    from: neighbours, or all of them), inducing.
    """
    rows = []
    for path in fits:
        fit = json.loads(Path(path).read_text())
        settings, kind = fit["settings"], architecture_of(fit["emulator"])
        kernel = fit.get("kernel", settings.get("kernel", "rq" if "alpha" in fit else ""))
        rows.append(
            kind._asdict()
            | {
                "input_transform": settings["input_transform"],
                "kernel": kernel,
                "simulations": settings.get("neighbours", fit["rows"]),
                "inducing": fit.get("inducing", ""),
            }
        )
    return pd.DataFrame(rows).rename(columns={"label": "emulator"})


@written
def ranking(ranking: Path, holdout: Path | None = None) -> pd.DataFrame:
    """The paper's Table S1 and what else the screening measured, of a ranking (CSV).

    holdout: the ranking on what is held out of the training table beside the test set; its errors
    follow as further columns (`..._holdout`).
    """
    columns = {
        "rank": "rank",
        "label": "emulator",
        "input_transform": "input_transform",
        "param_mse_least_squares": "param_mse_least_squares",
        "param_mse_weighted": "param_mse_weighted",
        "outside_weighted": "outside",
        "output_mse": "output_mse",
        "checked_by": "checked_by",
        "predictive_mse": "predictive_mse",
        "predictive_crps": "predictive_crps",
        "predictive_coverage95": "predictive_coverage95",
        "training_seconds": "training_seconds",
        "seconds_per_case_weighted": "seconds_per_case",
        "ms_prediction": "ms_prediction",
        "ms_gradient": "ms_gradient",
        "peak_memory_mb": "peak_memory_mb",
    }
    table = pd.read_csv(ranking)
    shown = table[list(columns)].rename(columns=columns)
    if holdout is not None:
        beside = pd.read_csv(holdout).set_index("emulator").loc[table["emulator"]]
        for name in HOLDOUT_COLUMNS:
            shown[f"{name}_holdout"] = beside[name].to_numpy()
    return shown


@written
def pairs(pairs: Path) -> pd.DataFrame:
    """Wilcoxon-Holm tests of single- against multi-output emulators, by their labels."""
    table = pd.read_csv(pairs)
    for column in ("single", "multi", "better"):
        table[column] = [label_of(name) for name in table[column]]
    return table


@written
def transforms(transforms: Path) -> pd.DataFrame:
    """What the input transform does to each emulator, by its label (`estimates.transforms`)."""
    table = pd.read_csv(transforms)
    table["emulator"] = [label_of(name) for name in table["emulator"]]
    return table


@written
def sample_efficiency(curves: list[Path]) -> pd.DataFrame:
    """Errors against the number of simulations (`paper.estimates.efficiency`), all curves."""
    return pd.concat([pd.read_csv(path) for path in curves], ignore_index=True)
