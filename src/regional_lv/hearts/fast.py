"""One heart, from its segment table and measured file to posterior, verdict and page, by the
emulator of any heart: no simulation, no mesh, no simulator."""

import logging
from collections.abc import Mapping
from pathlib import Path

from regional_lv.channels import Channels
from regional_lv.criticism.findings import write_findings
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import KEPT, Critic, Settings
from regional_lv.errors import InputError
from regional_lv.hearts.emulator import HeartEmulator
from regional_lv.hearts.file import AnyHeart, shipped
from regional_lv.hearts.reach import within
from regional_lv.inference.sampling import write
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.measured import read_measured
from regional_lv.measured.curves import import_curves
from regional_lv.measured.tables import import_measured
from regional_lv.parameters import Parameterisation

log = logging.getLogger(__name__)

NOTES = "notes.txt"
"""What was cut to what the emulator knows, a line each."""


def answer(heart: Mapping, folder: str | Path, any_heart: AnyHeart | None = None) -> None:
    """Write what can be said of one heart: `measured.csv`, `findings.json` (`criticism.contract`),
    `posterior.nc` averaged over models, figures, `page.html`, and `notes.txt` if ranges were cut.

    heart: a checked configuration with one subject, measured by the user. folder: made if it is not
    there. any_heart: the emulator; the one that comes with the package by default, read once in a
    process. What stands out is suspected, never named: nothing is simulated of this heart.

    Raises `reach.OutOfReach` for a heart that the emulator does not know, before anything is
    computed, and InputError for files that cannot be used.
    """
    known = any_heart or shipped()
    config, notes = within(heart, known.emulator, known.known)
    (subject,) = config["subjects"]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    measured = folder / "measured.csv"
    import_subject(config, subject, measured)
    critic = critic_of(config, subject, measured, known)
    concluded = critic.conclude([], has_simulator=False)
    write(concluded.verdict.averaged.inference_data(KEPT, critic.seed), folder / "posterior.nc")
    write_findings(concluded.findings, folder / "findings.json")
    (folder / NOTES).write_text("".join(f"{note}\n" for note in notes))
    for sentence in (*notes, *concluded.findings["words"]):
        log.info("%s", sentence)


def critic_of(config: Mapping, subject: str, measured: Path, known: AnyHeart) -> Critic:
    """Of a heart within reach."""
    physics = sections_of(config)
    channels = Channels.from_config(config)
    emulator = HeartEmulator(known.emulator, known.known, Inputs.from_config(physics))
    settings = Settings.from_config(settings_of(config))
    table = read_measured(measured, channels, strain_exponent=settings.strain_exponent)
    return Critic(
        subject,
        {subject: table},
        emulator.select(channels.names),
        *(physics, settings, config["seed"]),
    )


def import_subject(config: Mapping, name: str, measured: Path) -> None:
    """Check what was measured of a subject and write it in the units used inside."""
    subject = config["subjects"][name]
    given = {
        "channels": Channels.from_config(config),
        "parameters": Parameterisation.from_config(config),
        "strain_exponent": config["observables"]["strain_exponent"],
        "measured": measured,
    }
    if subject["source"] == "file":
        pressure = config["loading"]["pressure_mmhg"]
        import_measured(subject["measured"], pressure_mmhg=pressure, **given)
    elif subject["source"] == "curves":
        import_curves(subject["curves"], subject, **given)
    else:
        raise InputError(
            f"subjects.{name}.source: {subject['source']}; the fast way is for what a user "
            "measured, `file` or `curves`"
        )
