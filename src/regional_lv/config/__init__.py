"""The configuration of a study: checked, with defaults filled in.

Every key is described once, as a field of a section (`regional_lv.config.sections`): its type,
limits, default, unit and text. `Configuration` (`study`) is all sections; what has to fit between
keys is said by the sections and by it. `python -m regional_lv.config config/README.md` writes the
tables of keys in that page.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from regional_lv.config.files import gather, merged, read, refuse, usable
from regional_lv.config.messages import explain, unknown
from regional_lv.config.section import Reading
from regional_lv.config.study import Configuration, meshes_anew
from regional_lv.seeds import derive

__all__ = [
    "files_of",
    "final_emulator",
    "gather",
    "load",
    "merged",
    "meshes_anew",
    "nuts_of_subjects",
    "read",
    "seed_of_subject",
]


def load(
    config: str | Path | dict, source: str = "config", folders: Sequence[str | Path] = ()
) -> dict:
    """Read, check and complete a configuration.

    Parameters
    ----------
    config: path of a YAML file, or what such files hold (`gather`).
    source: name of the configuration in messages, for a mapping; a path names itself.
    folders: where the files were that the mapping comes from; of a path, its own.

    Returns
    -------
    A new nested dict with every key; `design.test` is the number of test cases and
    `simulations.holdout` that of the rows held out also where they follow from tables. A relative
    path counts from the folder of the configuration if it leads to a file from there, and from the
    working directory otherwise; what is returned counts from the working directory. The plugins
    that it names are loaded.

    Raises
    ------
    InputError: one line per mistake, each with the key and the remedy; also for a subject's
        measured file or a table of simulations that cannot be used.
    """
    if not isinstance(config, dict):
        source, folders = str(config), [Path(config).parent]
        config = read(config)
    reading = Reading(folders)
    try:
        study = Configuration.model_validate(usable(source, config), context=reading)
    except ValidationError as error:
        refuse(source, [*reading.empty, *explain(error)])
    refuse(source, [*reading.empty, *(unknown(study) or study.finish())])
    return study.model_dump()


def files_of(config: Mapping, folders: Sequence[str | Path]) -> list[str]:
    """The files that keys of a configuration name and that are there, counted from the working
    directory. folders: where the configuration was."""
    reading = Reading(folders)
    try:
        Configuration.model_validate(dict(config), context=reading)
    except ValidationError:
        pass  # reported where it is loaded; what it names is the same
    return list(dict.fromkeys(reading.files))


def final_emulator(config: dict) -> str:
    """Name of the files of the emulator that subjects, scenarios and figures use."""
    return "final" if config["evaluation"] else config["emulators"]["final"]


def nuts_of_subjects(config: Mapping) -> dict:
    """Settings of NUTS for the posterior of a subject."""
    own = {key: config["clinical"][key] for key in ("chains", "warmup", "draws")}
    return config["nuts"] | own


def seed_of_subject(config: Mapping, name: str) -> int:
    """Seed of a synthetic subject's noise: its own, or derived from the study's."""
    seed = config["synthetic_subjects"][name]["seed"]
    return derive(config["seed"], "subject", name) if seed is None else seed
