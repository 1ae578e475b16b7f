"""What the input transform alone does to an emulator: the same settings, natural and log theta."""

from pathlib import Path

import pandas as pd

from regional_lv import aha
from regional_lv.estimates.ranking import parameter_errors, predictive_scores

TRANSFORMS = ("identity", "log")
QUANTITIES = ("param_mse_least_squares", "param_mse_weighted", "predictive_mse")


def compare_transforms(
    transforms: dict[str, dict[str, str]],
    folder: Path,
    predictions: Path,
    train: Path,
    paper: Path,
    comparison: Path,
) -> None:
    """Compare every emulator with itself on the other input transform; write a table (CSV).

    transforms: by emulator and transform, the name of the folder of its files. folder: with
    `<name>/test.parquet`; predictions: with `<name>/test_predictions.parquet`; train: the screened
    table; paper: the numbers that the paper prints. Columns: emulator, and for each of
    param_mse_least_squares, param_mse_weighted and predictive_mse (outputs in training sd)
    `..._identity`, `..._log` and `..._gain`, the first over the second; paper_param_mse (natural
    inputs, least squares), ratio_to_paper.
    """
    sd = pd.read_parquet(train, columns=list(aha.OUTPUTS)).std()
    printed = pd.read_csv(paper).query("quantity == 'parameter_mse'").set_index("emulator")
    rows = []
    for name, parts in transforms.items():
        row = {"emulator": name}
        for transform, part in parts.items():
            errors = parameter_errors(pd.read_parquet(Path(folder) / part / "test.parquet"))
            scores = predictive_scores(
                pd.read_parquet(Path(predictions) / part / "test_predictions.parquet"), sd
            )
            for quantity in QUANTITIES:
                row[f"{quantity}_{transform}"] = (errors | scores)[quantity]
        for quantity in QUANTITIES:
            row[f"{quantity}_gain"] = row[f"{quantity}_identity"] / row[f"{quantity}_log"]
        rows.append(row)
    table = pd.DataFrame(rows)
    order = [f"{q}_{part}" for q in QUANTITIES for part in (*TRANSFORMS, "gain")]
    table = table[["emulator", *order]]
    table["paper_param_mse"] = table["emulator"].map(printed["value"].astype(float))
    table["ratio_to_paper"] = table["param_mse_least_squares_identity"] / table["paper_param_mse"]
    table.to_csv(comparison, index=False)
