"""Write the catalogue as a page of the documentation.

`python -m regional_lv.criticism.hypotheses docs/causes.md`.
"""

import sys
from pathlib import Path

from regional_lv import config
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.physics import physics_of

HEAD = """\
# The catalogue of causes

Each cause is one number that the base model holds at a fixed value. These are the names that
`criticism.hypotheses` takes, with the values of a study with default settings. How they are
searched: [Model criticism](criticism.md). How to add one: [Extending](extending.md#a-cause). This
page is written by `make format` from the catalogue itself.
"""


def document() -> str:
    """The page, as Markdown."""
    physics = physics_of(config.load({"study": "catalogue"}))
    table = ["| cause | number | base model | range | unit |", "|---" * 5 + "|"]
    details = []
    for name, hypothesis in REGISTRY.items():
        here = hypothesis.for_study(physics)
        base, low, high = (f"{value:g}" for value in (here.base, here.low, here.high))
        unit = "" if here.unit == "1" else here.unit
        cells = [f"[`{name}`](#{name})", here.parameter, base, f"{low} to {high}", unit]
        table.append(f"| {' | '.join(cells)} |")
        reason = here.why_not(physics)
        only = f"Not in a study with default settings: {reason}.\n\n" if reason else ""
        details.append(f"## {name}\n\n{here.description}\n\n{only}*Source: {here.source}*\n")
    return "\n".join([HEAD, *table, "", *details])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document())
