"""Warnings about measured values that are missing or unusual for the heart that they are of.

Nothing here is a reason to refuse a file; `too_small` alone is.
"""

import numpy as np
import pandas as pd

from regional_lv.channels import Channel, Channels
from regional_lv.measured import data_checks
from regional_lv.measured.tables import VOLUME_SHARE, shortcomings
from regional_lv.quantities import seth_hill

GREEN_MEANS = {
    "circumferential": (-0.27, -0.06),
    "radial": (0.11, 0.75),
    "longitudinal": (-0.24, -0.04),
}
"""Range of the mean over the segments in the paper's 5,661 training simulations, of one heart at
8 mmHg with factors from 0.1 to 5."""

GROWTH = (0.85, 1.2)
"""In the same simulations, the square of the mean circumferential stretch times the longitudinal
one is 0.88 to 1.19 times the unloaded over the loaded volume of the cavity with a quarter of the
wall."""

SDS = {"strains": (0.002, 0.15), "the volume": (0.5, 30.0)}
"""Standard deviations of the noise, as fractions and in mL, beyond which a unit may be wrong."""

NOISY = 0.05
"""A noisy strain near zero may have the wrong sign by this much, or by three of its sds."""

SLIP = 20.0
"""A segment whose strain is so many times smaller or larger than the median has another unit."""


def too_small(table: pd.DataFrame, cavity_ml: float) -> str:
    """The complaint about volumes of a filled heart that are no larger than its unloaded cavity, or
    nothing."""
    volumes = table.loc[table["quantity"] == "volume", "value"]
    if volumes.empty or volumes.min() > cavity_ml:
        return ""
    return (
        f"volume {volumes.min():.1f} mL, and the cavity of the unloaded geometry holds "
        f"{cavity_ml:.1f} mL; filling makes a heart larger: check the unit and frame of the "
        "volume, and that the geometry is that of early diastole"
    )


def data_warnings(
    table: pd.DataFrame,
    channels: Channels,
    parameters: int,
    measure: seth_hill.Measure,
    cavity_ml: float,
    wall_ml: float,
    converted: bool = False,
) -> list[str]:
    """What is missing or unusual in a measured table (as of `read_measured`), in sentences.

    channels: what the study observes. parameters: how many numbers are inferred. measure: of
    the strains. cavity_ml, wall_ml: volumes of the unloaded heart. converted:
    whether the strains were converted from the measure that the configuration names.
    """
    found = [*_missing(table, channels), *shortcomings(table, parameters)]
    volume, unknown = table["quantity"] == "volume", table["sd"].isna()
    if (unknown & ~volume).any():
        found.append(
            "no sd of the strains: the noise of each direction is inferred; give an sd if it is "
            "known"
        )
    if (unknown & volume).any():
        found.append(
            f"no sd of the volume: it counts as known to {100 * VOLUME_SHARE:g} %; give its sd, in "
            "mL, if it is known"
        )
    found += _unusual_sd(table, volume)
    full = table[table["load_fraction"] == 1]
    stretches = {
        quantity: seth_hill.stretch(rows["value"].to_numpy(), measure.exponent)
        for quantity, rows in full.groupby("quantity", sort=False)
        if quantity in GREEN_MEANS
    }
    for quantity, stretch in stretches.items():
        found += _unusual(quantity, stretch, converted)
        found += _slips(full[full["quantity"] == quantity])
        found += _bulges(full[full["quantity"] == quantity])
    found += _growth(full, stretches, cavity_ml, wall_ml)
    checks = data_checks.check(table, measure, converted)
    return found + [check["says"] for check in checks if not check["passed"]]


def _missing(table: pd.DataFrame, channels: Channels) -> list[str]:
    given = set(table["output"])
    absent: dict[tuple[str, float], list[Channel]] = {}
    for channel in channels:
        if channel.name not in given:
            absent.setdefault((channel.quantity, channel.load_fraction), []).append(channel)
    found = []
    for (quantity, load), some in absent.items():
        if quantity == "volume" and load == 1:
            continue  # `shortcomings` reports it with its consequence
        all_of_it = sum(c.quantity == quantity and c.load_fraction == load for c in channels)
        at = "" if load == 1 else f" at {100 * load:g} % of the load"
        which = "" if len(some) == all_of_it else " " + ", ".join(c.place for c in some)
        found.append(f"not measured: {quantity}{at}{which}; the remaining channels are used")
    return found


def _unusual(quantity: str, stretch: np.ndarray, converted: bool) -> list[str]:
    mean, (low, high) = ((stretch**2 - 1) / 2).mean(), GREEN_MEANS[quantity]
    if low <= mean <= high:
        return []
    return [
        f"the mean {quantity} strain is {mean:.3f} (Green); simulated hearts with factors from "
        f"0.1 to 5 have {low:g} to {high:g}: check "
        + ("frame and unit" if converted else "frame, unit and strain measure")
    ]


def _unusual_sd(table: pd.DataFrame, volume: pd.Series) -> list[str]:
    """Noise that no measurement has."""
    found = []
    strains = table["quantity"].isin(GREEN_MEANS)
    for part, what, unit in ((table[strains], "strains", ""), (table[volume], "the volume", " mL")):
        low, high = SDS[what]
        odd = part[part["sd"].notna() & ~part["sd"].between(low, high)]
        if len(odd):
            found.append(
                f"{odd['output'].iloc[0]} has an sd of {odd['sd'].iloc[0]:g}{unit}; measurements "
                f"of {what} have {low:g} to {high:g}{unit}: check its unit, which is that of the "
                "value"
            )
    return found


def _slips(rows: pd.DataFrame) -> list[str]:
    size = rows["value"].abs()
    if not size.median():
        return []
    ratio = size / size.median()
    lost = [
        f"{rows['output'][i]} is zero; if it was not tracked, remove it"
        for i in ratio.index[ratio == 0]
    ]
    return lost + [
        f"{rows['output'][i]} is {rows['value'][i]:.3g}, {factor:.3g} times the median of its "
        "direction: check its unit"
        for i, factor in ratio.items()
        if factor and not 1 / SLIP <= factor <= SLIP
    ]


def _bulges(rows: pd.DataFrame) -> list[str]:
    """Segments that do the opposite of the others."""
    against = rows["value"] * np.sign(rows["value"].median()) < -np.fmax(NOISY, 3 * rows["sd"])
    return [
        f"{rows['output'][i]} is {rows['value'][i]:.3g}, and most segments have the other sign: "
        "right if the wall bulges there, otherwise correct it"
        for i in rows.index[against]
    ]


def _growth(full: pd.DataFrame, stretches: dict, cavity_ml: float, wall_ml: float) -> list[str]:
    volume = full.loc[full["quantity"] == "volume", "value"]
    if volume.empty or not {"circumferential", "longitudinal"} <= set(stretches):
        return []
    lines = stretches["circumferential"].mean() ** 2 * stretches["longitudinal"].mean()
    inner = wall_ml / 4
    volumes = (cavity_ml + inner) / (volume.iloc[0] + inner)
    low, high = GROWTH
    if low <= lines / volumes <= high:
        return []
    return [
        f"by the strains the ventricle with the inner quarter of its wall grows {1 / lines:.2f} "
        f"times, by its volumes ({cavity_ml:.0f} to {volume.iloc[0]:.0f} mL) {1 / volumes:.2f} "
        "times: strains, volume and geometry are not of the same two frames, or a unit is wrong"
    ]
