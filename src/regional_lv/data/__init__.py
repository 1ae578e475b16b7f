"""Tables that belong to the package.

`volunteer_segments.csv`: figures read off the paper's published mesh, borders of the sectors
rounded to the AHA's. `measured_template.csv`: the form of a measured file. `land_2015.csv`: what
the participants of a benchmark of the solver found. `heart_emulator.pt.gz`: the emulator of any
heart (`hearts.file`).
"""

from pathlib import Path


def path(name: str) -> Path:
    """Where a table lies."""
    return Path(__file__).parent / name


VOLUNTEER = "volunteer"
"""What a configuration calls the segment table of the paper's volunteer."""


def segment_table(given: str | Path) -> Path:
    """The file of a segment table: a path, or the word `volunteer`."""
    return path("volunteer_segments.csv") if str(given) == VOLUNTEER else Path(given)


SHIPPED = path("heart_emulator.pt.gz")
"""The emulator of any heart."""
