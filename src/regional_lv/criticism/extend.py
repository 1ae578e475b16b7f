"""The study with the named causes as a part of its model."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from regional_lv.criticism.contract import Cause, read_findings
from regional_lv.errors import InputError
from regional_lv.inputs.closed_forms import HeavyTails


def write_extended(findings: str | Path, config: Mapping, extended: str | Path) -> None:
    """Write the configuration (YAML) of the study in which the named causes of one subject, or of
    several together, are inferred beside the stiffness.

    config: the study's, complete. Raises InputError if nothing is named that the model could take
    up.
    """
    content = read_findings(findings)
    by_name = {cause["name"]: cause for cause in content["hypotheses"]}
    named = [by_name[name] for name in content["named"] if name != HeavyTails.name]
    if not named:
        raise InputError(
            f"{findings}: no cause is named that the model could take up, so that there is nothing "
            "to extend; read its `words`"
        )
    inputs = config["inputs"] | {
        input_name(cause): {"role": "inferred", "range": cause["range"]} for cause in named
    }
    study = {**config, "study": f"{config['study']}_extended", "inputs": inputs}
    first = (
        f"# The study {config['study']} with what its criticism of {content['subject']} named:\n"
        f"# {', '.join(content['named'])}\n"
    )
    Path(extended).write_text(first + yaml.safe_dump(study, sort_keys=False))


def input_name(cause: Cause) -> str:
    """Of the input that a cause is, in its place."""
    return f"{cause['name']}_{cause['component']}" if cause["component"] else cause["name"]
