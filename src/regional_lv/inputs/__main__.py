"""Write the catalogue as a page of the documentation.

`python -m regional_lv.inputs docs/inputs.md`.
"""

import sys
from pathlib import Path

from regional_lv import config
from regional_lv.inputs.base import ROLES, Input, SegmentInput
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.model import model_of
from regional_lv.inputs.stiffness import Stiffness

HEAD = """\
# The catalogue of inputs

Every number that the simulator, or what is reported of it, depends on: its value in a study with
default settings, its plausible range, and the scale on which a prior is uniform and effects are
smooth. Of those that every segment has the first one stands for all. Unless it says otherwise, an
input can have any [role](roles.md). Adding one: [Extending](extending.md#an-input).
Written by `make format`.
"""


def document() -> str:
    """The page, as Markdown."""
    model = model_of(config.load({"study": "catalogue"}))
    table = ["| input | family | number | nominal | range | unit | scale |", "|---" * 7 + "|"]
    details = []
    for kind in INPUTS.values():
        each = kind.members(model)[0]
        title = kind.name if not isinstance(each, SegmentInput | Stiffness) else _stem(each)
        nominal = "" if each.nominal is None else f"{each.nominal:.3g}"
        cells = [f"[`{title}`](#{kind.name})", each.family, each.parameter, nominal]
        cells += [f"{each.low:.3g} to {each.high:.3g}", "" if each.unit == "1" else each.unit]
        table.append(f"| {' | '.join([*cells, type(each.scale).__name__.lower()])} |")
        exact = "" if each.is_simulated else " Exact, without a simulation of its own."
        roles = "" if each.roles == ROLES else f" Roles: {', '.join(each.roles)}."
        text = f"{each.description}{exact}{roles}"
        details.append(f"## {kind.name}\n\n{text}\n\n*Source: {each.source}*\n")
    return "\n".join([HEAD, *table, "", *details])


def _stem(each: Input) -> str:
    return f"{each.name.rpartition('_')[0]}_..."


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document())
