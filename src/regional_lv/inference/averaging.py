"""The answer averaged over models: probabilities, weighted draws, and tables of the inputs.

The models that matter are sampled, which gives their evidence as well. What sampling finds and
Laplace's approximation misses is much the same in all models, so that the others get it in the
mean; their draws are those of the normal distribution that resembles them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
import torch
import xarray as xr

from regional_lv.inference import importance
from regional_lv.inference.drawing import WeightedDraws, approximate, fit_to_the_end, sample
from regional_lv.inference.evidence import Fits
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import Candidate, Prior, fit_base, search
from regional_lv.seeds import derive

SHARE, MOST = 0.999, 200
"""Of the probability: what models hold of which there are draws, and how many these are at most."""

LEAST_PROBABILITY = 0.05
"""Of a model that is sampled, simulated and tested; the model as it is always is sampled."""

DRAWS, LEAST_DRAWS = 2000, 500
"""Of a round of sampling: for all of the probability, and of one model at least."""

APPROXIMATED = 250
"""Draws of a model that is not sampled."""

RESAMPLED, LEVELS = 4000, (0.025, 0.975)
"""Equally weighted draws of which tables are made, and the ends of their intervals."""


@dataclass(frozen=True)
class Averaged:
    """Models, the most probable first, and their probabilities (L,); the prior of their sets."""

    potential: Potential
    models: tuple[Candidate, ...]
    prior: Prior

    @cached_property
    def probability(self) -> np.ndarray:
        return _probabilities(self.models)

    @cached_property
    def drawn(self) -> dict[int, WeightedDraws]:
        """Draws of the models that have some, by their number."""
        return {n: m.drawn for n, m in enumerate(self.models) if m.drawn is not None}

    @cached_property
    def leading(self) -> list[int]:
        """Numbers of the models with draws that are probable (`LEAST_PROBABILITY`), or of all with
        draws where none is: the data leave many."""
        probable = [n for n in self.drawn if self.probability[n] >= LEAST_PROBABILITY]
        return probable or [*self.drawn]

    @cached_property
    def base(self) -> int:
        """Number of the model as it is."""
        return next(n for n, model in enumerate(self.models) if not model.departs)

    @property
    def names(self) -> list[str]:
        """Of the models: their inputs; `as it is`; `departure` and its amplitude."""
        return [self._name(model) for model in self.models]

    def _name(self, model: Candidate) -> str:
        if model.amplitude:
            return f"departure {model.amplitude:g}"
        names = [self.potential.inputs.names[k] for k in model.members]
        return " + ".join(names) or "as it is"

    @property
    def departure_probability(self) -> float:
        """Of a smooth departure of unknown shape."""
        return self._total(lambda model: model.amplitude > 0)

    def probability_of(self, k: int) -> float:
        """That the suspected input at place k is free."""
        return self._total(lambda model: k in model.members)

    def probability_of_cause(self, name: str) -> float:
        """That any input of a suspected cause is free."""
        places = set(self.potential.causes[name])
        return self._total(lambda model: places & set(model.members))

    def most_probable_of(self, name: str) -> int:
        """Which suspected input a cause is most probably, by its place among all inputs."""
        return max(self.potential.causes[name], key=self.probability_of)

    def values_where_free(self, k: int) -> np.ndarray | None:
        """Equally weighted draws (N,) of an input, in its unit, over the models in which it is
        free; None where there are no draws of any."""
        free = [n for n in self.drawn if k in self.models[n].members]
        return self._natural(self._draw(free, RESAMPLED)[0])[:, k] if free else None

    def noise_medians(self, numbers: Sequence[int] | None = None) -> dict[str, float]:
        """Median by quantity of the scales of the noise that are inferred, over some models or
        all."""
        x, _ = self._draw(numbers or [*self.drawn], RESAMPLED)
        scales = x[:, len(self.potential.inputs) :].exp().median(0).values.tolist()
        return dict(zip(self.potential.noise.groups, scales, strict=True))

    @property
    def ess(self) -> float:
        """Effective draws of the models with draws together, each as probable as it is."""
        share = _probabilities([self.models[n] for n in self.drawn])
        return float(1 / (share**2 / [d.ess for d in self.drawn.values()]).sum())

    @property
    def poor(self) -> bool:
        """Whether the most probable model has no reliable draws."""
        first = self.drawn.get(0)
        return first is None or not first.reliable

    def _total(self, counts) -> float:
        return float(self.probability[[bool(counts(model)) for model in self.models]].sum())

    def _draw(self, numbers: Sequence[int], count: int, generator=None):
        """Equally weighted draws x (count, P) of some models together, and of which each is."""
        parts = [self.drawn[n] for n in numbers]
        shares = _probabilities([self.models[n] for n in numbers])
        weight = torch.cat([p * part.weight for p, part in zip(shares, parts, strict=True)])
        kept = importance.resample(weight, count, generator)
        owner = np.repeat(np.array(numbers), [len(part.x) for part in parts])
        return torch.cat([part.x for part in parts])[kept], owner[kept.numpy()]

    def _natural(self, x: torch.Tensor) -> np.ndarray:
        """Values (N, K) of the inputs in their units."""
        columns = zip(self.potential.inputs, x.unbind(1), strict=False)
        return torch.stack([each.scale.inverse(column) for each, column in columns], 1).numpy()

    # ------------------------------------------------------------------------------- summaries

    def table(self) -> pd.DataFrame:
        """By input: role, unit; mean, sd, lower95 and upper95 (central) averaged over models; the
        same of the model as it is (`as_is_mean`, ...); and of suspected inputs the probability that
        they are free, and the same of the models in which they are (`free_mean`, ...; NaN where
        there are no draws of any)."""
        inputs = self.potential.inputs
        table = pd.DataFrame(
            {"role": [role.kind for role in inputs.roles], "unit": [each.unit for each in inputs]},
            index=pd.Index(inputs.names, name="input"),
        )
        table = table.join(self._summary([*self.drawn]))
        table = table.join(self._summary([self.base]).add_prefix("as_is_"))
        table["probability"] = np.nan
        for k in self.potential.suspected:
            name = inputs.names[k]
            table.loc[name, "probability"] = self.probability_of(k)
            free = [n for n in self.drawn if k in self.models[n].members]
            for column, value in self._summary(free).loc[name].items() if free else ():
                table.loc[name, f"free_{column}"] = value
        return table

    def _summary(self, numbers: Sequence[int]) -> pd.DataFrame:
        values = self._natural(self._draw(numbers, RESAMPLED)[0])
        low, high = np.quantile(values, LEVELS, axis=0)
        columns = {"mean": values.mean(0), "sd": values.std(0), "lower95": low, "upper95": high}
        return pd.DataFrame(columns, index=pd.Index(self.potential.inputs.names, name="input"))

    def to_datatree(self, draws: int, seed: int) -> xr.DataTree:
        """`draws` equally weighted draws of the average, in random order, in groups as ArviZ names
        them.

        posterior: value (chain, draw, input), in the units of the inputs; sigma (chain, draw,
        quantity), scales of the noise where they are inferred; model_number (chain, draw).
        posterior_predictive: y (chain, draw, output), observed_data: y (output). sample_stats of
        the models (model,): probability, log_evidence, log_prior, evidence_error, ess, pareto_k
        (NaN of those without draws), free (model, input) and holds (model, cause). constant_data:
        lower and upper (input), the ranges, and prior_probability (cause), 0 of causes that were
        not searched. as_it_is and as_it_is_predictive: as the first two groups, of the model as it
        is.
        """
        generator = torch.Generator().manual_seed(derive(seed, "average"))
        posterior, predictive = self._groups([*self.drawn], draws, generator)
        as_it_is, by_base = self._groups([self.base], draws, generator)
        names = list(self.potential.observed.names)
        observed = xr.Dataset({"y": ("output", self.potential.y.numpy())}, coords={"output": names})
        groups = {
            "posterior": posterior,
            "posterior_predictive": predictive,
            "sample_stats": self._statistics(),
            "constant_data": self._known(),
            "observed_data": observed,
            "as_it_is": as_it_is,
            "as_it_is_predictive": by_base,
        }
        return xr.DataTree.from_dict(groups)

    def _groups(self, numbers: Sequence[int], draws: int, generator) -> tuple:
        """Draws of some models, and what they predict."""
        x, number = self._draw(numbers, draws, generator)
        order = torch.randperm(draws, generator=generator)
        x, number = x[order], number[order.numpy()]
        inputs, groups = self.potential.inputs, list(self.potential.noise.groups)
        each = ("chain", "draw")
        columns = {
            "value": ((*each, "input"), self._natural(x)[None]),
            "model_number": (each, number[None]),
        }
        coordinates = {"chain": [0], "draw": np.arange(draws), "input": list(inputs.names)}
        if groups:
            columns["sigma"] = ((*each, "quantity"), x[:, len(inputs) :].exp().numpy()[None])
            coordinates["quantity"] = groups
        amplitude = x.new_tensor([self.models[n].amplitude for n in number])
        y = self.potential.replicates(x, amplitude, generator).numpy()[None]
        outputs = {k: coordinates[k] for k in each}
        outputs["output"] = list(self.potential.observed.names)
        predictive = xr.Dataset({"y": ((*each, "output"), y)}, coords=outputs)
        return xr.Dataset(columns, coords=coordinates), predictive

    def _statistics(self) -> xr.Dataset:
        names = self.potential.inputs.names
        free = torch.stack([self.potential.free(model.members) for model in self.models])
        causes = self.potential.causes
        holds = np.array(
            [[bool({*p} & {*m.members}) for p in causes.values()] for m in self.models], dtype=bool
        )
        statistics = xr.Dataset(
            {
                "probability": ("model", self.probability),
                "log_evidence": ("model", [model.log_evidence for model in self.models]),
                "log_prior": ("model", [model.log_prior for model in self.models]),
                "free": (("model", "input"), free[:, : len(names)].numpy()),
                "holds": (("model", "cause"), holds.reshape(len(holds), len(causes))),
            },
            coords={"model": self.names, "input": list(names), "cause": list(causes)},
        )
        for key in ("evidence_error", "ess", "pareto_k"):
            values = [getattr(model.drawn, key, np.nan) for model in self.models]
            statistics[key] = ("model", values)
        return statistics

    def _known(self) -> xr.Dataset:
        """What was assumed of the inputs and causes."""
        inputs, causes = self.potential.inputs, list(self.potential.causes)
        return xr.Dataset(
            {
                "lower": ("input", inputs.lower),
                "upper": ("input", inputs.upper),
                "prior_probability": ("cause", [self.prior.of_cause(name) for name in causes]),
            },
            coords={"input": list(inputs.names), "cause": causes},
        )


def average(
    potential: Potential, largest: int, seed: int, draws: int = DRAWS, base: Fits | None = None
) -> Averaged:
    """The posterior averaged over all sets of suspected inputs up to the `largest`, the model as it
    is and a smooth departure.

    draws: of a round of importance sampling of a model that is certain; others have their share of
    them. base: the model as it is, if it is fitted already (`sets.fit_base`). The same seed gives
    the same answer.
    """
    models = search(potential, largest, fit_base(potential, seed) if base is None else base)
    probability, total, known = _probabilities(models), 0.0, 0
    for n, model in enumerate(models):
        counts = (total < SHARE and known < MOST) or not model.departs
        if counts and model.fit is not None:
            own = derive(seed, "model", *model.members, model.amplitude)
            if probability[n] < LEAST_PROBABILITY and model.departs:
                approximated = approximate(potential, model.fit, APPROXIMATED, own)
                models[n] = replace(model, drawn=approximated)
            else:
                fitted = fit_to_the_end(potential, model.fit)
                count = max(round(draws * probability[n]), min(LEAST_DRAWS, draws))
                evidence, drawn = float(fitted.log_evidence), sample(potential, fitted, count, own)
                models[n] = replace(model, fit=fitted, log_evidence=evidence, drawn=drawn)
            known += 1
        total += probability[n]
    ranked = sorted(_by_sampling(models), key=lambda m: -m.log_posterior)
    return Averaged(potential, tuple(ranked), Prior.of(potential, largest))


def _by_sampling(models: Sequence[Candidate]) -> list[Candidate]:
    """With the evidence of sampling, or with what it changes in others, in the mean."""
    found = {n: m.drawn.log_evidence for n, m in enumerate(models) if m.drawn and m.drawn.reliable}
    if not found:
        return list(models)
    missed = [evidence - models[n].log_evidence for n, evidence in found.items()]
    shift = float(np.average(missed, weights=_probabilities(models)[[*found]] + 1e-300))
    return [
        replace(model, log_evidence=found.get(n, model.log_evidence + shift))
        for n, model in enumerate(models)
    ]


def _probabilities(models: Sequence[Candidate]) -> np.ndarray:
    logs = torch.tensor([model.log_posterior for model in models], dtype=torch.float64)
    return torch.softmax(logs, 0).numpy()
