"""Tables of simulations that confirm sets of causes: what to simulate, and what came of it."""

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import torch

from regional_lv.errors import InputError


def design_columns(parameters: Sequence[str]) -> list[str]:
    """Columns of a table of simulations to make; of `design_rows`."""
    return ["set", "draw", "subject", *parameters, "effects"]


def design_rows(members: Sequence[tuple[str, str]], model, draws: torch.Tensor) -> list[dict]:
    """Simulations to make: one per draw x (n, P) of `model` and heart.

    members: name and component of the model's extensions. A row has the `design_columns`;
    `effects` is JSON: name -> [value, component].
    """
    theta, psi = model.theta(draws), model.psi_of(draws)
    names = model.layout.parameters.names
    return [
        {
            "set": label(members),
            "draw": draw,
            "subject": subject,
            **dict(zip(names, theta[draw, heart].tolist(), strict=True)),
            "effects": json.dumps(
                {
                    name: [float(value), component]
                    for (name, component), value in zip(members, psi[draw, heart], strict=True)
                }
            ),
        }
        for draw in range(len(draws))
        for heart, subject in enumerate(model.observations.subjects)
    ]


def slope_of(output: str) -> str:
    """Column of a simulated design: derivatives of an output about log theta, P numbers a row."""
    return f"slope_{output}"


def label(members: Sequence[tuple[str, str]]) -> str:
    """`focal_scar:7 + septal_load`; for no cause an empty text."""
    return " + ".join(f"{n}:{c}" if c else n for n, c in members)


def read_simulated(path: str | Path) -> pd.DataFrame:
    """A simulated design (Parquet). Raises InputError if it has no derivatives."""
    table = pd.read_parquet(path)
    if len(table) and not any(column.startswith(slope_of("")) for column in table):
        raise InputError(
            f"{path}: no derivatives about theta; an earlier version made this file: remove it, "
            "and it is made again"
        )
    return table
