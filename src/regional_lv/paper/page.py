"""The comparison with the paper as a page: a section for each of its tables, figures, sections."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.emulators import REGISTRY, label_of
from regional_lv.paper import KEYS

QUANTITIES = {
    "simulation_minutes": "minutes of one simulation",
    "simulations_kept": "simulations kept",
    "observations": "observations",
    "reduced_outputs": "reduced outputs",
    "parameter_mse": "MSE of the factors",
    "output_mse": "MSE of the outputs",
    "pairs_rejected": "pairs with a better multi-output emulator",
    "rhat": "R-hat",
    "split_rhat": "split R-hat",
    "ess": "ESS",
    "coverage95": "95 % intervals cover (%)",
    "variance_ratio": "posterior to prior variance",
    "c_a_contracts_more_than_c_b": "zones in which C_a contracts more than C_b",
    "zone_correlation": "correlation between zones",
    "noise": "noise (training sd)",
    "outside95": "observations outside their 95 % interval",
}
"""How the page names a quantity."""

STATISTICS = {"hpd_lower95": "95 % HPD from", "hpd_upper95": "95 % HPD to"}
"""How the page names a statistic; others as they are."""

RELATIONS = {"=": "", "about": "about "}
"""Before a number of the paper; `<` and `>` stand as they are."""


def write_page(table: pd.DataFrame, heading: str, md: Path) -> None:
    """Write a comparison (`comparison.compare`) as Markdown under a `heading`."""
    parts = [heading.strip()]
    for place, part in table.groupby("place", sort=False):
        title = str(place)
        parts += [f"## {title[0].upper()}{title[1:]}", *_section(part)]
    Path(md).parent.mkdir(parents=True, exist_ok=True)
    Path(md).write_text("\n\n".join(parts) + "\n")


def _section(part: pd.DataFrame) -> list[str]:
    """A table and the reasons for the differences in it, each once."""
    varying = [key for key in KEYS if part[key].nunique() > 1]
    same = [_name(key, part[key].iloc[0]) for key in KEYS if key not in varying]
    row = next((key for key in ("parameter", "emulator") if key in varying), None)
    columns = [key for key in varying if key != row]
    wide = None if row is None else _wide(part, row, columns)
    caption = ", ".join(filter(None, same))
    found = [f"{caption[0].upper()}{caption[1:]}."] if caption else []
    return [*found, markdown(_long(part, varying) if wide is None else wide), *_reasons(part)]


def _wide(part: pd.DataFrame, row: str, columns: list[str]) -> pd.DataFrame | None:
    """A line for each value of `row`, paper and study beside each other for each combination of
    `columns`; None if combinations are missing, or nothing would become shorter."""
    lines = list(dict.fromkeys(part[row]))
    groups = list(product(*(dict.fromkeys(part[key]) for key in columns)))
    if len(lines) * len(groups) != len(part) or len(lines) < 3:
        return None
    wide = {row: [_name(row, line) for line in lines]}
    for group in groups:
        mask = np.logical_and.reduce([part[k] == v for k, v in zip(columns, group, strict=True)])
        own = part[mask] if columns else part
        names = filter(None, map(_name, columns, group))
        wide |= _numbers(own.set_index(row).loc[lines], ", ".join(names))
    return pd.DataFrame(wide)


def _long(part: pd.DataFrame, varying: list[str]) -> pd.DataFrame:
    keys = {key: [_name(key, value) for value in part[key]] for key in varying}
    return pd.DataFrame(keys | _numbers(part, ""))


def _numbers(part: pd.DataFrame, name: str) -> dict[str, list]:
    """Columns with the paper's numbers and the study's; of the study's own choice of an emulator,
    too, where the paper's choice stands."""
    before = f"{name}: " if name else ""
    relations = [RELATIONS.get(r, f"{r} ") for r in part["relation"]]
    papers = [r + f"{value:.4g}" for r, value in zip(relations, part["paper"], strict=True)]
    columns = {f"{before}paper": papers, f"{before}this study": list(part["ours"])}
    if part["chosen"].notna().any():
        columns[f"{before}this study's choice"] = list(part["chosen"])
    return columns


def _reasons(part: pd.DataFrame) -> list[str]:
    told = part[part["reason"] != ""]
    if told.empty:
        return []
    lines = []
    for (quantity, reason), rows in told.groupby(["quantity", "reason"], sort=False):
        emulators = [_name("emulator", e) for e in dict.fromkeys(rows["emulator"])]
        of = ", ".join(filter(None, [QUANTITIES[quantity], *emulators]))
        lines.append(f"- {of}: {reason}.".replace("<", "&lt;"))
    return ["Why they differ:", "\n".join(lines)]


def _name(key: str, value: str) -> str:
    if key == "quantity":
        return QUANTITIES[value]
    if key == "emulator" and value in REGISTRY:
        return label_of(value)
    if key == "parameter" and value.startswith("sigma_"):
        return f"noise, {value.removeprefix('sigma_')}"
    if key == "parameter" and value.startswith("C_"):
        return " ".join(value.rsplit("_", 1))
    return "" if value in ("all", "final", "value") else STATISTICS.get(value, value)


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown: four digits, empty for NaN, numbers to the right."""
    numeric = [pd.api.types.is_numeric_dtype(dtype) for dtype in table.dtypes]
    lines = ["| " + " | ".join(table.columns) + " |"]
    lines.append("|" + "|".join("---:" if right else "---" for right in numeric) + "|")
    for row in table.itertuples(index=False):
        lines.append("| " + " | ".join(_plain(value) for value in row) + " |")
    return "\n".join(lines)


def _plain(value: object) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value).replace("|", "\\|")
