"""Tables that belong to the package.

`volunteer_segments.csv`: figures read off the paper's published mesh, borders of the sectors
rounded to the AHA's; `volunteer_aha_segments.csv`: means of the same surfaces over the AHA's
sectors and thirds. `measured_template.csv`: the form of a measured file. `land_2015.csv`: what the
participants of a benchmark of the solver found. `described_surfaces.csv`: what changes where a
segment table describes surfaces (`hearts.by_surfaces`). `heart_emulator.pt.gz`: the emulator of any
heart (`hearts.file`).
"""

from pathlib import Path


def path(name: str) -> Path:
    """Where a table lies."""
    return Path(__file__).parent / name


VOLUNTEER, VOLUNTEER_AHA = "volunteer", "volunteer_aha"
"""What a configuration calls the segment tables of the paper's volunteer."""

TABLES = (VOLUNTEER, VOLUNTEER_AHA)


def segment_table(given: str | Path) -> Path:
    """The file of a segment table: a path, or a word for one that comes with the package."""
    if str(given) in TABLES:
        return path(f"{given}_segments.csv")
    return Path(given)


SHIPPED = path("heart_emulator.pt.gz")
"""The emulator of any heart."""
