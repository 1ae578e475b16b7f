"""Files of posteriors of the stiffness alone, read case by case."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from regional_lv.inference.posteriors import Groups, draws_by_name, load
from regional_lv.inputs.stiffness import StiffnessInputs


@dataclass(frozen=True)
class Posterior:
    """The posterior of one case, of the model as it is.

    groups: of its file, at this case; `sampling.to_datatree` says what they hold.
    """

    case: str
    groups: Groups

    @property
    def parameters(self) -> StiffnessInputs:
        return StiffnessInputs.from_spec(json.loads(self.groups["posterior"].attrs["parameters"]))

    @cached_property
    def theta(self) -> dict[str, np.ndarray]:
        """Draws (chain, draw) by parameter."""
        return draws_by_name(self.groups["posterior"], "theta", "parameter")

    @cached_property
    def sigma(self) -> dict[str, np.ndarray]:
        """Draws (chain, draw) of the inferred noise scales (training sd), `sigma_<quantity>`."""
        return draws_by_name(self.groups["posterior"], "sigma", "direction", "sigma_")

    @property
    def chains(self) -> np.ndarray:
        """Draws (chain, draw, P + G): theta, then sigma."""
        return np.stack([*self.theta.values(), *self.sigma.values()], axis=-1)

    @property
    def constant(self) -> xr.Dataset:
        return self.groups.get("constant_data", xr.Dataset())

    @property
    def maximum(self) -> dict[str, float]:
        """The MAP by parameter."""
        return self._by_parameter("theta_map")

    @property
    def truth(self) -> dict[str, float]:
        """By parameter; empty if unknown."""
        return self._by_parameter("theta_true") if "theta_true" in self.constant else {}

    @property
    def zone(self) -> str:
        """The stiffened one of a scenario, else empty."""
        return str(self.constant["zone"].item()) if "zone" in self.constant else ""

    @property
    def sampler(self) -> str:
        return str(self.constant["sampler"].item())

    def _by_parameter(self, variable: str) -> dict[str, float]:
        return dict(zip(self.theta, self.constant[variable].to_numpy().tolist(), strict=True))


def read(path: str | Path) -> list[Posterior]:
    """The cases of a file that `sampling` wrote."""
    return cases_of(load(path))


def cases_of(data: xr.DataTree) -> list[Posterior]:
    """The cases of what `sampling.to_datatree` makes."""
    groups = {name: part.to_dataset() for name, part in data.children.items()}
    return [
        Posterior(str(case), {name: part.isel(case=i) for name, part in groups.items()})
        for i, case in enumerate(groups["posterior"]["case"].to_numpy())
    ]
