"""What a finer mesh changes of the base model: the discretisation error of the study's mesh.

The simulator on the study's mesh differs from the heart by more than what is wrong with its model.
That part can be computed: some simulations are made again on a finer mesh, and the differences are
emulated like those of a hypothesis. They are no cause that a criticism could name; they correct the
base model before it is criticised.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.criticism.differences import Scale
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import HELD_OUT, Extension, learn
from regional_lv.criticism.hypotheses import SimulatorHypothesis
from regional_lv.emulators.base import Emulator, Prediction
from regional_lv.errors import InputError
from regional_lv.parameters import Parameterisation
from regional_lv.seeds import derive


class FinerMesh(SimulatorHypothesis):
    """The finer mesh (1) in place of the study's (0). In no catalogue."""

    name = "finer_mesh"
    base, low, high = 0.0, 0.0, 1.0
    nodes = (1.0,)
    slope_at_base = False


class OnFinerMesh:
    """An emulator of the study's mesh, `study`, with what a finer mesh changes.

    It predicts as the emulator does; all else is the emulator's own.
    """

    def __init__(self, study: Emulator, difference: Extension):
        self.study, self._difference = study, difference
        self._both = ExtendedEmulator(study, [difference])

    def __getattr__(self, name: str):
        return getattr(self.study, name)

    def select(self, outputs: Sequence[str]) -> "OnFinerMesh":
        """The same for some of the outputs, in the order given."""
        return OnFinerMesh(self.study.select(outputs), self._difference.select(outputs))

    def predict(self, theta: torch.Tensor) -> Prediction:
        """Predict at `theta` (..., P); with the covariance of the differences."""
        return self._both.predict(theta, _finer(theta))

    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor:
        """Predictive mean (..., D) alone."""
        return self._both.mean(theta, _finer(theta))

    def linearise(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (..., D) and d(mean)/d(theta) (..., D, P), without a graph."""
        mean, by_log_theta, _ = self._both.linearise(theta, _finer(theta))
        return mean, by_log_theta / theta[..., None, :]


def _finer(theta: torch.Tensor) -> torch.Tensor:
    return torch.ones(*theta.shape[:-1], 1, dtype=theta.dtype)


def load_emulator(
    emulator: str | Path, discretisation: str | Path | Sequence[str] = ()
) -> Emulator:
    """The emulator of a file, corrected by the file of `train_discretisation` if there is one."""
    trained = emulators.load(emulator)
    if not discretisation:
        return trained
    state = torch.load(discretisation, weights_only=True)
    corrected = OnFinerMesh(trained, Extension.from_state(discretisation, state, FinerMesh()))
    return cast(Emulator, corrected)  # what it has not itself, its `__getattr__` hands on


def train_discretisation(
    train: str | Path,
    batches: Sequence[str | Path],
    physics: Mapping,
    parameters: Parameterisation,
    channels: Channels,
    seed: int,
    discretisation: str | Path,
    report: str | Path,
) -> None:
    """Learn what a finer mesh changes; write it and a report (JSON), as of an extension.

    train: the study's screened simulations. batches: some of them made again on the finer mesh
    (`simulations.solve_anchors`). seed: the study's.

    Raises InputError if too few converged on both meshes.
    """
    coarse = pd.read_parquet(train)
    fine = pd.concat([pd.read_parquet(batch) for batch in batches], ignore_index=True)
    fine = fine[fine["sample"].isin(coarse["sample"])]
    fewest = max(len(parameters) + 2, HELD_OUT)
    if (fine["status"] == "converged").sum() < fewest:
        raise InputError(
            f"{train}: fewer than {fewest} simulations converged on the finer mesh, "
            "too few to learn from; raise criticism.discretisation, or set it to 0"
        )
    coarse = coarse[coarse["sample"].isin(fine["sample"])].assign(psi=0.0)
    rows = pd.concat([coarse, fine.assign(psi=1.0)], ignore_index=True)
    rows = rows.assign(anchor=rows["sample"].astype(str), component="")
    scale = Scale(channels, float(physics["observables"]["strain_exponent"]))
    own = derive(seed, "discretisation")
    learnt, found = learn(FinerMesh(), "", rows, scale, parameters, own)
    torch.save(learnt.state(), discretisation)
    Path(report).write_text(json.dumps(found, indent=2) + "\n")
