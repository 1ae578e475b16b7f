"""Importance sampling of models with free effects beside the No-U-Turn Sampler of Pyro.

    python benchmarks/nuts_of_models.py CONFIG OUT.csv [COUNT]

CONFIG: of the benchmark of hidden effects (`config/hidden_effects.yaml`), of whose study hearts and
emulator are made; run it where its `results` lie. Of COUNT hearts with effects (20) the model with
exactly these free is sampled both ways: stiffness, effects and measured inputs, a few dozen
together. NUTS starts from Laplace's approximation, and knows nothing of the proposals of
importance sampling; its chains follow the density with the emulator's covariance at the fit, whose
gradient is at hand, and are weighted with what the covariance at each draw changes, as the
posterior has it.

OUT gets a row for each free input: means and standard deviations both ways, the difference of the
means in standard deviations, effective draws, and R-hat of the two chains. A heart that is there is
not sampled again. What comes last: the share of means within 0.1 sd, and differences in their Monte
Carlo errors.
"""

import sys
import time
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import pyro
import torch
from hidden_hearts import Heart, hearts_of, results_of
from pyro.infer import MCMC, NUTS

from regional_lv.hidden_effects.score import truth_of
from regional_lv.inference.drawing import ITERATIONS, LEAST_GAIN, sample
from regional_lv.inference.evidence import Fits, fit
from regional_lv.inference.potential import Potential
from regional_lv.inference.transform import BoundedTransform
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.seeds import derive

COUNT, DRAWS = 20, 4000
CHAINS, WARMUP, KEPT = 2, 100, 700
WITHIN_SD = 0.1
GROUPS = ("singles", "pairs", "triples")


def log_density(x: torch.Tensor, potential: Potential, error: torch.Tensor) -> torch.Tensor:
    """Of one point (P,) of a model, with the derivatives that the potential has."""
    at = x.detach()[None]
    found = potential.quadratic(*potential.linearise(at), at, error)
    return found.value[0] + found.gradient[0] @ (x - x.detach())


def by_nuts(potential: Potential, fitted: Fits, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Draws (C, N, P) of a model, and log weights (C, N)."""
    free = fitted.free[0]
    covariance = fitted.covariance[0][free][:, free]
    low, high = potential.low[free], potential.high[free]
    transform = BoundedTransform(low, high, covariance.diagonal().sqrt())
    inside = torch.minimum(torch.maximum(fitted.mean[0, free], low), high)
    centre, factor = transform.unconstrain(inside), torch.linalg.cholesky(covariance)

    def place(z):
        u = centre + factor @ z
        x = fitted.x[0].clone().masked_scatter(free, transform.constrain(u))
        return x, transform.log_slope(u).sum()

    def energy(at):
        x, slope = place(at["z"])
        return -log_density(x, potential, fitted.error) - slope

    chains = []
    for chain in range(CHAINS):
        kernel = NUTS(potential_fn=energy, full_mass=True, adapt_mass_matrix=False)
        pyro.set_rng_seed(derive(seed, chain))
        start = {"z": torch.randn(len(centre), dtype=centre.dtype)}
        mcmc = MCMC(kernel, KEPT, warmup_steps=WARMUP, initial_params=start, disable_progbar=True)
        with pyro.validation_enabled(False):
            mcmc.run()
        chains.append(torch.stack([place(z)[0] for z in mcmc.get_samples()["z"]]))
    x = torch.stack(chains)
    mean, own = potential.predict(x.flatten(0, 1), fitted.amplitude)
    logs = [potential.log_density(mean, x.flatten(0, 1), e) for e in (fitted.error, own)]
    return x, (logs[1] - logs[0]).reshape(x.shape[:2])


def fit_of(potential: Potential, values: Mapping[str, float]) -> Fits:
    """The model in which the suspected inputs are free that have other values than nominal ones."""
    _, x, on = truth_of(potential, values)
    zero = x.new_zeros(1)
    start = potential.free(on)[None], zero, x, potential.settle(x, zero)
    return fit(potential, *start, ITERATIONS, LEAST_GAIN)


def compare(potential: Potential, fitted: Fits, seed: int) -> pd.DataFrame:
    """Both samplers of one model: a row for each free input."""
    started = time.process_time()
    important = sample(potential, fitted, DRAWS, seed)
    middle = time.process_time()
    chains, log_weight = by_nuts(potential, fitted, seed)
    ended = time.process_time()
    weight = torch.softmax(log_weight.flatten(), 0)
    rows = []
    for k in torch.nonzero(fitted.free[0])[:, 0].tolist():
        row = {"input": potential.inputs.names[k], "role": potential.inputs.roles[k].kind}
        for name, values, w in (
            ("importance", important.x[:, k], important.weight),
            ("nuts", chains[..., k].flatten(), weight),
        ):
            row[f"mean_{name}"] = mean = float(w @ values)
            row[f"sd_{name}"] = float((w @ (values - mean).square()).sqrt())
        row["difference_sd"] = (row["mean_importance"] - row["mean_nuts"]) / row["sd_nuts"]
        row["ess_nuts"] = float(az.ess(chains[..., k].numpy()))
        row["rhat"] = float(az.rhat(chains[..., k].numpy()))
        rows.append(row)
    return pd.DataFrame(rows).assign(
        ess_importance=important.ess,
        pareto_k=important.pareto_k,
        ess_of_weights=float(1 / weight.square().sum()),
        seconds_importance=middle - started,
        seconds_nuts=ended - middle,
    )


def hearts_with_effects(path: str) -> Iterator[Heart]:
    for heart in hearts_of(path):
        if heart.truth["group"] in GROUPS and HeavyTails.name not in heart.truth["causes"]:
            yield heart


def main(path: str, out: str, count: str = str(COUNT)) -> None:
    tables = [pd.read_csv(out)] if Path(out).exists() else []
    done = set(tables[0]["subject"]) if tables else set()
    seed = results_of(path)[0]["seed"]
    for critic, _, values in islice(hearts_with_effects(path), int(count)):
        name = critic.name
        if name in done:
            continue
        potential = critic.potential(critic.emulator)
        table = compare(potential, fit_of(potential, values), derive(seed, "nuts", name))
        tables.append(table.assign(subject=name))
        pd.concat(tables).to_csv(out, index=False, float_format="%.6g")
        largest = table["difference_sd"].abs().max()
        print(f"{name}: {len(table)} means, the farthest {largest:.2f} sd apart", flush=True)
    table = pd.read_csv(out)
    off, subjects = table["difference_sd"].abs(), table["subject"].nunique()
    drawn = CHAINS * KEPT
    effective = table["ess_nuts"].clip(upper=drawn) * table["ess_of_weights"] / drawn
    expected = np.sqrt(1 / table["ess_importance"] + 1 / effective)
    print(
        f"{subjects} posteriors, {len(table)} means: {(off <= WITHIN_SD).mean():.1%} within "
        f"{WITHIN_SD} sd; differences are {np.sqrt(np.square(off / expected).mean()):.2f} times as "
        f"large as effective draws have it (root mean square), which is {expected.median():.3f} sd"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
