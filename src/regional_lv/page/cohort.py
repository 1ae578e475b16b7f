"""The page of a cohort: a row for each heart, the population, shared causes, and who is missing."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.hearts import hierarchy, prevalence
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.page.page import embedded, read_template

TEMPLATE = Path(__file__).parent / "cohort.html"

FEW_DRAWS = 200
"""Effective draws below which estimates and intervals are rough."""


def make_cohort_page(
    hearts: str | Path,
    population: str | Path,
    causes: str | Path,
    stiffness_picture: str | Path,
    pooling_picture: str | Path,
    causes_picture: str | Path,
    study: str,
    parameters: StiffnessInputs,
    limitations: str,
    page: str | Path,
    template: str | Path = TEMPLATE,
) -> None:
    """Write the page of a cohort, which needs no other file but for the pages of its hearts.

    hearts (Parquet), population, causes (CSV): of `hearts.summary.summarise_cohort`. Pictures
    (PNG): of `plots.cohort`. limitations: where the page finds the project's limitations.
    """
    table = pd.read_parquet(hearts)
    answered = table[table["reason"] == ""]
    pictures = {
        "stiffness": stiffness_picture,
        "pooling": pooling_picture,
        "causes": causes_picture,
    }
    known = pd.read_csv(population)
    html = read_template(template).render(
        study=study,
        pictures=embedded(pictures),
        parameters=[*parameters],
        rows=[_row(row, parameters) for row in answered.to_dict("records")],
        failed=table.loc[table["reason"] != "", ["heart", "reason"]].to_dict("records"),
        warned=[
            {"heart": row.heart, "warnings": row.warnings.splitlines()}
            for row in answered.itertuples()
            if row.warnings
        ],
        total=len(table),
        untrusted=int(answered["trusted"].eq(False).sum()),
        population=known.to_dict("records"),
        rhat=float(known["rhat"].max()) if len(known) else None,
        fewest=hierarchy.FEWEST,
        causes=pd.read_csv(causes).to_dict("records"),
        some=prevalence.SOME,
        table=Path(hearts).name,
        limitations=limitations,
    )
    Path(page).write_text(html)


def _row(row: Mapping, parameters: StiffnessInputs) -> dict:
    """What the page shows of a heart that was answered."""
    flags = [] if row["trusted"] else ["no stiffness can be trusted"]
    if row["misfit_detected"] and row["trusted"]:
        flags.append("the model as it is misses the measurements")
    if row["acts_like"]:
        flags.append(f"acts like {row['acts_like']}")
    if row["effective_draws"] < FEW_DRAWS:
        flags.append(f"{row['effective_draws']:.0f} effective draws")
    if row["warnings"]:
        count = len(row["warnings"].splitlines())
        flags.append(f"{count} warning{'s' if count > 1 else ''}")
    factors = []
    for p in parameters:
        pooled = row.get(f"{p.name}_pooled", np.nan)
        factors.append(
            {
                "mean": row[p.name],
                "sd": row[f"{p.name}_sd"],
                "pooled": None if pd.isna(pooled) else pooled,
                "shrinkage": row.get(f"{p.name}_shrinkage"),
            }
        )
    return {
        **{key: row[key] for key in ("heart", "page", "trusted", "pressure_mmhg", "causes")},
        "certainty": row["certainty"],
        "p": row["misfit_p_value"],
        "flags": flags,
        "factors": factors,
    }
