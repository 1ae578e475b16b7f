"""Posteriors of several scenarios, without and with measurement noise, as one table."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import pandas as pd

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.scenarios import stiffened

NOISE = ("without measurement noise", "with measurement noise")


def read_sets(
    recoveries: Sequence[Path], labels: Sequence[str], parameters: StiffnessInputs
) -> pd.DataFrame:
    """The rows of several `recovery.csv` (cases x parameters) with what scenarios add to them.

    recoveries: of the sets `labels`, and then, if there are more, of their noisy twins.

    Added columns: noise (one of NOISE), set (its label), quantity (the factor), of (zone of the
    parameter), stiffened (whether that zone is stiff), failed.
    """
    factor, zone = ({p.name: getattr(p, what) for p in parameters} for what in ("factor", "zone"))
    tables = []
    of_sets = product(NOISE[: len(recoveries) // len(labels)], labels)
    for path, (noise, label) in zip(recoveries, of_sets, strict=True):
        table = pd.read_csv(path, dtype={"case": str})
        table.insert(0, "set", label)
        table.insert(0, "noise", noise)
        table.insert(0, "file", str(path))
        table["quantity"] = table["parameter"].map(factor)
        table["of"] = table["parameter"].map(zone)
        table["stiffened"] = stiffened(table["of"], table["zone"])
        table["failed"] = table["verdict"] != "passed"
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
