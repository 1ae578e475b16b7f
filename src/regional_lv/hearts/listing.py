"""The list of the hearts of a cohort: a pattern of folders as `regional-lv new` writes them, or a
table (CSV) with a row for each heart.

The workflow reads it while it is planned, by every process: nothing here reads a heart.
"""

import glob
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from regional_lv import config as study_config
from regional_lv.csv_lines import error_at, number_in, read_lines
from regional_lv.errors import InputError
from regional_lv.hearts import CONFIG
from regional_lv.input_files import check_file
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive

COLUMNS = {
    "segments": ("geometry", "segments"),
    "endo_apex_z_mm": ("geometry", "endo_apex_z_mm"),
    "epi_apex_z_mm": ("geometry", "epi_apex_z_mm"),
    "pressure_mmhg": ("loading", "pressure_mmhg"),
    "measured": ("subjects", "patient", "measured"),
}
"""Columns of the table of a cohort beside `heart`, and the keys that they stand for."""

SDS = {
    "pressure_sd_mmhg": ("end_diastolic_pressure", "sd_mmhg"),
    "wall_thickness_sd_mm": ("segment_thickness", "sd_mm"),
    "endo_radius_sd_mm": ("endo_radius", "sd_mm"),
}
"""Columns that it may have, and the input that is measured with this standard deviation."""


@dataclass(frozen=True)
class Listed:
    """A heart that a study lists: its name; file, its configuration, or the table that it has a row
    in; keys and line, those of its row."""

    name: str
    file: str
    keys: Mapping | None = None
    line: int | None = None

    @property
    def folder(self) -> str:
        """From which its paths count."""
        return str(Path(self.file).parent)

    @property
    def where(self) -> str:
        """Of its keys, for messages."""
        return self.file if self.line is None else f"{self.file}, line {self.line}"

    def own(self) -> dict:
        """What it says of itself. Raises InputError."""
        if self.keys is not None:
            return dict(self.keys)
        check_file(self.file, remedy=f"give each heart's folder a {CONFIG} (regional-lv new)")
        return study_config.read(self.file)

    def files(self, folders: Sequence[str]) -> list[str]:
        """What it is made from: its configuration and the files that this names, if they are
        there, in its own folder or in the cohort's `folders`."""
        # Of a table only its own row concerns it.
        own = [self.file] if self.keys is None and Path(self.file).is_file() else []
        try:
            return own + study_config.files_of(self.own(), [self.folder, *folders])
        except InputError:
            return own


def list_hearts(pattern: str) -> list[Listed]:
    """The hearts of a cohort (`cohort.hearts` of a configuration), in the order of their names or
    of the table's rows.

    Raises InputError where there are none, for a table that cannot be read, and for a heart that is
    listed twice.
    """
    paths = [Path(path) for path in sorted(glob.glob(pattern))]
    tables = [path for path in paths if path.suffix.lower() == ".csv"]
    folders = [path for path in paths if path.is_dir()]
    if len(paths) == len(tables) == 1:
        hearts = _rows(tables[0])
    else:
        hearts = [Listed(path.name, str(path / CONFIG)) for path in folders]
    if not hearts:
        raise InputError(
            f"cohort.hearts: {pattern}: no heart there; give a pattern of folders that "
            "`regional-lv new` wrote, such as hearts/*/, or a table (CSV) that names hearts"
        )
    lines = [*_twice({h.where: h.name for h in hearts}, "the name {}")]
    if not tables:
        places = {h.where: str(Path(h.folder).resolve()) for h in hearts}
        lines += _twice(places, "the folder {}")
    if lines:
        raise InputError("\n".join(lines))
    return hearts


def _twice(values: Mapping[str, str], what: str) -> Iterator[str]:
    """What several have, by where they are."""
    first: dict[str, str] = {}
    for where, value in values.items():
        if value in first:
            yield (
                f"{where}: has {what.format(value)}, as {first[value]} has: a heart listed twice; "
                "remove one of both, or rename it"
            )
        first.setdefault(value, where)


def _rows(path: Path) -> list[Listed]:
    hearts = []
    for line, fields in read_lines(path, ("heart", *COLUMNS), tuple(SDS)).rows:
        name = fields["heart"]
        if not name.isprintable() or not name.strip(".") or "/" in name:
            raise error_at(
                path, line, f"heart `{name}` is not a usable name; give one of letters and digits"
            )
        hearts.append(Listed(name, str(path), _keys(fields), line))
    return hearts


def _keys(fields: Mapping[str, str]) -> dict:
    """A row as the keys of a configuration; text that is no number stays, to be complained of."""
    keys: dict = {"subjects": {"patient": {"source": "file"}}}
    for column, path in COLUMNS.items():
        section = keys
        for name in path[:-1]:
            section = section.setdefault(name, {})
        text = fields[column]
        number = number_in(text) if column.split("_")[-1] in ("mm", "mmhg") else math.nan
        section[path[-1]] = (text or None) if math.isnan(number) else number
    for column, (name, key) in SDS.items():
        if fields.get(column):
            number = number_in(fields[column])
            sd = fields[column] if math.isnan(number) else number
            keys.setdefault("inputs", {})[name] = {"role": "measured", key: sd}
    return keys


def batches_of(names: Sequence[str], most: int) -> dict[str, list[str]]:
    """Names by the batch that they are answered in, `most` in each on average.

    The batch follows from the name and from the power of two that the number of batches is, so that
    few hearts change it when others come or go.
    """
    count = 2 ** math.ceil(math.log2(max(len(names) / most, 1)))
    batches: dict[str, list[str]] = {}
    for name in names:
        batches.setdefault(f"{derive(0, 'batch', name) % count:04d}", []).append(name)
    return dict(sorted(batches.items()))


def model_of_hearts(config: Mapping) -> dict:
    """What stiffness means in a checked configuration: plain values, which have to be the same in
    all hearts."""
    reference = {key: config["material"][key] for key in ("law", "constants", "reference")}
    return {"parameters": StiffnessInputs.from_config(config).spec(), "material": reference}
