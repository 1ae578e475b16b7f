"""`regional-lv new`: a folder to fill in."""

import csv
import io
import re
from pathlib import Path
from string import Template

import click

from regional_lv import data
from regional_lv.cli.folder import Mistakes
from regional_lv.geometry.table import COLUMNS, SD_COLUMNS
from regional_lv.hearts import CONFIG
from regional_lv.input_files import reason_of

NO_TEXT = {"no", "yes", "on", "off", "true", "false", "null", "y", "n"}
"""Words that YAML takes for something else than text."""

READ_TO_MM = "1"
"""Standard deviation of what is read off images, in the table to be filled in."""

TEMPLATE = Path(__file__).parent / "template"


@click.command()
@click.argument("name")
def new(name: str) -> None:
    """Write the folder NAME: geometry table, measured file and configuration, to be filled in."""
    folder = Path(name)
    study = folder.resolve().name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,49}", study) or study.lower() in NO_TEXT:
        raise Mistakes(
            f"{study[:100]}: not a usable name of a study; use up to 50 letters, digits and "
            "underscores, begin with a letter, and avoid words such as no or null"
        )
    try:
        if folder.exists():
            raise Mistakes(
                f"{folder}: is there already, and nothing is overwritten; choose another"
            )
        folder.mkdir(parents=True)
        (folder / CONFIG).write_text(Template(_template(CONFIG)).substitute(study=study))
        (folder / "segments.csv").write_text(_template("segments.csv") + _volunteer())
        (folder / "measured.csv").write_text(_template("measured.csv") + _empty())
    except OSError as error:
        place = str(folder)[:200]
        raise Mistakes(
            f"{place}: cannot be written ({reason_of(error)}); choose another place"
        ) from None
    click.echo(
        f"{folder}: {CONFIG}, segments.csv and measured.csv; fill them in (comments say how), then "
        f"`regional-lv check {name}`"
    )


def _template(file: str) -> str:
    return (TEMPLATE / file).read_text()


def _volunteer() -> str:
    """The volunteer's segment table, with the columns that count."""
    sds = dict.fromkeys(SD_COLUMNS.values(), READ_TO_MM)
    with data.segment_table(data.VOLUNTEER).open(newline="") as file:
        return _text([*COLUMNS, *sds], [row | sds for row in csv.DictReader(file)])


def _empty() -> str:
    """A row for every channel of the default study, without values."""
    with data.path("measured_template.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        rows = [row | {"value": "", "sd": ""} for row in reader]
    return _text(reader.fieldnames, rows)


def _text(columns, rows) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
