"""Write the catalogue as a page of the documentation.

`python -m regional_lv.inputs docs/inputs.md`.
"""

import sys
from pathlib import Path

from regional_lv import config
from regional_lv.inputs.base import Input, SegmentInput
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.model import model_of
from regional_lv.inputs.stiffness import Stiffness

HEAD = """\
# The catalogue of inputs

Every number that the simulator, or what is reported of it, depends on: its name, the value of the
model as it is in a study with default settings, its plausible range, and the scale on which a prior
is uniform and effects are smooth. Of those that every segment has the first one stands for all.
What a study does with an input is its *role*, section `inputs` of the
[configuration](configuration.md); a family stands for all inputs in it, and `causes` for what a
criticism doubts: all but the stiffness and the single measures of the shape. How to add one:
[Extending](extending.md#an-input). This page is written by `make format` from the catalogue itself.
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
        exact = "" if each.is_simulated else "Exact, without a simulation of its own. "
        roles = f"{exact}Roles: {', '.join(each.roles)}.\n\n"
        details.append(f"## {kind.name}\n\n{each.description}\n\n{roles}*Source: {each.source}*\n")
    return "\n".join([HEAD, *table, "", *details])


def _stem(each: Input) -> str:
    return f"{each.name.rpartition('_')[0]}_..."


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document())
