"""The numbers that the paper prints, this study's beside them, and why they differ.

Two files written by hand beside this one: `numbers.csv` (facts read off the paper: place,
quantity, emulator, set, parameter, statistic, relation, value, unit) and `differences.csv`
(quantity, emulator, set, parameter, reason; an empty field fits everything). Everything else is
collected from the study's own files as rows (quantity, emulator, set, parameter, statistic, value).

The emulator `final` is the one that the study chose; the paper's choice was MVGP, so that its
numbers for MVGP stand against both. `shortlist` is the extreme over the shortlisted emulators.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.emulators.reduction import VOLUME
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.tables import VOLUME_SHARE
from regional_lv.paper import KEYS
from regional_lv.paper.page import QUANTITIES, write_page
from regional_lv.paper.posteriors.files import by_emulator, chosen
from regional_lv.typed_tables import require_columns

COLUMNS = ("place", *KEYS, "relation", "value", "unit")
PAPERS_CHOICE = "mvgp"
PARAMETERS = StiffnessInputs()
"""The paper's: a study with other zones or factors is not compared."""

FACTOR = 1.5
"""Ratio, either way, beyond which a difference needs a reason; unless DIFFERENCE names it."""

DIFFERENCE = {
    "rhat": 0.01,
    "split_rhat": 0.01,
    "coverage95": 3.0,
    "zone_correlation": 0.1,
    "pairs_rejected": 0,
}
"""Quantities whose ratio says little: the absolute difference beyond which they need a reason."""

HEADING = """# Paper against this study

Every number that the paper prints as a result, and this study's. The paper chose MVGP; "this
study's choice" is the emulator that this study chose, beside its own MVGP. "Shortlist" is the
extreme over the shortlisted emulators. `<` and `>` are bounds that the paper states. A reason is
given where the ratio is beyond {factor} either way or, for some quantities, the difference beyond a
limit ({limits}), and where nothing was computed. The
volunteer's volume is exact in the paper, and known to {volume:g} % here. The same as one table:
`results/<study>/tables/paper_comparison.csv`."""

ABSENT = "not computed in this study"
UNEXPLAINED = "no reason known"


def compare(numbers: Path, reasons: Path, ours: pd.DataFrame) -> pd.DataFrame:
    """Paper against `ours` (columns KEYS and value), a row per number in the paper.

    Columns: place, quantity, emulator, set, parameter, statistic, unit, relation, paper, ours,
    ratio (ours / paper), chosen and chosen_ratio (of the emulator that this study chose, beside
    the paper's choice), reason (where they differ by more than FACTOR or DIFFERENCE says, or
    nothing was computed). Raises InputError if a file lacks columns or names a quantity that
    `numbers.csv` does not have.
    """
    paper = _read(numbers, COLUMNS)
    why = _read(reasons, ("quantity", "emulator", "set", "parameter", "reason"))
    unknown = sorted(set(why["quantity"]) - set(paper["quantity"]))
    if unknown:
        raise InputError(
            f"{reasons}: quantity {', '.join(unknown)} is none of {numbers}; correct its name"
        )
    paper = paper.rename(columns={"value": "paper"})
    paper["paper"] = paper["paper"].astype(float)
    found = _lookup(ours)
    rows = []
    for row in paper.to_dict("records"):
        key = tuple(row[name] for name in KEYS)
        row["ours"] = found.get(key, np.nan)
        beside = (key[0], "final", *key[2:])
        row["chosen"] = found.get(beside, np.nan) if row["emulator"] == PAPERS_CHOICE else np.nan
        row["ratio"], row["chosen_ratio"] = (
            row[column] / row["paper"] if row["paper"] else np.nan for column in ("ours", "chosen")
        )
        row["reason"] = _reason(row, why)
        rows.append(row)
    order = ["place", *KEYS, "unit", "relation", "paper", "ours", "ratio", "chosen", "chosen_ratio"]
    return pd.DataFrame(rows)[[*order, "reason"]]


def _read(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    require_columns(path, table, columns, f"it needs {', '.join(columns)}")
    return table


def _lookup(ours: pd.DataFrame) -> dict[tuple, float]:
    keys = ours[list(KEYS)].fillna("").astype(str)
    return dict(zip(keys.itertuples(index=False, name=None), ours["value"], strict=True))


def _reason(row: dict, why: pd.DataFrame) -> str:
    values = [row[name] for name in ("ours", "chosen") if np.isfinite(row[name])]
    if not values:
        return ABSENT
    if not any(differs(row["quantity"], row["paper"], row["relation"], v) for v in values):
        return ""
    names = ("quantity", "emulator", "set", "parameter")
    fits = [
        (sum(entry[n] != "" for n in names), entry["reason"])
        for entry in why.to_dict("records")
        if all(entry[n] in ("", row[n]) for n in names)
    ]
    return max(fits, key=lambda pair: pair[0])[1] if fits else UNEXPLAINED


def differs(quantity: str, paper: float, relation: str, ours: float) -> bool:
    """Whether `ours` is so far from the paper's value that a reason is due.

    A value that the paper only bounds ("<", ">") differs if the bound does not hold here.
    """
    if relation in ("<", ">"):
        return not (ours < paper if relation == "<" else ours > paper)
    if quantity in DIFFERENCE:
        return abs(ours - paper) > DIFFERENCE[quantity]
    if paper == 0 or ours == 0:
        return ours != paper
    ratio = ours / paper
    return not 1 / FACTOR <= ratio <= FACTOR


def compare_study(
    numbers: Path,
    reasons: Path,
    screened: Sequence[Path],
    explained: Path,
    coverage: Sequence[Path],
    diagnostics: Sequence[Path],
    zone_correlations: Sequence[Path],
    volunteer: Sequence[Path],
    estimates: Sequence[Path],
    choice: Path,
    channels: Channels,
    csv: Path,
    md: Path,
) -> None:
    """Write `compare` with everything that the study's files hold, as CSV and Markdown.

    screened: `screening/<set>.parquet`; explained: of the reduction; coverage,
    diagnostics: `posteriors/<emulator>/test/...` of the shortlist and of `final`;
    zone_correlations: `posteriors/final/<scenario>/...`; volunteer: the three files of
    `from_volunteer`, or none; estimates: the two of `from_ranking`, with `choice`, the JSON that
    names the `final` emulator.
    """
    ours = from_simulations({Path(path).stem: path for path in screened})
    ours += from_reduction(explained, channels)
    ours += from_test_posteriors(
        {name: paths[0] for name, paths in by_emulator(coverage).items()},
        {name: paths[0] for name, paths in by_emulator(diagnostics).items()},
    )
    ours += from_scenarios({Path(path).parent.name: path for path in zone_correlations})
    ours += from_volunteer(*volunteer) if volunteer else []
    ranking, pairs = estimates
    ours += from_ranking(ranking, pairs, chosen(choice))
    _save(compare(numbers, reasons, pd.DataFrame(ours)), csv, md)


def _save(table: pd.DataFrame, csv: Path, md: Path) -> None:
    """Write the comparison as CSV and, with an explanation above it, as Markdown."""
    Path(csv).parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(csv, index=False, float_format="%.8g")
    limits = ", ".join(f"{QUANTITIES[name]} {value:g}" for name, value in DIFFERENCE.items())
    volume = 100 * VOLUME_SHARE
    write_page(table, HEADING.format(factor=FACTOR, limits=limits, volume=volume), md)


# ------------------------------------------------------------------- what this study has to offer


def row_of(quantity: str, value: float, **keys: str) -> dict:
    """One row of `ours`."""
    return {name: keys.get(name, "") for name in KEYS[1:]} | {"quantity": quantity, "value": value}


def from_simulations(screened: dict[str, Path]) -> list[dict]:
    """Numbers of converged simulations per set (Parquet of the screening), and their cost."""
    found = []
    for name, path in screened.items():
        table = pd.read_parquet(path)
        found.append(row_of("simulations_kept", len(table), set=name, parameter="all"))
        if name == "train":
            # Tables of finished simulations do not say it.
            for scale, part in table.groupby("scale") if "scale" in table else ():
                found.append(row_of("simulations_kept", len(part), set=name, parameter=str(scale)))
            if "cpu_s" in table:
                found.append(row_of("simulation_minutes", table["cpu_s"].median() / 60))
    return found


def from_reduction(explained: Path, channels: Channels) -> list[dict]:
    """Principal components of the strains that are kept, and the volumes among the channels."""
    kept = int(pd.read_csv(explained)["kept"].sum())
    volumes = int(channels.of_quantity(VOLUME).sum())
    return [row_of("reduced_outputs", kept + volumes, set="train")]


def from_ranking(ranking: Path, pairs: Path, final: str) -> list[dict]:
    """Point estimates per emulator by least squares, as in the paper; pairs told apart.

    ranking, pairs: of the stage `estimates`. The chosen emulator `final` counts with its estimates
    weighted by the predictive covariance. A pair counts if the multi-output emulator is the better
    one and Holm's correction leaves that significant.
    """
    table = pd.read_csv(ranking).set_index("emulator")
    where = {"set": "test", "parameter": "all", "statistic": "mean"}
    found = []
    for emulator, row in table.iterrows():
        mse = row["param_mse_least_squares"]
        found.append(row_of("parameter_mse", mse, emulator=emulator, **where))
        found.append(row_of("output_mse", row["output_mse"], emulator=emulator, **where))
    chosen = table.loc[final]
    found.append(row_of("parameter_mse", chosen["param_mse_weighted"], emulator="final", **where))
    found.append(row_of("output_mse", chosen["output_mse"], emulator="final", **where))
    tests = pd.read_csv(pairs)
    if tests.empty:
        return found
    hits = tests["rejected"] & (tests["better"] == tests["multi"])
    count = int(hits[tests["estimator"] == "least_squares"].sum())
    return [*found, row_of("pairs_rejected", count, set="test", statistic="count")]


def from_test_posteriors(coverage: dict[str, Path], diagnostics: dict[str, Path]) -> list[dict]:
    """Coverage, contraction and convergence on the test set by emulator, `final` among them."""
    found, medians, ess, contracts = [], [], [], 0
    for emulator, path in coverage.items():
        where = {"emulator": emulator, "set": "test"}
        table = pd.read_csv(path).set_index("parameter")
        for name, row in table.iterrows():
            mean = {**where, "parameter": name, "statistic": "mean"}
            found.append(row_of("coverage95", 100 * row["coverage95"], **mean))
            found.append(row_of("variance_ratio", row["variance_ratio"], **mean))
        ratio = table.loc[list(PARAMETERS.names), "variance_ratio"]
        highest = {**where, "parameter": "all", "statistic": "highest mean"}
        found.append(row_of("variance_ratio", ratio.max(), **highest))
        checks = pd.read_csv(diagnostics[emulator]).rename(columns={"ess_bulk": "ess"})
        checks = checks[checks["parameter"].isin(PARAMETERS.names)]
        for quantity in ("rhat", "ess"):
            groups = checks.groupby("parameter")[quantity]
            for statistic, values in (("mean", groups.mean()), ("median", groups.median())):
                found += [
                    row_of(quantity, value, parameter=name, statistic=statistic, **where)
                    for name, value in values.items()
                ]
        if emulator != "final":
            groups = checks.groupby("parameter")
            medians.append(groups["rhat"].median())
            ess.append(groups["ess"].mean())
            c_a, c_b = (ratio.to_numpy()[PARAMETERS.of_factor(name)] for name in ("C_a", "C_b"))
            contracts += int((c_a < c_b).sum())
    everyone = {"emulator": "shortlist", "set": "test", "parameter": "all"}
    median = pd.concat(medians)
    found.append(row_of("rhat", median.min(), statistic="lowest median", **everyone))
    found.append(row_of("rhat", median.max(), statistic="highest median", **everyone))
    found.append(row_of("ess", pd.concat(ess).min(), statistic="lowest mean", **everyone))
    found.append(row_of("c_a_contracts_more_than_c_b", contracts, statistic="count", **everyone))
    return found


def from_scenarios(zone_correlations: dict[str, Path]) -> list[dict]:
    """Correlation of every pair of zones; over all local scenarios its extremes (set `local`)."""
    found, local = [], []
    for name, path in zone_correlations.items():
        table = pd.read_csv(path)
        pair = table["zone_1"] + "-" + table["zone_2"]
        where = {"emulator": "final", "set": name, "statistic": "mean"}
        found += [
            row_of("zone_correlation", value, parameter=which, **where)
            for which, value in zip(pair, table["mean"], strict=True)
        ]
        if name.startswith("local"):
            local.append(pd.Series(table["mean"].to_numpy(), index=pair))
    if local:
        groups = pd.concat(local).groupby(level=0)
        for statistic, values in (("lowest mean", groups.min()), ("highest mean", groups.max())):
            found += [
                row_of("zone_correlation", value, emulator="final", set="local", parameter=which,
                     statistic=statistic)
                for which, value in values.items()
            ]  # fmt: skip
    return found


def from_volunteer(convergence: Path, stiffness: Path, predictive: Path) -> list[dict]:
    """The clinical case: convergence, noise scales and observations outside their interval.

    convergence: `tables.subjects.convergence` (parameter, rhat, split_rhat, ess); stiffness:
    the table of its bullseye (parameter, item, value); predictive: that of its violins.
    """
    where = {"emulator": "final", "set": "volunteer"}
    found = []
    table = pd.read_csv(convergence).set_index("parameter")
    for quantity in ("rhat", "split_rhat", "ess"):
        column = table[quantity]
        found += [
            row_of(quantity, value, parameter=name, statistic="value", **where)
            for name, value in column.items()
        ]
        for statistic in ("min", "max"):
            value = getattr(column, statistic)()
            found.append(row_of(quantity, value, parameter="all", statistic=statistic, **where))
    drawn = pd.read_csv(stiffness)
    items = {"median": "median", "lower95": "hpd_lower95", "upper95": "hpd_upper95"}
    noise = drawn[drawn["parameter"].str.startswith("sigma_") & drawn["item"].isin(items)]
    for row in noise.itertuples():
        found.append(
            row_of("noise", row.value, parameter=row.parameter, statistic=items[row.item], **where)
        )
    seen = pd.read_csv(predictive).query("item == 'observed'")
    outside = ~seen["inside"].astype(str).eq("True")
    volume = seen["quantity"] == "volume"
    for name, which in (("all", volume | True), ("strain", ~volume), ("volume", volume)):
        count = int(outside[which].sum())
        found.append(row_of("outside95", count, parameter=name, statistic="count", **where))
    return [*found, row_of("observations", len(seen), set="volunteer")]
