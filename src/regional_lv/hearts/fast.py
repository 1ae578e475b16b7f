"""One heart, from its segment table and measured file to posterior, verdict and page, by the
emulator of any heart: no simulation, no mesh, no simulator."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from regional_lv.channels import Channels
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import Critic, critic_of, write_concluded
from regional_lv.emulators import OF_INPUTS
from regional_lv.errors import InputError
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.meshing import write_plain
from regional_lv.hearts.file import AnyHeart, shipped
from regional_lv.hearts.reach import within_by_table
from regional_lv.inputs.physics import physics_of, why_not_scaling
from regional_lv.inputs.space import sections_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.curves import import_curves
from regional_lv.measured.tables import import_measured
from regional_lv.page.page import make_page
from regional_lv.plots import (
    bullseye_posterior,
    criticism,
    measured_strains,
    posterior_predictive,
)
from regional_lv.study.layout import AnswerFiles, HeartFiles

PICTURES = ("measured_strains", "bullseye_posterior", "posterior_predictive")
"""Figures, by the module that draws each."""

OF_CRITICISM = ("residuals", "causes", "effects", "sources")
"""Those of `plots.criticism`, in its order."""

RESTS_ON = (
    "the answer comes from an emulator of hearts of all kinds that the package brings along; "
    "nothing was simulated of this one, so that what stands out is suspected and never named"
)


BY_TABLE = (
    "the wall is described by means over its segments; what surfaces through these change is told "
    "by the volumes of the segments' quarters, and what that leaves open counts among the errors"
)


def answer(
    heart: Mapping,
    folder: str | Path,
    any_heart: AnyHeart | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write what can be said of one heart: what was measured, findings (`criticism.contract`), the
    posterior averaged over models, figures, and a page.

    heart: a checked configuration with one subject, measured by the user. folder: of the answer
    (`study.layout.AnswerFiles`); made if it is not there. any_heart: the emulator; the one that
    comes with the package by default, read once in a process. notes: what the page says besides, a
    sentence each. What stands out is suspected, never named: nothing is simulated of this heart.

    Raises `reach.OutOfReach` for a heart that the emulator does not know, before anything is
    computed, and InputError for files that cannot be used.
    """
    known, files = any_heart or shipped(), AnswerFiles(str(folder))
    described = heart["geometry"]["source"] != "segments"
    config, cut = within_by_table(heart, known, files.segments)
    (subject,) = config["subjects"]
    notes = [*notes, *([BY_TABLE] if described else []), *cut]
    Path(folder).mkdir(parents=True, exist_ok=True)
    import_subject(config, subject, files.measured)
    critic = critic_of_heart(config, subject, files.measured, known, described)
    concluded = critic.conclude([], has_simulator=False)
    write_concluded(critic, concluded, files.findings, files.posterior)
    write_page(config, subject, notes, files)


def write_page(config: Mapping, subject: str, notes: Sequence[str], files: AnswerFiles) -> None:
    """The figures and the page of what `answer` has written."""
    parameters, channels = StiffnessInputs.from_config(config), Channels.from_config(config)
    source = config["subjects"][subject]["source"]
    given = {"posterior": files.posterior, "findings": files.findings, "source": source}
    figures = (*PICTURES, *OF_CRITICISM)
    png, csv = ({name: Path(files.figure(name, end)) for name in figures} for end in ("png", "csv"))
    name = "measured_strains"
    measured_strains.draw(files.measured, subject, source, parameters, png[name], csv[name])
    name = "bullseye_posterior"
    bullseye_posterior.draw(**given, parameters=parameters, png=png[name], csv=csv[name])
    name = "posterior_predictive"
    posterior_predictive.draw(**given, png=png[name], csv=csv[name])
    criticism.draw(
        given["findings"],
        parameters,
        **{name: png[name] for name in OF_CRITICISM},
        tables=[csv[name] for name in OF_CRITICISM],
    )
    with tempfile.TemporaryDirectory() as temporary:
        make_page(
            subject=subject,
            study=config["study"],
            source=source,
            measured=files.measured,
            posterior=given["posterior"],
            findings=given["findings"],
            emulator=OF_INPUTS,
            strains_picture=png["measured_strains"],
            stiffness_picture=png["bullseye_posterior"],
            fit_picture=png["posterior_predictive"],
            residuals_picture=png["residuals"],
            causes_picture=png["causes"],
            effects_picture=png["effects"],
            sources_picture=png["sources"],
            mesh=make_heart(config, HeartFiles(f"{temporary}/"), lay_out=write_plain),
            parameters=parameters,
            channels=channels,
            pressure_mmhg=config["loading"]["pressure_mmhg"],
            strain_exponent=config["observables"]["strain_exponent"],
            scales_with_pressure=not why_not_scaling(physics_of(dict(config))),
            notes=[RESTS_ON, *notes],
            page=files.page,
        )


def critic_of_heart(
    config: Mapping, subject: str, measured: str | Path, known: AnyHeart, described: bool = False
) -> Critic:
    """Of a heart within reach."""
    physics = sections_of(config)
    emulator = known.of_heart(physics, Channels.from_config(config), described)
    settings, seed = settings_of(config), config["seed"]
    return critic_of(emulator, subject, [subject], [measured], physics, settings, seed)


def import_subject(config: Mapping, name: str, measured: str | Path) -> None:
    """Check what was measured of a subject and write it in the units used inside."""
    subject = config["subjects"][name]
    given = {
        "channels": Channels.from_config(config),
        "parameters": StiffnessInputs.from_config(config),
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
