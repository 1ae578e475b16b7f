"""Settings of the package's emulators.

A module of its own, so that an emulator depends on its settings and on nothing else of the
configuration.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from regional_lv.config.section import (
    Count,
    Natural,
    Note,
    Positive,
    Section,
    Share,
    Whole,
    alternatives,
    choices,
    offers,
)
from regional_lv.errors import InputError

Rows = Annotated[Whole, Field(ge=10)]
Observations = Annotated[Whole, Field(ge=100)]
Widths = Annotated[list[Count], Field(min_length=1)]


class Settings(Section):
    """Settings of an emulator."""

    input_transform: Literal["log", "identity"] = "log"
    """Scale on which the emulator sees theta; `identity` is the paper's."""


class Exact(Settings):
    """Settings of exact Gaussian processes."""

    iterations: Count = 60
    """Iterations of the hyperparameter fit."""
    calibration: Literal["student", "variance_trend", "intervals", "variance_factor", "none"] = (
        "student"
    )
    """`variance_trend`: a factor on the predictive variance, from leave-one-out errors, that is a
    power of the mean stiffness, and one on errors along the Jacobian, by which 95 % intervals of
    theta hold; `student`: that, and errors with a multivariate t, from the same errors;
    `intervals`: the same power of the stiffness, and a factor on all errors, by which 95 %
    intervals of outputs hold, whose covariance is that of the leave-one-out errors;
    `variance_factor`: the factor along the Jacobian alone; `none`: leave it."""


class ExactGP(Exact):
    """Exact multi-output Gaussian process, one kernel for all outputs."""

    kernel: Literal["zonal_rq", "rq", "rbf", "matern52"] = "zonal_rq"
    """Rational quadratic, squared exponential or Matern 5/2, each with ARD; `zonal_rq` is the
    product over the zones of rational quadratic ones, each of its factors."""
    nugget: Positive = 1e-8
    """Added to the diagonal of the correlation matrix."""
    iterations: Count = 150


class GradientGP(Exact):
    """The exact Gaussian process on outputs and their sensitivities (kernel `zonal_rq`)."""

    max_observations: Observations = 8000
    """Size of the covariance matrix; values of all simulations, then as many derivatives as fit,
    with respect to other parameters for each simulation."""
    variance_observations: Observations | None = None
    """Values and derivatives that the stated error is computed from; null is all. How large it is
    is calibrated by the errors of leaving out simulations."""
    hyperparameter_rows: Rows = 60
    """Simulations that the hyperparameters are fitted to."""


class JointGP(GradientGP):
    """The same process over all inputs that are not fixed (`inputs`), on the scale of log volume
    and log stretch."""

    max_observations: Observations = 16000
    variance_observations: Observations | None = 2000
    hyperparameter_rows: Rows = 100
    network_passes: Natural = 0
    """Passes through the simulations in which networks of the wall around a segment learn the mean
    of the process, where shapes are inputs; 0: none, the mean is a constant."""
    network_width: Count = 256
    """Width of their hidden layers."""
    network_layers: Count = 4
    """Their hidden layers."""
    network_members: Count = 3
    """Networks of which the mean counts, trained from other seeds."""
    network_folds: Annotated[Whole, Field(ge=2)] = 4
    """Parts of the simulations; the process learns the errors on each, of one network that learnt
    from the others: those on at most `max_observations` simulations."""


class Reduced(Settings):
    """Settings of emulators of principal components."""

    explained_variance: Share = 0.999
    """Share of the strain variance that the components emulated explain; the paper's. What the
    others would have added is part of the predictive covariance."""


class Process(Reduced):
    """Settings of the paper's Gaussian processes."""

    kernel: Literal["auto", "rq", "rbf", "matern52", "zonal_rq"] = "auto"
    """`auto`: the one with the least cross-validated error among rational quadratic (`rq`), squared
    exponential (`rbf`) and Matern 5/2 (`matern52`); all with ARD. `zonal_rq` is the product over
    the zones of rational quadratic ones, each of its factors."""


class LocalGP(Process):
    """L.GP; a Gaussian process for each reduced output, on the nearest neighbours in output
    space."""

    neighbours: Annotated[Whole, Field(ge=21)] = 100
    """Simulations nearest to the observed outputs, on which it trains."""
    iterations: Count = 30
    """Iterations of each local fit (L-BFGS)."""


class LocalMGP(LocalGP):
    """L.MGP; one Gaussian process for all reduced outputs (ICM), on the nearest neighbours."""

    iterations: Count = 60


class LocalDKGP(LocalGP):
    """L.DKGP; as L.GP, the kernel on features that a network makes of the inputs."""

    iterations: Count = 15
    hidden: Widths = [32]
    """Widths of the hidden layers of the network that makes the features."""


class LocalDKMGP(LocalDKGP):
    """L.DKMGP; as L.MGP, the kernel on features that a network makes of the inputs."""

    neighbours: Annotated[Whole, Field(ge=21)] = 200
    iterations: Count = 30


class VGP(Process):
    """VGP; an independent sparse variational Gaussian process for each reduced output."""

    inducing: Count = 300
    """Inducing points."""
    hyperparameter_rows: Rows = 1500
    """Simulations that hyperparameters and inducing points are fitted to, at most."""
    iterations: Count = 80
    """Iterations of the training (L-BFGS)."""


class MVGP(VGP):
    """MVGP; a sparse variational Gaussian process for all reduced outputs, with a linear model of
    coregionalisation."""

    latents: Count = 24
    """Latent processes that are mixed; at most as many as reduced outputs."""
    iterations: Count = 120


class DGP(VGP):
    """DGP; two layers of sparse variational Gaussian processes, as many hidden variables as
    parameters."""

    inducing: Count = 100
    deep_iterations: Count = 60
    """Iterations of both layers together, after those of the second alone."""
    iterations: Count = 60


class DNN(Reduced):
    """DNN; a feed-forward network with one scale for all its errors."""

    hidden: Widths = [128, 256, 64]
    """Widths of the hidden layers."""
    epochs: Count = 400
    """Passes through the simulations."""
    learning_rate: Positive = 5e-3
    """Largest step of the training (Adam)."""
    error_prior_scale: Annotated[
        Positive | None, Note(reruns="the emulator and its posteriors")
    ] = 0.1
    """Scale of the half-normal prior on the errors' common standard deviation, in training sd of
    the outputs, which is inferred with theta; null: the one of held-out errors."""


class OwnEmulators(Section):
    """The settings of every emulator of the package, by its name."""

    exact_gp: ExactGP = ExactGP()
    gradient_gp: GradientGP = GradientGP()
    joint_gp: JointGP = JointGP()
    local_gp: LocalGP = LocalGP()
    local_mgp: LocalMGP = LocalMGP()
    local_dkgp: LocalDKGP = LocalDKGP()
    local_dkmgp: LocalDKMGP = LocalDKMGP()
    vgp: VGP = VGP()
    mvgp: MVGP = MVGP()
    dgp: DGP = DGP()
    dnn: DNN = DNN()


def settings_of(name: str, given: Mapping, otherwise: Mapping) -> dict:
    """The settings of an emulator, with defaults for those that are not given.

    otherwise: settings and defaults of one that has no section in the configuration, a plugin's.
    Raises InputError for a setting that it does not have, and for what is not offered; the limits
    of numbers are those of studies, and checked where configurations are read.
    """
    section = getattr(OwnEmulators(), name, None)
    defaults = section.model_dump() if section else dict(otherwise)
    for key, value in given.items():
        if key not in defaults:
            known = ", ".join(defaults)
            raise InputError(f"{name}.{key}: unknown setting; choose among {known}")
        kinds = alternatives(type(section).model_fields[key].annotation) if section else []
        if value not in (choices(kinds) or [value]):
            raise InputError(f"{name}.{key}: {offers(value, choices(kinds))}")
    return defaults | dict(given)
