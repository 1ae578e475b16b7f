"""Which emulators are fitted, and how."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from regional_lv.config.section import ONCE, Count, Note, Section, not_offered
from regional_lv.config.sections.settings import OwnEmulators, Settings
from regional_lv.emulators import OF_INPUTS, REGISTRY

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


class OfPlugin(Settings, extra="allow"):
    """Settings of an emulator that a plugin adds, by its name; its class knows them."""

    __pydantic_extra__: dict[
        str, Annotated[Any, Field(description="What its class has in `defaults`.")]
    ]


class Choice(Section):
    """Which emulators are fitted and used."""

    names: Annotated[SomeNames, Note(reruns="the emulators added, and the comparison")] = (
        "exact_gp gradient_gp local_gp local_mgp local_dkgp local_dkmgp vgp mvgp dgp dnn".split()
    )
    """Emulators to fit and compare."""
    shortlist: Shortlist = Shortlist()
    final: Annotated[
        str,
        Note(
            reruns="posteriors of scenarios, those of subjects by the stiffness alone, and the "
            "paper's figures; in studies of tables the answers of subjects, too"
        ),
    ] = "auto"
    """The emulator of the stiffness alone whose posteriors scenarios and the paper's figures use;
    in studies of tables it answers for subjects, too. One of `emulators.shortlist.names`, or of
    `emulators.names` if those are null, which then joins the best of the ranking; or `auto`: of
    those whose 95 % intervals do not certainly cover less than 90 %, the one with the least
    CRPS."""


class Emulators(
    OwnEmulators,
    Choice,
    reruns="the emulator and everything after it",
    added=REGISTRY.keys,
    extra="allow",
):
    """Which emulators are fitted, and how; the settings of an emulator that a plugin adds are in a
    section of its name."""

    __pydantic_extra__: dict[str, OfPlugin]

    @model_validator(mode="after")
    def _with_those_of_plugins(self):
        for name in self.names:
            if name in REGISTRY and name not in type(self).model_fields:
                self.__pydantic_extra__.setdefault(name, OfPlugin())
        return self

    def check(self, key, study) -> Iterator[str]:
        yield from not_offered(f"{key}.names", self.names, REGISTRY)
        yield from not_offered(f"{key}.shortlist.also", self.shortlist.also, REGISTRY)
        if OF_INPUTS in (*self.names, self.final):
            yield (
                f"{key}: {OF_INPUTS} is the emulator of all inputs, which every study trains by "
                "itself; name one of the stiffness alone"
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
