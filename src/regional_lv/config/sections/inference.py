"""Point estimates, posteriors, and how far both are checked."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from regional_lv.config.section import (
    ONCE,
    OTHER,
    TEXT_OR_ELSE,
    WORD,
    Count,
    Fraction,
    Natural,
    NonNegative,
    Note,
    Positive,
    Section,
    Whole,
)

WEIGHTED_SHARE = 0.6
"""Of the draws, how many may be asked to be effective. Importance sampling reaches two thirds if
all weights are the same (`paper.sampler.by_importance`), and they never quite are."""

Chains = Annotated[Whole, Field(ge=2)]
Draws = Annotated[Whole, Field(ge=10)]
Simulations = Annotated[Whole, Field(ge=3)]
Numbers = Annotated[list[Simulations], Field(min_length=1), ONCE]
OF_SUBJECTS = Note(reruns="posteriors of subjects")


class Map(Section, reruns="point estimates and everything after them"):
    """Point estimates by several starts from Sobol points."""

    starts: Count = 16
    """Starting points per case."""
    iterations: Count = 200
    """Iterations per start."""


class Estimates(Section, reruns="the point estimates of the test set and the ranking"):
    """Point estimates of the test set by every emulator, and their check."""

    adam_steps: Natural = 40
    """Steps of Adam from every start, before Levenberg-Marquardt (least squares)."""
    hops: Natural = 10
    """Basin hops from the best minimum of each case (least squares)."""
    checked_cases: Annotated[Count | None, Note(reruns="that check and the ranking")] = None
    """Test cases whose estimates go back through the simulator, in order (with source `table`:
    through a Gaussian process on all simulations); null: all."""
    both_transforms: Annotated[bool, Note(reruns="that table")] = False
    """Train every emulator on the other input transform, too, and tabulate what the transform alone
    does to its estimates; doubles the cost of training and estimates."""


class Efficiency(Section, reruns="the curves of sample efficiency"):
    """Error of the exact and the gradient-enhanced process against the number of simulations."""

    sizes: Numbers = [60, 100, 150, 300, 500, 1000, 2000]
    """Numbers of training simulations; numbers above that of the study are left out, and the number
    of all its training simulations is added."""
    most_with_sensitivities: Simulations = 300
    """Largest number for the process with sensitivities (one more rows of its matrix each than
    there are parameters)."""

    def check(self, key, study) -> Iterator[str]:
        least = study.least_simulations
        for name, size in {
            "sizes": min(self.sizes),
            "most_with_sensitivities": self.most_with_sensitivities,
        }.items():
            if size < least:
                yield (
                    f"{key}.{name}: {size} simulations are too few for any emulator; give {least} "
                    "or more"
                )


class Sampled(Section):
    """Chains of the No-U-Turn Sampler."""

    chains: int
    draws: int

    def check(self, key, study) -> Iterator[str]:
        least, chains, draws = study.nuts.ess_min, self.chains, self.draws
        reached = WEIGHTED_SHARE * chains * draws
        if least > reached:
            needed = math.ceil(least / WEIGHTED_SHARE / chains)
            yield (
                f"{key}.draws: {chains} chains of {draws} draws have up to {reached:.0f} effective "
                f"ones, fewer than nuts.ess_min ({least:g}): no posterior would pass the "
                f"convergence check; set {key}.draws to {needed} or more, or lower nuts.ess_min"
            )


class Nuts(Sampled, reruns="posteriors and everything after them"):
    """Posterior sampling by the No-U-Turn Sampler, and the convergence check it has to pass."""

    chains: Chains = 2
    """Chains per posterior."""
    warmup: Draws = 300
    """Warm-up draws per chain."""
    draws: Draws = 600
    """Kept draws per chain."""
    target_accept: Fraction = 0.8
    """Target acceptance probability."""
    max_tree_depth: Annotated[Whole, Field(ge=1, le=15)] = 10
    """Largest doubling of a trajectory."""
    rhat_max: Annotated[float, Field(gt=1)] = 1.01
    """Convergence check; largest R-hat of any parameter."""
    ess_min: NonNegative = 400.0
    """Convergence check; smallest effective sample size (bulk and tail) of any parameter."""
    cases_per_batch: Count = 60
    """Posteriors per job."""


class Clinical(Sampled, reruns="posteriors of subjects without `sd`"):
    """Posteriors of subjects by the emulator of the stiffness alone, made with `evaluation`; the
    noise of measured files without `sd` is inferred together with theta. `noise_prior_scale` is
    that of every answer, too."""

    chains: Annotated[Chains, OF_SUBJECTS] = 4
    """Chains per posterior. They take their steps together: four cost little more than two."""
    warmup: Annotated[Draws, OF_SUBJECTS] = 150
    """Warm-up draws per chain."""
    draws: Annotated[Draws, OF_SUBJECTS] = 1000
    """Kept draws per chain."""
    noise_prior_scale: Annotated[
        Positive,
        Note(reruns="answers and posteriors of subjects; only those without `sd` become others"),
    ] = 1.0
    """Scale of the half-normal prior on the noise of each quantity that is measured without `sd`
    (but the volume), in standard deviations of the outputs over the simulations. Of every answer,
    with and without `evaluation`."""
    noise_prior_scales: Annotated[list[Positive], ONCE] = [0.05, 0.1, 0.2, 0.5, 1.0]
    """Scales for which the posterior is sampled once more, to see what the choice of
    `noise_prior_scale` does."""


class Trust(Section, reruns="that check"):
    """How far the inference is checked."""

    agreement_cases: Count = 1
    """Random cases of every set that are sampled by Pyro NUTS too; of subjects, all."""
    calibration_cases: Annotated[Whole, Field(ge=2)] = 200
    """Draws from the prior whose posteriors' ranks are tested (simulation-based calibration of the
    final emulator)."""
    resimulated_cases: Count = 20
    """Test cases, evenly over the set, of which posterior draws are simulated."""
    resimulated_draws: Count = 5
    """Draws of each of them."""

    def check(self, key, study) -> Iterator[str]:
        kept = study.nuts.chains * study.nuts.draws
        if self.resimulated_draws > kept:
            yield (
                f"{key}.resimulated_draws: {self.resimulated_draws} of the {kept} draws of a "
                "posterior (nuts.chains times nuts.draws); lower it"
            )


class TestPosteriors(Section, reruns="posteriors of simulated cases and what summarises them"):
    """Posteriors of simulated cases, test set and scenarios."""

    cases: Annotated[
        Annotated[Literal["all"], WORD] | Annotated[Count, OTHER],
        TEXT_OR_ELSE,
        Note(remedy="give a whole number above zero, or `all`"),
    ] = "all"
    """Number of test cases that get a posterior, in order, or `all`."""
    sampler: Literal["importance", "nuts"] = "importance"
    """`importance`: adaptive importance sampling, and Pyro's NUTS for what does not pass the
    convergence check; `nuts`: Pyro's NUTS for all. Of subjects too."""

    def check(self, key, study) -> Iterator[str]:
        available = study.sizes["test"]
        if self.cases != "all" and self.cases > available:
            yield (
                f"{key}.cases: {self.cases} posteriors on {available} test cases (design.test, or "
                "the test table); lower it, or write `all`"
            )
