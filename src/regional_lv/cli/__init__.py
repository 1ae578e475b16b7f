"""The command line: a folder for a heart of your own, the check of it, its study, that of many
hearts, and the check of what these made."""

import click

from regional_lv.cli.check import check
from regional_lv.cli.cohort import cohort
from regional_lv.cli.new import new
from regional_lv.cli.run import run
from regional_lv.cli.verify import verify
from regional_lv.study import surroundings


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="regional-lv")
def main() -> None:
    """Regional stiffness of a left ventricle from its geometry and its measured strains."""
    surroundings.settle()


for command in (new, check, run, cohort, verify):
    main.add_command(command)
