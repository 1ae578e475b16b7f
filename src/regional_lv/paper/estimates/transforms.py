"""What the input transform alone does to an emulator: the same settings, natural and log theta."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from regional_lv.channels import Channels
from regional_lv.paper.estimates.ranking import parameter_errors, predictive_scores

TRANSFORMS = ("identity", "log")
QUANTITIES = ("param_mse_least_squares", "param_mse_weighted", "predictive_mse")


def compare_transforms(
    transforms: dict[str, dict[str, str]],
    files: Sequence[str],
    estimates: Sequence[Path],
    predictions: Sequence[Path],
    channels: Channels,
    train: Path,
    comparison: Path,
) -> None:
    """Compare every emulator with itself on the other input transform; write a table (CSV).

    transforms: by emulator and transform, the name of its files. files: all these names, in the
    order of their `estimates` and `predictions` of the test set. train: the screened table.
    Columns: emulator, and for each of param_mse_least_squares, param_mse_weighted and
    predictive_mse (outputs in training sd) `..._identity`, `..._log` and `..._gain`, the first over
    the second.
    """
    sd = pd.read_parquet(train, columns=list(channels.names)).std()
    paths = dict(zip(files, zip(estimates, predictions, strict=True), strict=True))
    rows = []
    for name, parts in transforms.items():
        row: dict[str, float] = {}
        for transform, part in parts.items():
            estimated, predicted = (pd.read_parquet(path) for path in paths[part])
            errors, scores = parameter_errors(estimated), predictive_scores(predicted, sd)
            for quantity in QUANTITIES:
                row[f"{quantity}_{transform}"] = (errors | scores)[quantity]
        for quantity in QUANTITIES:
            row[f"{quantity}_gain"] = row[f"{quantity}_identity"] / row[f"{quantity}_log"]
        rows.append({"emulator": name, **row})
    order = [f"{q}_{part}" for q in QUANTITIES for part in (*TRANSFORMS, "gain")]
    pd.DataFrame(rows)[["emulator", *order]].to_csv(comparison, index=False)
