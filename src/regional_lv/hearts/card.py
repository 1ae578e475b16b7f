"""What the emulator of any heart says of itself: kept in its file, shown in the documentation."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.emulators.errors_by_causes import count_on, errors_by
from regional_lv.emulators.gaussian import Z95
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.emulators.training import read_simulations
from regional_lv.errors import InputError
from regional_lv.hearts.file import AnyHeart, read, write
from regional_lv.hearts.population import COLUMNS, HEART
from regional_lv.inputs.space import Inputs
from regional_lv.study.manifest import versions

COMPARED = 64
"""Simulations at which the kept emulator is compared with the one before it was shortened."""

FEW_ON = 2
"""Causes that are on at most where a posterior looks the emulator up, nearly always."""

LARGEST_MB = 10.0
"""Of the file: it comes along with the package."""

HEAD = """\
# The emulator of any heart

<!-- Written by `python -m regional_lv.hearts docs/heart_emulator.md` from the file itself. -->

`heart_emulator.pt.gz` comes with the package and answers for a heart of which nothing was simulated
([the fast way](fast.md)). Networks learn what a segment of any wall does, from values and
derivatives; a Gaussian process is the model of their errors, learnt from simulations that they were
not trained on, and is conditioned on simulations of one heart.
"""

OF_ERRORS = """
## Errors on other hearts

Simulations that it did not learn from, on its mesh. Volumes are in mL, of a cavity of that length;
strains are fractions.
"""

OF_RANGES = """
## What it knows

Lengths are those of a heart whose cavity has the length above, and go with it; stresses go with the
pressure. Figures of a shape also have to go together: a heart is refused that is farther from the
middle of the population, in the normal distribution of their logarithms, than any of the simulated.
"""

TITLES = ["quantity", "heart", "simulations", "median error", "rms error", "95 % intervals cover"]


def ship(
    emulator_file: str | Path,
    test: str | Path,
    summary: str | Path,
    physics: Mapping,
    mesh: Mapping,
    seed: int,
    shipped: str | Path,
) -> None:
    """Write the file that comes with the package, with its card.

    emulator_file: over all inputs, with what a finer mesh changes if that was learnt. test: other
    screened simulations on the study's mesh (Parquet), each with its kind of heart. summary: of the
    screening of what it learnt from (CSV). physics, mesh, seed: of the study.

    Raises InputError for a file that would be too large.
    """
    emulator = JointGP.load(emulator_file)
    theta, y, _ = read_simulations(test, emulator.parameters, emulator.outputs)
    inputs = Inputs.from_config(physics).simulated
    suspected = inputs.subset(inputs.of_role("suspected"))
    nominal = dict(zip(suspected.names, suspected.nominal.tolist(), strict=True))
    emulator, rescaled = _calibrated(emulator, theta, y, nominal)
    kinds = pd.read_parquet(test, columns=[HEART])[HEART].to_numpy()
    groups = {kind: kinds == kind for kind in dict.fromkeys(sorted(kinds))}
    groups["all"] = np.ones(len(kinds), dtype=bool)
    errors = errors_by(emulator.of_study_mesh, theta, y, groups, HEART).to_dict("records")
    card = _card(emulator, pd.read_csv(summary).iloc[0], rescaled, mesh, seed, errors)
    write(emulator, physics, card, shipped)
    size = os.path.getsize(shipped) / 1e6
    if size > LARGEST_MB:
        raise InputError(
            f"{shipped}: {size:.1f} MB, and {LARGEST_MB:g} fit into the package; lower "
            "emulators.joint_gp.max_observations"
        )
    # What the file's precision changes is in the card, too.
    write(emulator, physics, card | {"shortened": _change(emulator, read(shipped))}, shipped)


def _calibrated(
    emulator: JointGP, theta: torch.Tensor, y: torch.Tensor, nominal: Mapping[str, float]
) -> tuple[JointGP, dict]:
    """The emulator with errors on the study's mesh that are stated as large as they are at other
    simulations theta (n, P), y (n, D), with few causes on; and what the card says of it. nominal:
    of the suspected inputs, by name."""
    few = count_on(emulator, theta, nominal) <= FEW_ON
    factor = 1.0
    if few.any():
        factor = calibrating_factor(emulator.of_study_mesh.errors_of(theta[few], y[few]).numpy())
    return emulator.rescaled(factor), {"factor": factor, "simulations": int(few.sum())}


def _card(
    emulator: JointGP,
    counts: pd.Series,
    rescaled: Mapping,
    mesh: Mapping,
    seed: int,
    errors: Sequence[Mapping],
) -> dict:
    """What an emulator says of itself. counts: of the screening of what it learnt from."""
    return {
        "simulations": len(emulator.learnt_from),
        "tried": int(counts["simulations"]),
        "finer": emulator.processes[-1].info["rows"] if len(emulator.processes) > 1 else 0,
        "networks": {
            key.removeprefix("network_"): value
            for key, value in emulator.settings.items()
            if key.startswith("network_")
        },
        "observations": len(emulator.processes[0].seen) + len(emulator.processes[0].inputs),
        "rescaled": rescaled,
        "cpu_s_median": float(counts["cpu_s_median"]),
        "mesh": dict(mesh),
        "seed": seed,
        "versions": versions(),
        "errors": errors,
        "ranges": _ranges(emulator),
    }


def calibrating_factor(errors: np.ndarray) -> float:
    """What stated errors are multiplied by, so that 95 % of these `errors`, in stated sds, lie
    within 95 % intervals.

    One network that leaves out a part of the simulations errs more than the mean of several that
    learn from all of them, and with many causes on more than with few.
    """
    return float(np.quantile(np.abs(errors), 0.95)) / Z95


def _ranges(emulator: JointGP) -> dict[str, list[float]]:
    """Ends of what it knows, by input: of a shape those of what it learnt from."""
    ends = np.stack([emulator.lower.numpy(), emulator.upper.numpy()], axis=1)
    learnt = emulator.learnt_from.numpy()
    for e, name in enumerate(emulator.coordinates.names):
        if name in COLUMNS:
            ends[e] = learnt[:, e].min(), learnt[:, e].max()
    return dict(zip(emulator.coordinates.names, ends.tolist(), strict=True))


def _change(emulator: JointGP, kept: AnyHeart) -> float:
    """Largest change of a predicted mean, in sds of the outputs, by the file's precision."""
    theta = emulator.learnt_from[:COMPARED]
    change = emulator.predict_mean(theta) - kept.emulator.predict_mean(theta)
    return float((change.abs() / emulator.output_sd).max())


def document(any_heart: AnyHeart) -> str:
    """The page of the documentation (Markdown)."""
    card, base = any_heart.card, any_heart.known.base
    units = {each.name: each.unit for each in any_heart.known}
    learnt = (
        f"{card['simulations']:,} of {card['tried']:,} simulations, each of another ventricle, "
        f"with derivatives with respect to all {len(units)} inputs"
    )
    observed = "values and derivatives" if len(any_heart.emulator.processes[0].seen) else "values"
    networks = "none"
    if card["networks"]["passes"]:
        networks = (
            "{members} for all segments of a level, {members} for the volume and {members} for "
            "the apex, of which the mean counts: {layers} layers of {width}, {passes} passes; one "
            "other of each for {folds} parts of the simulations, for the errors on that part"
        ).format(**card["networks"])
    facts = {
        "learnt from": learnt,
        "networks": networks,
        "process of the errors": f"{card['observations']:,} {observed}",
        "errors stated": "times {factor:.2f}, so that 95 % intervals hold 95 % of {simulations} "
        f"others with at most {FEW_ON} causes on".format(**card["rescaled"]),
        "corrected by": f"{card['finer']} of them on a finer mesh",
        "design": f"Sobol sequence, shapes of `regional_lv.hearts.population`, seed {card['seed']}",
        "looked up at": f"cavity {base['geometry']['length_mm']:g} mm long, "
        f"{base['loading']['pressure_mmhg']:g} mmHg",
        "mesh": ", ".join(f"{key} {value}" for key, value in card["mesh"].items()),
        "a simulation took": f"{card['cpu_s_median']:.1f} CPU s (median)",
        "precision of the file changes": f"an output by {card['shortened']:.1g} of its sd at most",
        "made with": ", ".join(f"{name} {n}" for name, n in card["versions"].items() if n),
        "made by": "`make heart-emulator` (`config/heart_emulator.yaml`)",
        "SHA-256": f"`{any_heart.checksum}`",
    }
    errors = [
        [
            row["quantity"],
            row[HEART],
            row["simulations"],
            f"{row['median_error']:.2g}",
            f"{row['rms_error']:.2g}",
            f"{100 * row['coverage95']:.0f} %",
        ]
        for row in card["errors"]
    ]
    ranges = [
        [f"`{name}`", f"{low:.3g}", f"{high:.3g}", units[name]]
        for name, (low, high) in card["ranges"].items()
    ]
    return "\n".join(
        [
            HEAD,
            *_table(["", ""], facts.items()),
            OF_ERRORS,
            *_table(TITLES, errors),
            OF_RANGES,
            *_table(["input", "from", "to", "unit"], ranges),
            "",
        ]
    )


def _table(titles: Sequence[str], rows: Iterable[Iterable]) -> list[str]:
    lines = [titles, ["---"] * len(titles), *rows]
    return [f"| {' | '.join(map(str, line))} |" for line in lines]
