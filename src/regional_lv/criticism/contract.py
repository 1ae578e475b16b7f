"""What `findings.json` holds: the contract with everything that reads it.

A type checker holds writer and readers to it. None stands for what is no number, or was not found;
a float of `Misfit` or `Findings` is null in the file where too few channels were measured for a
test: its `families` are empty then.
"""

import json
from pathlib import Path
from typing import TypedDict


class Channel(TypedDict):
    """A measured channel and what a model predicts of it, its segment left out; z is in predictive
    sds."""

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
    """Whether a model misses the measurements; `families`: a p-value for each kind of test."""

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
    """A cause that was searched, whether or not it is named.

    name: of the cause; component: its place in the best set, else the most probable one, if it has
    several (the number of a segment). parameter, description, source, unit, range: of the input.
    base: the value that the model assumes. z: its score in the model as it is, signed; p_value over
    the catalogue, p_value_single by itself. probability: that it is present; component_probability:
    given that, of the place. estimate, interval95, posterior: of the models that hold it (None
    where there are no draws of any). at_bound: whether the data require more than the range.
    identifiable, why, absorbed, sd: whether the stiffness could imitate it, in words; the share of
    its effect that it takes up; and the sd of a first estimate from the model as it is.
    """

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
    posterior: Histogram | None


class Set(TypedDict):
    """A set of causes; best: whether what is named stands on it; `fit`: of each cause, its most
    probable value. simulations: how many of it are known; confirmed: whether these are enough, and
    agree with the emulator."""

    causes: list[str]
    components: list[str]
    best: bool
    fit: list[float]
    probability: float
    log_evidence: float
    log_prior: float
    elpd_gain: float | None
    elpd_gain_se: float | None
    misfit_p_value: float | None
    confirmed: bool
    simulations: int
    emulator_error_sd: float | None


class EmulatorError(TypedDict):
    """Of a channel: root mean square of simulated minus emulated over the confirming simulations
    of the last round, in its unit and in the sds that the emulator stated."""

    output: str
    error: float
    error_sd: float


class Confirmation(TypedDict):
    """What simulations stand behind the answer.

    simulations: all of them; simulations_of_best: of the best set; failed: that did not converge.
    emulator_error_sd: root mean square over simulations and channels of simulated minus emulated,
    in stated sds, by round (before the simulations of that round were known); largest_error_sd: of
    a channel, in the last round. agrees: whether the last round's errors are as small as stated.
    probability_not_simulated: of all sets without simulations.
    """

    simulations: int
    simulations_of_best: int
    failed: int
    emulator_error_sd: list[float]
    largest_error_sd: float | None
    agrees: bool
    probability_not_simulated: float
    channels: list[EmulatorError]


class Gain(TypedDict):
    """What the best set gains over the model as it is, each segment left out in turn."""

    elpd: float | None
    elpd_se: float | None
    elpd_before: float
    rmse_before: float | None
    rmse_after: float | None
    rmse_volume_ml_before: float | None
    rmse_volume_ml_after: float | None
    coverage_before: float
    coverage_after: float


class Summary(TypedDict):
    """Of a posterior."""

    mean: float
    sd: float
    interval95: list[float]


class Stiffness(TypedDict):
    """Of one inferred input (`C_a_septal`): averaged over models, and in the model as it is; the
    shares of its variance by source (`noise`, `emulator`, measured inputs by their name,
    `ranges`, `models`), on its scale; and by how many sds of the model as it is the mean moves."""

    name: str
    unit: str
    averaged: Summary
    as_it_is: Summary
    sources: dict[str, float]
    shift_sd: float


class MeasuredInput(TypedDict):
    """An input that was known with an sd: before, and averaged over models."""

    name: str
    unit: str
    prior_mean: float
    prior_sd: float
    averaged: Summary


class Noise(TypedDict):
    """Median of an inferred noise scale in the model as it is, and averaged over models, in sds of
    the outputs over the training data."""

    quantity: str
    before: float
    after: float


class Findings(TypedDict):
    """Of one subject, or of several together.

    subjects: names of the hearts. misfit: of the model as it is; remaining: of the best set, None
    without one. base_probability: of the model as it is; unlisted_probability: of a smooth
    departure of unknown shape. named: causes; groups: of causes of which one is present; acts_like:
    causes whose estimate is at the end of its range; best: causes of the best set, None without
    one. explained: whether a set that fits stands behind what is named. trusted: whether any tested
    model of 5 % or more passes the misfit test, so that the stiffness can be. outliers: why
    departures from the best set are no outliers, empty if they are, or if it has no heavy tails.
    separating (`separate.separating_measurement`): by pair of rival sets the measurements that
    would tell them apart. level: of the misfit test; least_probability: from which on a cause is
    named; critical_z: |z| of a cause that the test asks for; least_p_value: that the bootstrap can
    give. ess: effective draws. limits: what the data do not support; words: the verdict, in
    sentences.
    """

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
    trusted: bool
    outliers: str
    confirmation: Confirmation
    separating: list[dict]
    best: list[str] | None
    gain: Gain
    stiffness: list[Stiffness]
    measured_inputs: list[MeasuredInput]
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
