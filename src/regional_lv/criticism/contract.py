"""What `findings.json` holds: the contract with everything that reads it.

A type checker holds writer and readers to it. None stands for what is no number, or was not found;
a float of `Misfit` or `Findings` is null in the file where too few channels were measured for a
test: its `families` are empty then.
"""

import json
from pathlib import Path
from typing import TypedDict


class Channel(TypedDict):
    """A measured channel and what the model predicts of it, left out; z is in predictive sds."""

    subject: str
    output: str
    quantity: str
    segment: int | None
    load_fraction: float
    observed: float
    predicted: float
    sd: float
    z: float


class Largest(TypedDict):
    """A departure that stands out in its family of tests."""

    family: str
    what: str
    z: float
    p_value: float


class Misfit(TypedDict):
    """Whether the model misses the measurements; `families`: a p-value for each kind of test."""

    detected: bool
    p_value: float
    families: dict[str, float]
    largest: list[Largest]
    channels: list[Channel]


class Histogram(TypedDict):
    """Edges (n + 1) and densities (n)."""

    edges: list[float]
    density: list[float]


class Cause(TypedDict):
    """A cause that was searched, whether or not it is named."""

    name: str
    component: str | None
    parameter: str
    description: str
    source: str
    base: float
    range: list[float]
    z: float
    p_value: float
    p_value_single: float
    probability: float
    component_probability: float
    estimate: float | None
    interval95: list[float]
    at_bound: bool
    unit: str
    identifiable: bool
    why: str
    absorbed: float
    sd: float | None
    fitted: bool
    fraction_simulated: float
    posterior: Histogram | None


class Set(TypedDict):
    """A set of causes; `fit`: of each, its most probable value."""

    causes: list[str]
    components: list[str]
    fit: list[float]
    probability: float
    log_evidence: float
    log_prior: float
    elpd_gain: float | None
    elpd_gain_se: float | None
    misfit_p_value: float | None
    confirmed: bool
    simulations: int
    difference_sd: float | None
    beyond_sd: dict[str, float] | None


class Difference(TypedDict):
    """Of a channel, what simulations of the best set differ by from the emulators."""

    subject: str
    output: str
    difference: float
    difference_sd: float


class Confirmation(TypedDict):
    """What simulations stand behind the answer, and what share of the probability has none."""

    simulations: int
    simulations_of_best: int
    largest_difference_sd: float | None
    probability_not_simulated: float
    probability_elsewhere: float
    probability_failed: float
    channels: list[Difference]


class Gain(TypedDict):
    """What the best set gains over the model as it is, each segment left out in turn."""

    elpd: float | None
    elpd_se: float | None
    elpd_se_folds: float | None
    elpd_before: float
    rmse_before: float | None
    rmse_after: float | None
    rmse_volume_ml_before: float | None
    rmse_volume_ml_after: float | None
    coverage_before: float
    coverage_after: float


class Moved(TypedDict):
    """Mean and sd of a factor before and after, and by how many sds its mean moves."""

    parameter: str
    before: list[float]
    after: list[float]
    shift_sd: float


class Noise(TypedDict):
    """Median of an inferred noise scale before and after, in training sd."""

    quantity: str
    before: float
    after: float


class Findings(TypedDict):
    """Of one subject, or of several together."""

    subject: str
    subjects: list[str]
    misfit: Misfit
    data_checks: list[dict]
    hypotheses: list[Cause]
    sets: list[Set]
    base_probability: float
    unlisted_probability: float
    named: list[str]
    groups: list[list[str]]
    acts_like: list[str]
    explained: bool
    outliers: str
    confirmation: Confirmation
    separating: list[dict]
    best: list[str] | None
    gain: Gain
    theta: list[Moved]
    noise: list[Noise]
    remaining: Misfit | None
    level: float
    least_probability: float
    critical_z: float
    least_p_value: float
    ess: float
    limits: list[str]
    words: list[str]


def read_findings(path: str | Path) -> Findings:
    """The findings in a file that `findings.write_findings` wrote."""
    return json.loads(Path(path).read_text())
