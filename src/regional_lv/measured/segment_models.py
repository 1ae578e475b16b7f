"""Segments of measured values: the AHA's 17, the same without the apex, and 18.

The 18-segment model of echocardiography has six apical walls and no apex. Its segments 1 to 12 are
the AHA's; its 13 to 18 are other parts of the wall than the AHA's 13 to 17, and become its 13 to
16 by the angles that both span (`aha.APICAL_SHARES`).
"""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.channels import Channel
from regional_lv.csv_lines import error_at

MODELS = (16, 17, 18)
"""Numbers of segments that a file may count."""

ECHO = max(MODELS)


def check_segment(path: str | Path, line: int, where: str, number: float, segments: int) -> int:
    """The number of a segment of the model with so many `segments`.

    where: what names the segment, for the message. Raises InputError for another number.
    """
    if number in range(1, segments + 1):
        return int(number)
    if number == ECHO:
        complaint = (
            f"that is of the {ECHO}-segment model (six apical walls, no apex), whose 13 to {ECHO} "
            f"are other parts of the wall than the AHA's 13 to 17; keep them all and add "
            f"`segments: {ECHO}` to the subject in the configuration, which converts them. Where "
            "the others are the AHA's, correct the number"
        )
    elif number in range(1, ECHO):
        complaint = (
            f"the model of {segments} segments has no segment {number:g}; set `segments` to how "
            f"many the file counts, 17 or {ECHO}"
        )
    elif number > ECHO:
        complaint = (
            f"there is no segment {number:g} in the models that are read, of "
            f"{', '.join(map(str, MODELS))} segments; export one of them"
        )
    else:
        complaint = f"is not an AHA segment; use its number, 1 to {min(segments, 17)}"
    raise error_at(path, line, f"{where}: {complaint}")


def to_aha(path: str | Path, table: pd.DataFrame, segments: int) -> pd.DataFrame:
    """A table of channels with the segments of the AHA.

    table: as `measured.tables.make_table` makes it, with the segments of the model of so many
    `segments`. An apical segment of the AHA has the mean of the walls that it consists of, weighted
    by their shares of its sector, and is absent if one of them is. Its sd is that of this mean of
    values with independent errors: that its neighbours share walls is not kept.

    Raises InputError if there is no segment 18 among the apical ones of an 18-segment model, and if
    nothing was measured but walls that make up no segment of the AHA.
    """
    apical = table["segment"].isin(aha.SIX_WALLS)
    if segments != ECHO or not apical.any():
        return table
    if ECHO not in set(table["segment"]):
        raise error_at(
            path,
            None,
            f"the subject says segments: {ECHO}, and there is no segment {ECHO}; add it, or remove "
            "`segments` if these are the 17 of the AHA",
        )
    rows = {}
    for (quantity, load), walls in table[apical].groupby(["quantity", "load_fraction"]):
        at = dict(zip(walls["segment"], walls.index, strict=True))
        for segment, shares in aha.APICAL_SHARES.items():
            if not shares.keys() <= at.keys():
                continue
            own = [at[wall] for wall in shares]
            weights, part = np.array(list(shares.values())), table.loc[own]
            channel = Channel(quantity, f"{segment:02d}", load)
            rows[min(own), segment] = table.loc[own[weights.argmax()]].to_dict() | {
                "output": channel.name,
                "place": channel.place,
                "segment": segment,
                "value": weights @ part["value"],
                "sd": np.sqrt(weights**2 @ part["sd"] ** 2),
            }
    others = table[~apical]
    if not rows:
        if others.empty:
            raise error_at(
                path,
                None,
                "the apical walls that it has make up no segment of the AHA; add the walls beside "
                "them, or other segments",
            )
        return others.reset_index(drop=True)
    others.index = pd.MultiIndex.from_product([others.index, [0]])
    made = pd.DataFrame(list(rows.values()), pd.MultiIndex.from_tuples(rows), table.columns)
    return pd.concat([others, made.astype(table.dtypes)]).sort_index().reset_index(drop=True)
