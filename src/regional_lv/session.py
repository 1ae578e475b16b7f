"""A study in Python: the functions and the files of the workflow's rules, called from a session.

    from regional_lv.session import Study

    study = Study("config/quick.yaml")
    study.make_heart()
    simulations = study.simulate()
    emulator = study.train("gradient_gp")
    posterior = study.infer("measured.csv", emulator)

Files lie where the workflow puts them, so that either can go on with what the other made.
"""

from collections.abc import Collection, Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.config.section import not_offered
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import criticise_by_emulator
from regional_lv.emulators import REGISTRY, load
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.training import train_emulator
from regional_lv.errors import InputError
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.mesh_config import finer
from regional_lv.inference import posteriors
from regional_lv.inputs.physics import physics_of
from regional_lv.inputs.space import model_sections_of, sections_of_stiffness
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import import_measured
from regional_lv.mechanics.predictor import fit_predictor
from regional_lv.simulation.batches import (
    make_runner,
    simulate_batch,
    solve_anchors,
    solve_baseline,
)
from regional_lv.simulation.screening import screen_simulations
from regional_lv.simulation.sobol import make_design
from regional_lv.simulation.subjects import simulate_subject
from regional_lv.study.layout import AnswerFiles, Layout


class Study:
    """One heart, its simulations, emulators and posteriors.

    Attributes: config (checked, complete), parameters, channels, physics (what simulations depend
    on), files (where each lies).

    Parameters
    ----------
    config: path of a configuration, or what such a file holds.
    folder: where files go, `results/<study>` by default.

    Raises InputError for a configuration that cannot be used.
    """

    def __init__(self, config: str | Path | Mapping, folder: str | Path | None = None):
        config = dict(config) if isinstance(config, Mapping) else config
        self.config = study_config.load(config)
        self.parameters = StiffnessInputs.from_config(self.config)
        self.channels = Channels.from_config(self.config)
        self.physics = physics_of(self.config)
        self.files = Layout(str(folder)) if folder else Layout.of(self.config["study"])

    def make_heart(self) -> Path:
        """Mesh the heart; the mesh's file (.vtu, opens in ParaView)."""
        return make_heart(self.config, self.files.heart())

    def simulate(self) -> pd.DataFrame:
        """Simulate the training design from the heart; the simulations that converged.

        A row each: theta (named as `parameters.names`), the channels (`channels.names`), the
        `sensitivity` d(channels)/d(theta) and what it took.
        """
        files, mesh, physics = self.files, self.files.heart().mesh, self.physics
        design = make_design(self.config["design"], self.parameters, self.config["seed"])["train"]
        points = made(files.design("train"))
        design.to_parquet(points, index=False)
        start = made(files.baseline("npz"))
        solve_baseline(mesh, physics, start, files.baseline("json"))
        anchors = made(files.anchors("0000", "npz"))
        count = min(self.config["simulations"]["anchors"], len(design))
        solved = files.anchors("0000", "parquet")
        solve_anchors(mesh, start, points, physics, count, 1, "0000", anchors, solved)
        fit_predictor([anchors], physics, files.predictor())
        batch = made(files.simulations("train", "0000"))
        simulate_batch(
            mesh, files.predictor(), points, physics, len(design), "0000", "train", batch, [solved]
        )
        kept = made(files.screened("train"))
        screen_simulations(
            [batch],
            self.parameters,
            self.channels,
            kept,
            files.excluded("train"),
            files.screening_summary("train"),
        )
        return pd.read_parquet(kept)

    def outputs(self, **theta: float) -> pd.Series:
        """The channels of one heart by the full simulator, after `simulate`.

        theta: parameters by name; those that are not given are 1. Raises InputError for a name that
        there is not, and ArithmeticError for a heart that cannot be inflated.
        """
        for name in theta:
            check_name("theta", name, self.parameters.names)
        runner = make_runner(
            self.files.heart().mesh, self.physics, self.files.predictor(), sensitivities=False
        )
        result = runner.run(self.parameters.vector(theta))
        if result.status != "converged":
            raise ArithmeticError(result.reason)
        return pd.Series(result.observables, index=list(self.channels.names))

    def train(self, name: str = "gradient_gp") -> Emulator:
        """Train the emulator `name` on the simulations, with the configuration's settings.

        Raises InputError for one that there is not, and for one of a plugin that `emulators.names`
        lacks.
        """
        settings = self.config["emulators"]
        check_name("emulators.names", name, [each for each in REGISTRY if each in settings])
        file = made(self.files.emulator(name))
        train_emulator(
            name,
            settings[name],
            self.files.screened("train"),
            self.parameters,
            self.channels,
            self.config["seed"],
            file,
            made(self.files.fit(name)),
        )
        return load(file)

    def infer(
        self, measured: str | Path, emulator: Emulator, subject: str = "subject"
    ) -> xr.DataTree:
        """The posterior of the stiffness given a measured file, in groups as ArviZ names them
        (`Averaged.to_datatree`).

        The file is imported first, as that of the configuration's subjects. The findings, a misfit
        test among them, are in `answers/<emulator>/<subject>/findings.json`. Raises InputError for
        a measured file that cannot be used.
        """
        files = AnswerFiles(f"{self.files.folder}/answers/{emulator.name}/{subject}")
        made(files.findings)
        criticise_by_emulator(
            files.findings,
            files.posterior,
            subject=subject,
            emulator_file=self.files.emulator(emulator.name),
            subjects=[subject],
            measured=[self._imported(measured, subject)],
            physics=sections_of_stiffness(self.config),
            settings=settings_of(self.config),
            seed=self.config["seed"],
        )
        return posteriors.load(files.posterior)

    def _imported(self, measured: str | Path, subject: str) -> str:
        """A measured file in the units used inside; what `measure` has written is it already."""
        imported = made(self.files.measured(subject))
        if Path(measured).resolve() != Path(imported).resolve():
            import_measured(
                measured,
                self.channels,
                self.config["loading"]["pressure_mmhg"],
                self.config["observables"]["strain_exponent"],
                self.parameters,
                imported,
            )
        return imported

    def measure(self, name: str) -> Path:
        """Simulate the entry `name` of `synthetic_subjects`, with its noise; the measured file.

        Raises InputError if there is no such entry, or if it cannot be inflated.
        """
        check_name("synthetic_subjects", name, self.config["synthetic_subjects"])
        entry = self.config["synthetic_subjects"][name]
        if entry["mesh"] == "finer":
            config = self.config | {"mesh": finer(self.config["mesh"])}
            files = self.files.heart("finer/")
            make_heart(config, files)
        else:
            files = self.files.heart()
        measured = made(self.files.measured(name))
        simulate_subject(
            name,
            entry,
            files.mesh,
            model_sections_of(self.config),
            seed=study_config.seed_of_subject(self.config, name),
            measured=measured,
            truth=made(self.files.truth(name)),
        )
        return Path(measured)


def check_name(key: str, name: str, known: Collection[str]) -> None:
    """Raise InputError for a name that is not among the `known` ones of a `key`."""
    for complaint in not_offered(key, [name], known):
        raise InputError(complaint)


def made(file: str) -> str:
    """The file, after its folder was made."""
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    return file
