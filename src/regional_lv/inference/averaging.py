"""The answer averaged over models: probabilities, weighted draws, and tables of the inputs.

The models that count are sampled by importance from the normal distribution that resembles them
(`importance.sample`), which gives their evidence as well. What sampling finds and Laplace's
approximation misses is much the same in all models, so that the others get it in the mean.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import arviz as az
import numpy as np
import pandas as pd
import torch
import xarray as xr

from regional_lv.inference import importance
from regional_lv.inference.evidence import Fits, fit
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import Candidate, search
from regional_lv.inference.transform import BoundedTransform
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

SHARE, MOST = 0.999, 40
"""Of the probability, that models hold which are sampled; and how many are, at most."""

ROUNDS, MOST_ROUNDS = 4, 8
"""Of importance sampling: rounds of proposals of one distribution, and rounds at most."""

DRAWS, LEAST_DRAWS, LEAST_DRAWS_AS_IS = 4000, 250, 1000
"""Of a round of a model, for all of the probability; and at least."""

EFFICIENCY = 0.25
"""Effective draws that suffice, as a share of those of a round: a normal posterior in thirty
dimensions has 0.3, in ten 0.6."""

SPREAD = 1.2
"""Of the covariance of the first proposal over that of the posterior as it is expected."""

LARGEST_SD = 0.4
"""Of a proposal, as a share of the range: a uniform density has 0.29."""

LEAST_ESS, LARGEST_SHAPE = 50.0, 0.7
"""Effective draws, and shape of the weights' tail (Vehtari et al. 2024, arXiv:1507.02646), with
which an evidence by sampling counts."""

ITERATIONS, LEAST_GAIN = 60, 1e-7
"""Of the fit of a model that is sampled."""

RESAMPLED, LEVELS = 4000, (0.025, 0.975)
"""Equally weighted draws of which tables are made, and the ends of their intervals."""


@dataclass(frozen=True)
class Sampled:
    """Weighted draws of one model: coordinates x (N, P), normalised Pareto-smoothed `weight` (N,);
    log evidence and its standard error, effective sample size, and shape of the weights' tail (NaN
    where these are even)."""

    x: torch.Tensor
    weight: torch.Tensor
    log_evidence: float
    evidence_error: float
    ess: float
    pareto_k: float

    @property
    def reliable(self) -> bool:
        """Whether its evidence counts."""
        return self.ess >= LEAST_ESS and not self.pareto_k > LARGEST_SHAPE


@dataclass(frozen=True)
class Averaged:
    """Models, the most probable first, their probabilities (L,), and the draws of those that count
    by their number."""

    potential: Potential
    candidates: tuple[Candidate, ...]
    probability: np.ndarray
    sampled: dict[int, Sampled]

    @cached_property
    def base(self) -> int:
        """Number of the model as it is."""
        return next(n for n, c in enumerate(self.candidates) if not c.departs)

    @property
    def names(self) -> list[str]:
        """Of the models: their inputs; `as it is`; `departure` and its amplitude."""
        return [self._name(c) for c in self.candidates]

    def _name(self, candidate: Candidate) -> str:
        if candidate.amplitude:
            return f"departure {candidate.amplitude:g}"
        names = [self.potential.inputs.names[k] for k in candidate.members]
        return " + ".join(names) or "as it is"

    @property
    def departure_probability(self) -> float:
        """Of a smooth departure of unknown shape."""
        return float(sum(self.probability[n] for n, c in enumerate(self.candidates) if c.amplitude))

    def probability_of(self, k: int) -> float:
        """That the suspected input at place k is free."""
        return float(
            sum(p for p, c in zip(self.probability, self.candidates, strict=True) if k in c.members)
        )

    def weighted(self, numbers: Sequence[int]) -> tuple[torch.Tensor, torch.Tensor]:
        """Draws x (N, P) of some models that were sampled and their normalised weights (N,)."""
        weight = torch.cat([float(self.probability[n]) * self.sampled[n].weight for n in numbers])
        return torch.cat([self.sampled[n].x for n in numbers]), weight / weight.sum()

    def natural(self, x: torch.Tensor) -> np.ndarray:
        """Values (N, K) of the inputs in their units."""
        columns = x[:, : len(self.potential.inputs)].unbind(1)
        scaled = zip(self.potential.inputs, columns, strict=True)
        return torch.stack([each.scale.inverse(column) for each, column in scaled], 1).numpy()

    # ------------------------------------------------------------------------------- summaries

    def table(self) -> pd.DataFrame:
        """By input: role, unit; mean, sd, lower95 and upper95 (central) averaged over models; the
        same of the model as it is (`as_is_mean`, ...); and of suspected inputs the probability that
        they are free, and the same of the models in which they are (`free_mean`, ...; NaN where
        none was sampled)."""
        inputs = self.potential.inputs
        table = pd.DataFrame(
            {"role": [role.kind for role in inputs.roles], "unit": [each.unit for each in inputs]},
            index=pd.Index(inputs.names, name="input"),
        )
        everything = [*self.sampled]
        columns = {
            "": self._summary(everything),
            "as_is_": self._summary([self.base]),
        }
        for prefix, values in columns.items():
            table = table.join(values.add_prefix(prefix))
        table["probability"] = np.nan
        for k in self.potential.suspected:
            name = inputs.names[k]
            table.loc[name, "probability"] = self.probability_of(k)
            free = [n for n in everything if k in self.candidates[n].members]
            if free:
                for column, value in self._summary(free).loc[name].items():
                    table.loc[name, f"free_{column}"] = value
        return table

    def _summary(self, numbers: Sequence[int]) -> pd.DataFrame:
        x, weight = self.weighted(numbers)
        values = self.natural(x[importance.resample(weight, RESAMPLED)])
        low, high = np.quantile(values, LEVELS, axis=0)
        columns = {"mean": values.mean(0), "sd": values.std(0), "lower95": low, "upper95": high}
        return pd.DataFrame(columns, index=pd.Index(self.potential.inputs.names, name="input"))

    def inference_data(self, draws: int, seed: int) -> az.InferenceData:
        """`draws` equally weighted draws of the average, in random order, as ArviZ has them.

        posterior: value (chain, draw, input), in the units of the inputs; sigma (chain, draw,
        quantity), scales of the noise where they are inferred; model_number (chain, draw).
        sample_stats of the models (model,): probability, log_evidence, evidence_error, ess,
        pareto_k (NaN of those that were not sampled), and free (model, input).
        """
        generator = torch.Generator().manual_seed(derive(seed, "average"))
        numbers = [*self.sampled]
        share = torch.as_tensor(self.probability[numbers])
        counts = torch.bincount(
            importance.resample(share / share.sum(), draws, generator), minlength=len(numbers)
        )
        x, model = [], []
        for n, count in zip(numbers, counts.tolist(), strict=True):
            one = self.sampled[n]
            x.append(one.x[importance.resample(one.weight, count, generator)])
            model += [n] * count
        order = torch.randperm(draws, generator=generator)
        together, inputs = torch.cat(x)[order], self.potential.inputs
        posterior = xr.Dataset(
            {
                "value": (("chain", "draw", "input"), self.natural(together)[None]),
                "model_number": (("chain", "draw"), np.array(model)[order.numpy()][None]),
            },
            coords={"chain": [0], "draw": np.arange(draws), "input": list(inputs.names)},
        )
        groups = list(self.potential.noise.groups)
        if groups:
            sigma = together[:, len(inputs) :].exp().numpy()
            posterior = posterior.assign_coords(quantity=groups)
            posterior["sigma"] = (("chain", "draw", "quantity"), sigma[None])
        return az.InferenceData(posterior=posterior, sample_stats=self._statistics())

    def _statistics(self) -> xr.Dataset:
        free = np.zeros((len(self.candidates), len(self.potential.inputs)), dtype=bool)
        for n, candidate in enumerate(self.candidates):
            free[n] = self.potential.free(candidate.members)[: free.shape[1]].numpy()
        columns: dict = {
            "probability": ("model", self.probability),
            "free": (("model", "input"), free),
        }
        columns["log_evidence"] = ("model", np.array([c.log_evidence for c in self.candidates]))
        for key in ("evidence_error", "ess", "pareto_k"):
            values = np.full(len(self.candidates), np.nan)
            for n, one in self.sampled.items():
                values[n] = getattr(one, key)
            columns[key] = ("model", values)
        names = {"model": self.names, "input": list(self.potential.inputs.names)}
        return xr.Dataset(columns, coords=names)


def average(potential: Potential, largest: int, seed: int, draws: int = DRAWS) -> Averaged:
    """The posterior averaged over all sets of suspected inputs up to the `largest`, the model as it
    is and a smooth departure.

    draws: of a round of importance sampling of a model that is certain; others have their share of
    them. The same seed gives the same answer.
    """
    candidates = search(potential, largest, seed)
    probability = _probabilities(candidates)
    counting = _counting(candidates, probability)
    sampled: dict[int, Sampled] = {}
    fits = _settled(potential, [candidates[n] for n in counting])
    for n, settled in zip(counting, fits, strict=True):
        candidate = candidates[n]
        candidates[n] = replace(candidate, fit=settled, log_evidence=float(settled.log_evidence))
        names = (*candidate.members, candidate.amplitude)
        least = LEAST_DRAWS if candidate.departs else LEAST_DRAWS_AS_IS
        own = max(round(draws * probability[n]), min(least, draws))
        sampled[n] = sample(potential, settled, own, derive(seed, "model", *names))
    reliable = {n: s for n, s in sampled.items() if s.reliable}
    if reliable:
        weight = probability[[*reliable]]
        missed = [s.log_evidence - candidates[n].log_evidence for n, s in reliable.items()]
        shift = float(np.average(missed, weights=weight + 1e-300))
        for n, candidate in enumerate(candidates):
            known = reliable[n].log_evidence if n in reliable else candidate.log_evidence + shift
            candidates[n] = replace(candidate, log_evidence=known)
    order = sorted(range(len(candidates)), key=lambda n: -candidates[n].log_posterior)
    ranked = [candidates[n] for n in order]
    place = {n: at for at, n in enumerate(order)}
    numbered = {place[n]: one for n, one in sampled.items()}
    return Averaged(
        potential, tuple(ranked), _probabilities(ranked), dict(sorted(numbered.items()))
    )


def _probabilities(candidates: Sequence[Candidate]) -> np.ndarray:
    logs = torch.tensor([c.log_posterior for c in candidates], dtype=torch.float64)
    return torch.softmax(logs, 0).numpy()


def _counting(candidates: Sequence[Candidate], probability: np.ndarray) -> list[int]:
    """Numbers of the models that are sampled: of those that were fitted the fewest that hold
    `SHARE` of the probability, and the model as it is."""
    total, chosen = 0.0, []
    for n, candidate in enumerate(candidates):
        counts = total < SHARE and len(chosen) < MOST and candidate.fit is not None
        if counts or not candidate.departs:
            chosen.append(n)
        total += probability[n]
    return chosen


def _settled(potential: Potential, candidates: Sequence[Candidate]) -> list[Fits]:
    """Their fits to the end, with the emulator's covariance there."""
    old = Fits.join([candidate.fit for candidate in candidates if candidate.fit is not None])
    fits = fit(potential, old.free, old.amplitude, old.x, old.error, ITERATIONS, LEAST_GAIN)
    return [fits.row(m) for m in range(len(fits))]


def sample(potential: Potential, fitted: Fits, draws: int, seed: int) -> Sampled:
    """Sample one model (M = 1) by importance, `draws` a round."""
    free = fitted.free[0]
    low, high = potential.low[free], potential.high[free]
    covariance = fitted.covariance[0][free][:, free]
    transform = BoundedTransform(low, high, covariance.diagonal().sqrt())
    uniform = float(potential.log_uniform(fitted.free))

    def whole(u):
        x = fitted.x.repeat(len(u), 1)
        x[:, free] = transform.inside(u)
        return x

    def log_density(u):
        x = whole(u)
        value = potential.log_density(potential.mean(x), x, fitted.error)
        return value + uniform + transform.log_slope(u).sum(-1)

    found = importance.sample(
        log_density,
        fitted.mean[0][free],  # an sd from any end, where the transform changes little
        SPREAD * covariance,
        draws,
        torch.Generator().manual_seed(seed),
        rounds=ROUNDS,
        most_rounds=MOST_ROUNDS,
        least_ess=EFFICIENCY * draws,
        largest_sd=LARGEST_SD * (high - low),
    )
    log_weight, k = importance.smooth(found.log_weight)
    weight = torch.softmax(log_weight, 0)
    return Sampled(
        *(whole(found.u), weight, found.log_evidence, found.evidence_error),
        *(importance.effective(weight), k),
    )
