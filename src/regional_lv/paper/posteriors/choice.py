"""The final emulator, chosen by a stated rule from the posteriors on the test set."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from regional_lv.errors import InputError

LEAST_COVERAGE = 0.9
RULE = (
    "The least mean CRPS, among the emulators whose 95 % intervals do not cover fewer than 90 % "
    "for certain (the upper end of the interval for their coverage, over all parameters). If "
    "there is none, the one whose coverage is highest."
)
"""The CRPS is a proper score: intervals that are too wide or too narrow are paid for in it."""


def choose_final(
    candidates: Sequence[str | Path],
    coverages: Sequence[str | Path],
    wanted: str,
    emulator_file: str | Path,
    report: str | Path,
    made: Sequence[str | Path] = (),
    adopted: Sequence[str | Path] = (),
) -> None:
    """Copy the final emulator to `emulator_file`, say why in `report` (JSON).

    candidates: the emulators' files, named like them; coverages: their `coverage.csv` on the test
    set in the same order. wanted: `auto`, or a name to take instead of the rule's. report: final,
    rule, candidates (each emulator, coverage95 with its interval, crps, mse, variance_ratio,
    failed, cases, eligible, why). made: further files of all candidates, <emulator>/<name> or
    <emulator>/<set>/<name>; the final one's are copied to `adopted`, files of the same names.

    Raises InputError if there is no candidate, or if `wanted` is none.
    """
    if not candidates:
        raise InputError(
            "emulators.shortlist: it is empty, so that there is no emulator to choose; name one in "
            "emulators.shortlist.names"
        )
    files = {Path(path).stem: path for path in candidates}
    table = pd.DataFrame(
        [
            pd.read_csv(path).set_index("parameter").loc["all"].rename(name)
            for name, path in zip(files, coverages, strict=True)
        ]
    )
    eligible = table["coverage95_upper"] >= LEAST_COVERAGE
    if wanted != "auto":
        if wanted not in files:
            raise InputError(
                f"emulators.final: {wanted} is not on the shortlist ({', '.join(files)}); "
                "choose one of these, or write `auto`"
            )
        final, rule = wanted, "emulators.final of the config"
    elif eligible.any():
        final, rule = table.loc[eligible, "crps"].idxmin(), RULE
    else:
        final, rule = table["coverage95"].idxmax(), RULE
    numbers = ["coverage95", "coverage95_lower", "coverage95_upper", "crps", "mse"]
    described = [
        {"emulator": name}
        | {key: float(row[key]) for key in (*numbers, "variance_ratio")}
        | {key: int(row[key]) for key in ("failed", "cases")}
        | {"eligible": bool(eligible[name]), "why": _why(row, bool(eligible[name]))}
        for name, row in table.iterrows()
    ]
    shutil.copyfile(files[final], emulator_file)
    content = {"final": final, "rule": rule, "candidates": described}
    Path(report).write_text(json.dumps(content, indent=2) + "\n")
    own = {path.name: path for path in map(Path, made) if final in path.parts[-3:-1]}
    for target in map(Path, adopted):
        shutil.copyfile(own[target.name], target)


def _why(row: pd.Series, eligible: bool) -> str:
    lower, upper = (100 * row[f"coverage95_{end}"] for end in ("lower", "upper"))
    text = (
        f"95 % intervals cover {100 * row['coverage95']:.1f} % ({lower:.1f} to {upper:.1f}); "
        f"mean CRPS {row['crps']:.4f}"
    )
    if eligible and upper < 95:
        return f"{text}; somewhat too narrow"
    return text if eligible else f"{text}; far too narrow"
