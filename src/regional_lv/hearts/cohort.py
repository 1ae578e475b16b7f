"""The hearts of a cohort: read, checked and compared, before anything runs.

What is wrong with one heart leaves that heart out, with the reason; what is wrong with the list
(`hearts.listing`), or with half of the hearts, ends everything before anything runs.
"""

import json
import logging
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.geometry.surfaces import Surfaces
from regional_lv.geometry.table import read_segments
from regional_lv.hearts import ONE_HEART, checks
from regional_lv.hearts.listing import Listed, model_of_hearts
from regional_lv.inputs.space import warn_of_exact_shape
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.plausibility import data_warnings, too_small
from regional_lv.quantities.seth_hill import Measure
from regional_lv.study.layout import HeartFiles
from regional_lv.units import KPA_PER_MMHG

log = logging.getLogger(__name__)

LIKE_KPA = 3.5, 20.0
"""How many times lower than the others a pressure is that is in kPa."""

OTHER_SIZE = 3.0
"""Times that a heart is longer, or shorter, than the others where it is in another unit."""

OTHER_NOISE = 25.0
"""The same of the noise of the strains: fractions and per cent differ by 100."""

OF_THE_MACHINE = (OSError, MemoryError)
"""What no heart is to blame for: the job fails, and is done again as a whole."""

MOST_LEFT_OUT = 0.5
"""Share of the hearts without which a cohort is no longer the one that was meant."""


# --------------------------------------------------------------------------------- one heart


@dataclass(frozen=True)
class Heart:
    """A heart that was read and can be answered.

    config: checked, of one subject, which has the heart's name. table: measured. cavity_ml,
    wall_ml: unloaded. warnings: what `regional-lv check` has to say of it.
    """

    name: str
    config: dict
    table: pd.DataFrame
    cavity_ml: float
    wall_ml: float
    warnings: list[str]

    @property
    def pressure_mmhg(self) -> float:
        return self.config["loading"]["pressure_mmhg"]

    @property
    def strain_sd(self) -> float:
        """Median over the strains; NaN where the noise is not given."""
        return float(self.table.loc[self.table["quantity"] != "volume", "sd"].median())


def configure(listed: Listed, shared: Mapping, folders: Sequence[str]) -> dict:
    """The checked configuration of a heart, whose one subject has the heart's name.

    shared: what the cohort's configuration gives, which goes on top of that of any heart
    (`one_heart.yaml`) and below the heart's own; folders: from which its paths count. Raises
    InputError.
    """
    own = listed.own()
    of_all = {key: value for key, value in shared.items() if key not in ("cohort", "subjects")}
    below = study_config.merged(study_config.read(ONE_HEART), of_all)
    given = study_config.merged(below, own) | {"study": shared["study"]}
    config = study_config.load(given, listed.where, [listed.folder, *folders])
    subjects = checks.measured_subjects(config)
    lines = checks.not_given(config, own)
    if len(subjects) != 1 or len(config["subjects"]) != 1:
        lines.append(
            f"subjects: {len(subjects)} with a file of {len(config['subjects'])}; a heart of a "
            "cohort has one, with the source file or curves"
        )
    if lines:
        raise InputError("\n".join(f"{listed.where}: {line}" for line in lines))
    return config | {"subjects": {listed.name: config["subjects"][subjects[0]]}}


def read_heart(listed: Listed, shared: Mapping, folders: Sequence[str]) -> Heart:
    """Read and check all files of a heart. Raises InputError for what cannot be used."""
    config = configure(listed, shared, folders)
    channels, parameters = Channels.from_config(config), StiffnessInputs.from_config(config)
    measured = checks.read_subject(listed.name, config, channels)
    found = checks.heart_warnings(config)
    if listed.keys is None:
        own = listed.own()
        by_its_name = dict.fromkeys(own.get("subjects") or {}, config["subjects"][listed.name])
        found += checks.place_warnings(Path(listed.file), own, config | {"subjects": by_its_name})
    cavity, wall, thickness = _sizes(config)
    found += checks.uneven(thickness) + checks.unusual(thickness["thickness_mm"].median(), cavity)
    if complaint := too_small(measured.table, cavity):
        raise InputError(f"{listed.where}: subjects: {complaint}")
    measure = Measure.of(config["observables"])
    converted = config["subjects"][listed.name]["source"] == "curves"
    found += measured.doubts
    found += data_warnings(
        measured.table, channels, len(parameters), measure, cavity, wall, converted
    )
    return Heart(listed.name, config, measured.table, cavity, wall, found)


def _sizes(config: Mapping) -> tuple[float, float, pd.DataFrame]:
    """Volumes of cavity and wall (mL), and the thickness of the segments by number."""
    geometry = config["geometry"]
    if geometry["source"] == "segments":
        table = read_segments(geometry["segments"]).set_index("aha_segment")
        surfaces = Surfaces(table, geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"])
        return *surfaces.volumes(), table.rename(columns={"wall_thickness_mm": "thickness_mm"})
    # Imported here: only these sources need a mesher.
    from regional_lv.geometry.from_config import make_heart

    with tempfile.TemporaryDirectory() as folder:
        files = HeartFiles(f"{folder}/")
        make_heart(config, files)
        summary = json.loads(Path(files.summary).read_text())
        segments = pd.read_csv(files.segments, index_col="aha_segment")
    return summary["cavity_volume_ml"], summary["wall_volume_ml"], segments


# -------------------------------------------------------------------------------- all hearts


@dataclass(frozen=True)
class Cohort:
    """The hearts that can be answered, and why others cannot, by name."""

    hearts: dict[str, Heart]
    left_out: dict[str, str]


def read_cohort(
    hearts: Sequence[Listed],
    shared: Mapping,
    folders: Sequence[str],
    model: Mapping,
    check_reach: Callable[[Mapping], object],
) -> Cohort:
    """Read, check and compare all hearts of a cohort.

    shared, folders: as of `configure`. model: of the cohort (`listing.model_of_hearts`).
    check_reach: raises InputError for a configuration that cannot be answered.

    Raises InputError, a line for each heart that is concerned: for hearts that are one and the
    same, for models that differ, and if half of the hearts or more cannot be answered.
    """
    read: dict[str, Heart] = {}
    left_out: dict[str, str] = {}
    for listed in hearts:
        with failing_alone(listed.name, left_out):
            # Warnings are among the heart's own, also those that a process shows once.
            warn_of_exact_shape.cache_clear()
            with warnings.catch_warnings(action="ignore"), collected_warnings() as logged:
                heart = read_heart(listed, shared, folders)
                check_reach(heart.config)
            # What surfaces say of themselves, they say whenever they are read.
            heart.warnings.extend(dict.fromkeys(logged))
            read[listed.name] = heart
    if lines := [*_same(read), *_other_models(read, model)]:
        raise InputError("\n".join(lines))
    left_out |= _other_units(read)
    if len(left_out) >= MOST_LEFT_OUT * len(hearts):
        raise InputError(
            f"cohort: {len(left_out)} of {len(hearts)} hearts cannot be answered; correct them, or "
            "remove them from the cohort\n"
            + "\n".join(f"{n}: {why}" for n, why in left_out.items())
        )
    kept = {name: heart for name, heart in read.items() if name not in left_out}
    return Cohort(kept, {h.name: left_out[h.name] for h in hearts if h.name in left_out})


@contextmanager
def failing_alone(name: str, reasons: dict[str, str]) -> Iterator[None]:
    """What fails about a heart meanwhile is put among the `reasons`, by its name."""
    try:
        yield
    except OF_THE_MACHINE:
        raise
    except InputError as error:
        reasons[name] = str(error)
    except Exception as error:
        log.exception("%s", name)
        reasons[name] = f"{type(error).__name__}: {error}"


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """What the package warns of meanwhile in its log, in place of showing it."""
    lines: list[str] = []

    def keep(record: logging.LogRecord) -> bool:
        lines.append(record.getMessage())
        return False

    collector, package = logging.Handler(logging.WARNING), logging.getLogger("regional_lv")
    collector.addFilter(keep)
    package.addHandler(collector)
    shown, package.propagate = package.propagate, False
    try:
        yield lines
    finally:
        package.propagate = shown
        package.removeHandler(collector)


def _same(hearts: Mapping[str, Heart]) -> Iterator[str]:
    """Hearts with the same measured values, geometry and pressure; a warning where these two are
    others."""
    known: dict[str, Heart] = {}
    for name, heart in hearts.items():
        values = heart.table.sort_values("output")[["output", "value"]].to_csv(index=False)
        other = known.setdefault(values, heart)
        if other is heart:
            continue
        mine, theirs = (
            (one.pressure_mmhg, round(one.cavity_ml, 3), round(one.wall_ml, 3))
            for one in (heart, other)
        )
        if mine == theirs:
            yield (
                f"{name}: measured values, geometry and pressure are those of {other.name}: a "
                "heart listed twice; remove one of both"
            )
        heart.warnings.append(f"the measured values are those of {other.name}")


def _other_models(hearts: Mapping[str, Heart], model: Mapping) -> Iterator[str]:
    """Hearts whose stiffness means something else than the cohort's."""
    for name, heart in hearts.items():
        for section, value in model_of_hearts(heart.config).items():
            if value != model[section]:
                yield (
                    f"{name}: {section}: not as in the cohort's configuration, so that the "
                    "stiffness cannot be compared with that of other hearts; say it there, once"
                )


def _other_units(hearts: Mapping[str, Heart]) -> dict[str, str]:
    """Hearts that have something in another unit than the others, with the reason."""
    found: dict[str, str] = {}
    if len(hearts) < 3:
        return found  # which one is the odd one?
    pressure, size, noise = (
        pd.Series({name: value(heart) for name, heart in hearts.items()}, dtype=float)
        for value in (
            lambda h: h.pressure_mmhg,
            lambda h: np.cbrt(h.cavity_ml),
            lambda h: h.strain_sd,
        )
    )
    for name, heart in hearts.items():
        others = pressure.drop(name).median()
        ratio = others / pressure[name]
        if pressure[name] < checks.LOW_PRESSURE_MMHG and LIKE_KPA[0] < ratio < LIKE_KPA[1]:
            found[name] = (
                f"loading.pressure_mmhg: {pressure[name]:g} mmHg, and the other hearts have "
                f"{others:g} (median); it looks like kPa: {pressure[name] / KPA_PER_MMHG:.3g} mmHg"
            )
        others = size.drop(name).median()
        if not 1 / OTHER_SIZE < size[name] / others < OTHER_SIZE:
            found[name] = (
                f"geometry: the unloaded cavity has {heart.cavity_ml:.3g} mL, and those of the "
                f"other hearts {others**3:.3g} (median); its unit is another one: give mm"
            )
        others = noise.drop(name).median()
        ratio = noise[name] / others
        if np.isfinite(ratio) and not 1 / OTHER_NOISE < ratio < OTHER_NOISE:
            found[name] = (
                f"subjects: the sd of the strains is {noise[name]:.2g} (as a fraction), and that "
                f"of the other hearts {others:.2g} (median); it counts in the unit of its value: "
                "correct it"
            )
    return found


def reach_of_emulator() -> Callable[[Mapping], object]:
    """What raises InputError for a configuration that the emulator of any heart does not know."""
    # Imported here: the workflow, which lists hearts, plans without PyTorch.
    from regional_lv.hearts.file import shipped
    from regional_lv.hearts.reach import within_by_table

    known = shipped()

    def check(config: Mapping) -> None:
        with tempfile.TemporaryDirectory() as folder:
            within_by_table(config, known, Path(folder, "segments.csv"))

    return check


def check_cohort(
    hearts: Sequence[Mapping],
    shared: Mapping,
    folders: Sequence[str],
    model: Mapping,
    checked: str | Path,
) -> None:
    """Read and compare all hearts (each as the fields of `Listed`); write (JSON) `left_out`, the
    reasons by heart, and of the other `hearts` what was read.

    Raises InputError as `read_cohort` does.
    """
    listed = [Listed(**one) for one in hearts]
    cohort = read_cohort(listed, shared, folders, model, reach_of_emulator())
    for name, why in cohort.left_out.items():
        log.warning("%s is left out: %s", name, why)
    known = {
        name: {
            "pressure_mmhg": heart.pressure_mmhg,
            "cavity_ml": heart.cavity_ml,
            "wall_ml": heart.wall_ml,
            "channels": len(heart.table),
            "warnings": heart.warnings,
        }
        for name, heart in cohort.hearts.items()
    }
    content = {"left_out": cohort.left_out, "hearts": known}
    Path(checked).write_text(json.dumps(content, indent=1) + "\n")
