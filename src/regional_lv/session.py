"""A study in Python: the functions and the files of the workflow's rules, called from a session.

    from regional_lv.session import Study

    study = Study("config/quick.yaml")
    study.make_heart()
    simulations = study.simulate()
    emulator = study.train("gradient_gp")
    posterior = study.infer("measured.csv", emulator)

Files lie where the workflow puts them, so that either can go on with what the other made.
"""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.emulators import load
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.training import train_emulator
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.mesh_config import finer
from regional_lv.inference import posteriors
from regional_lv.inference.sampling import sample_subject
from regional_lv.inputs.physics import physics_of
from regional_lv.inputs.space import model_sections_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.predictor import fit_predictor
from regional_lv.seeds import derive
from regional_lv.simulation.batches import (
    make_runner,
    simulate_batch,
    solve_anchors,
    solve_baseline,
)
from regional_lv.simulation.screening import screen_simulations
from regional_lv.simulation.sobol import make_design
from regional_lv.simulation.subjects import simulate_subject

PREDICTOR = "mechanics/predictor.npz"


class Study:
    """One heart, its simulations, emulators and posteriors.

    Attributes: config (checked, complete), parameters, channels, physics (what simulations depend
    on), folder.

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
        self.folder = Path(folder or Path("results") / self.config["study"])

    def _file(self, path: str) -> Path:
        (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
        return self.folder / path

    def make_heart(self) -> Path:
        """Mesh the heart; the mesh's file (.vtu, opens in ParaView)."""
        return make_heart(self.config, self.folder / "geometry")

    def simulate(self) -> pd.DataFrame:
        """Simulate the training design from the heart; the simulations that converged.

        A row each: theta (named as `parameters.names`), the channels (`channels.names`), the
        `sensitivity` d(channels)/d(theta) and what it took.
        """
        mesh, physics = self._file("geometry/mesh.vtu"), self.physics
        design = make_design(self.config["design"], self.parameters, self.config["seed"])["train"]
        points = self._file("design/train.parquet")
        design.to_parquet(points, index=False)
        start = self._file("mechanics/baseline.npz")
        solve_baseline(mesh, physics, start, self._file("mechanics/baseline.json"))
        anchors = self._file("mechanics/anchors/batch-0000.npz")
        count = min(self.config["simulations"]["anchors"], len(design))
        solved = anchors.with_suffix(".parquet")
        solve_anchors(mesh, start, points, physics, count, 1, "0000", anchors, solved)
        predictor = self._file(PREDICTOR)
        fit_predictor([anchors], physics, predictor)
        batch = self._file("simulations/train/batch-0000.parquet")
        given = (mesh, predictor, points, physics, len(design), "0000", "train", batch)
        simulate_batch(*given, [solved])
        kept = self._file("screening/train.parquet")
        screen_simulations(
            [batch],
            self.parameters,
            self.channels,
            kept,
            self._file("screening/train_excluded.csv"),
            self._file("screening/train_summary.csv"),
        )
        return pd.read_parquet(kept)

    def outputs(self, **theta: float) -> pd.Series:
        """The channels of one heart by the full simulator, after `simulate`.

        theta: parameters by name; those that are not given are 1. Raises ArithmeticError for a
        heart that cannot be inflated.
        """
        runner = make_runner(
            self._file("geometry/mesh.vtu"),
            self.physics,
            self._file(PREDICTOR),
            sensitivities=False,
        )
        result = runner.run(self.parameters.vector(theta))
        if result.status != "converged":
            raise ArithmeticError(result.reason)
        return pd.Series(result.observables, index=list(self.channels.names))

    def train(self, name: str = "gradient_gp") -> Emulator:
        """Train the emulator `name` on the simulations, with the configuration's settings."""
        file = self._file(f"emulators/{name}.pt")
        train_emulator(
            name,
            self.config["emulators"][name],
            self._file("screening/train.parquet"),
            self.parameters,
            self.channels,
            self.config["seed"],
            file,
            self._file(f"emulators/{name}/fit.json"),
        )
        return load(file)

    def infer(
        self, measured: str | Path, emulator: Emulator, subject: str = "subject"
    ) -> xr.DataTree:
        """The posterior of theta given a measured file, in groups as ArviZ names them.

        Its diagnostics are in `posteriors/<emulator>/subjects/<subject>.csv`. Raises InputError for
        a measured file that cannot be used.
        """
        clinical, folder = self.config["clinical"], f"posteriors/{emulator.name}/subjects"
        nuts = self.config["nuts"] | {k: clinical[k] for k in ("chains", "warmup", "draws")}
        posterior = self._file(f"{folder}/{subject}.nc")
        sample_subject(
            self._file(f"emulators/{emulator.name}.pt"),
            measured,
            subject,
            self.config["test_posteriors"]["sampler"],
            nuts,
            self.config["map"],
            clinical["noise_prior_scale"],
            self.config["seed"],
            posterior,
            self._file(f"{folder}/{subject}.csv"),
        )
        return posteriors.load(posterior)

    def measure(self, name: str) -> Path:
        """Simulate the entry `name` of `synthetic_subjects`, with its noise; the measured file."""
        entry, seed = self.config["synthetic_subjects"][name], self.config["seed"]
        if entry["mesh"] == "finer":
            config = self.config | {"mesh": finer(self.config["mesh"])}
            mesh = make_heart(config, self.folder / "geometry" / "finer")
        else:
            mesh = self._file("geometry/mesh.vtu")
        measured = self._file(f"measured/{name}.csv")
        simulate_subject(
            name,
            entry,
            mesh,
            model_sections_of(self.config),
            seed=derive(seed, "subject", name) if entry["seed"] is None else entry["seed"],
            measured=measured,
            truth=self._file(f"truth/{name}.json"),
        )
        return measured
