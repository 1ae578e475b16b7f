"""Which emulators are fitted, and how."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from regional_lv.config.section import (
    ONCE,
    Count,
    Note,
    Positive,
    Section,
    Share,
    Whole,
    not_offered,
)
from regional_lv.emulators import OF_INPUTS, REGISTRY

Rows = Annotated[Whole, Field(ge=10)]
Observations = Annotated[Whole, Field(ge=100)]
Widths = Annotated[list[Count], Field(min_length=1)]
Names = Annotated[list[str], ONCE]
SomeNames = Annotated[list[str], Field(min_length=1), ONCE]


class Shortlist(Section, reruns="the choice, and what follows for the emulators that enter it"):
    """The emulators that go on to the posteriors of the test set."""

    names: SomeNames | None = None
    """Some of `emulators.names`, chosen by hand; null for the best of the ranking."""
    also: Names = ["mvgp", "local_dkmgp", "dnn"]
    """Beside the best of the ranking those of these that are in `emulators.names`; the default is
    the paper's shortlist, for `tables/paper_comparison`."""
    size: Count = 3
    """How many; those with the least parameter MSE on the test set."""
    estimator: Literal["least_squares", "weighted"] = "weighted"
    """Whose parameter MSE counts; `least_squares` on the predictive mean is the paper's, `weighted`
    takes the predictive covariance into account."""


class Settings(Section):
    """Settings of an emulator."""

    input_transform: Literal["log", "identity"] = "log"
    """Scale on which the emulator sees theta; `identity` is the paper's."""


class Exact(Settings):
    """Settings of exact Gaussian processes."""

    iterations: Count = 60
    """Iterations of the hyperparameter fit."""
    calibration: Literal["student", "variance_trend", "variance_factor", "none"] = "student"
    """`variance_trend`: a factor on the predictive variance, from leave-one-out errors, that is a
    power of the mean stiffness, and one on errors along the Jacobian, by which 95 % intervals of
    theta hold; `student`: that, and errors with a multivariate t, from the same errors;
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
    about other parameters for each simulation."""
    variance_observations: Observations | None = None
    """Values and derivatives that the stated error is computed from; null is all. How large it is
    is calibrated by the errors of leaving out simulations."""
    hyperparameter_rows: Rows = 60
    """Simulations that the hyperparameters are fitted to."""


class JointGP(GradientGP):
    """The same process over all inputs that are not fixed (`inputs`), on the scale of log volume
    and log stretch."""

    max_observations: Observations = 10000
    variance_observations: Observations | None = 2000
    hyperparameter_rows: Rows = 100


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


class OfPlugin(Settings, extra="allow"):
    """Settings of an emulator that a plugin adds, by its name; its class knows them."""

    __pydantic_extra__: dict[
        str, Annotated[Any, Field(description="What its class has in `defaults`.")]
    ]


class Emulators(
    Section, reruns="the emulator and everything after it", added=REGISTRY.keys, extra="allow"
):
    """Which emulators are fitted, and how; the settings of an emulator that a plugin adds are in a
    section of its name."""

    __pydantic_extra__: dict[str, OfPlugin]

    names: Annotated[SomeNames, Note(reruns="the emulators added, and the comparison")] = (
        "exact_gp gradient_gp local_gp local_mgp local_dkgp local_dkmgp vgp mvgp dgp dnn".split()
    )
    """Emulators to fit and compare."""
    shortlist: Shortlist = Shortlist()
    final: Annotated[str, Note(reruns="posteriors of scenarios and subjects, and figures")] = "auto"
    """The emulator whose posteriors scenarios, subjects and figures use; one of the shortlist, or
    `auto`: of those whose 95 % intervals do not certainly cover less than 90 %, the one with the
    least CRPS."""
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

    @model_validator(mode="after")
    def _with_those_of_plugins(self):
        for name in self.names:
            if name in REGISTRY and name not in type(self).model_fields:
                self.model_extra.setdefault(name, OfPlugin())
        return self

    def check(self, key, study) -> Iterator[str]:
        yield from not_offered(f"{key}.names", self.names, REGISTRY)
        yield from not_offered(f"{key}.shortlist.also", self.shortlist.also, REGISTRY)
        if OF_INPUTS in (*self.names, self.final):
            yield (
                f"{key}: {OF_INPUTS} is of all inputs, and trained where `inputs` gives roles; "
                "name another one"
            )
        for name in self.shortlist.names or ():
            if name not in self.names:
                yield f"{key}.shortlist.names: {name} is not in emulators.names; add it there"
        candidates = self.shortlist.names or self.names
        if self.final not in ("auto", *candidates):
            yield (
                f"{key}.final: {self.final} is not among those whose posteriors are compared "
                f"({', '.join(candidates)}); add it to emulators.names and to "
                "emulators.shortlist.names, or write `auto`"
            )
        for name, settings in (self.model_extra or {}).items():
            known: dict = getattr(REGISTRY[name], "all_defaults", dict)()
            yield from not_offered(f"{key}.{name}", settings.model_extra, known)
        if not study.evaluation and self.final == "auto":
            yield (
                f"{key}.final: without `evaluation` nothing says which emulator is the best; name "
                f"one of {', '.join(self.names)}"
            )
        rows = study.sizes["train"]
        for emulator in self.names:
            neighbours = getattr(getattr(self, emulator, None), "neighbours", 0)
            held_out = max(1, round(min(0.1 * rows, 20)))  # as `LocalGP` calibrates on
            if rows - held_out < neighbours:
                yield (
                    f"{key}.{emulator}.neighbours: {rows} training simulations are too few for "
                    f"{neighbours} neighbours and some to calibrate on; lower it, leave {emulator} "
                    "out of emulators.names, or simulate more"
                )
