"""One posterior of several hearts that have the same causes, or of hearts of known stiffness.

Each heart has its own inferred and measured inputs, whose names begin with the heart's; suspected
inputs and the tails of the noise have one value in all hearts, as have its scales. The scaled
coordinates of a heart's K inputs are offset + moves @ x of the K' coordinates x of all hearts
together.

Of hearts whose stiffness is known, such as simulations of another code, the reference material may
be another one: their factors are known up to a number for each factor of the material law, the same
in all zones and hearts, and these numbers are inferred in place of the factors.
"""

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd
import torch

from regional_lv.errors import InputError
from regional_lv.inference.departure import departure_covariance
from regional_lv.inference.emulated import EmulatedInputs, InputEmulator
from regional_lv.inference.noise import Noise
from regional_lv.inference.observed import Observed
from regional_lv.inference.potential import Emulated, Potential
from regional_lv.input_files import reading
from regional_lv.inputs.base import Input
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.space import Inputs, Role
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.typed_tables import require_columns

LARGEST_FACTOR = 3.0
"""By which the reference values of two materials differ: published sets for one law do."""

LEAST_ROOM = 0.1
"""Of a common factor on either side, in its logarithm."""


class CommonFactor(Input):
    """Log of the number by which the known values of one `factor` of the law are multiplied."""

    family = "material"
    changes = "factors"
    parameter = "log of a common factor of known stiffness"
    description = (
        "The stiffness is known in units of another reference material: all values of one factor "
        "of the law, in all zones and hearts, are multiplied by the same number."
    )
    source = "range: a factor of 3, as between published parameters of one law"

    def __init__(self, factor: str, low: float, high: float):
        self.name, self.low, self.high = f"log_factor_{factor}", low, high


def stiffness_of(inputs: Inputs) -> dict[int, Stiffness]:
    """The inferred factors of the material law, whose values can be known, by place."""
    inferred = inputs.of_role("inferred")
    return {k: e for k, e in enumerate(inputs) if inferred[k] and isinstance(e, Stiffness)}


@dataclass(frozen=True)
class JointInputs:
    """Where the inputs of S hearts come from.

    inputs: K', of all hearts together. offset (S, K), moves (S, K, K').
    """

    inputs: Inputs
    offset: torch.Tensor
    moves: torch.Tensor

    @classmethod
    def of(
        cls, inputs: Inputs, hearts: Sequence[str], known: pd.DataFrame | None = None
    ) -> "JointInputs":
        """Of `hearts` with K `inputs` each.

        known: values of all of `stiffness_of`, a row for each heart; None: they are inferred.

        Raises InputError if known values leave no room for common factors.
        """
        common = [] if known is None else list(_common(inputs, known.loc[[*hearts]]))
        columns = [*common, *_own(inputs, hearts, known is not None), *_shared(inputs)]
        members, roles, _ = zip(*columns, strict=True)
        names = [each.name for each in members]
        joint = Inputs(inputs.base, members, dict(zip(names, roles, strict=True)))
        moves = torch.zeros(len(hearts), len(inputs), len(joint), dtype=torch.float64)
        for j, (_, _, moved) in enumerate(columns):
            moves[*moved, j] = 1.0
        offset = torch.zeros(moves.shape[:2], dtype=torch.float64)
        if known is not None:
            for k, each in stiffness_of(inputs).items():
                values = known.loc[[*hearts], each.name].to_numpy(float)
                offset[:, k] = torch.as_tensor(each.scale(values))
        return cls(joint, offset, moves)

    def of_each(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled coordinates (M, S, K) of each heart's inputs, at those (M, K') of all."""
        return self.offset + torch.einsum("skj,mj->msk", self.moves, x)


Column: TypeAlias = tuple[Input, Role, tuple]
"""An input of all hearts together, its role, and the hearts and their inputs that it moves."""

ALL = slice(None)
"""Of the hearts."""


def _common(inputs: Inputs, known: pd.DataFrame) -> Iterator[Column]:
    stiffness = stiffness_of(inputs)
    for factor in dict.fromkeys(each.factor for each in stiffness.values()):
        own = {k: each for k, each in stiffness.items() if each.factor == factor}
        yield CommonFactor(factor, *_room([*own.values()], known)), Role("inferred"), (ALL, [*own])


def own_name(heart: str, name: str) -> str:
    """What an input of one of several hearts is called."""
    return f"{heart}: {name}"


def _own(inputs: Inputs, hearts: Sequence[str], is_known: bool) -> Iterator[Column]:
    shared = set(_common_to_all(inputs))
    if is_known:
        shared |= set(stiffness_of(inputs))
    for s, heart in enumerate(hearts):
        for k in range(len(inputs)):
            if k not in shared:
                each = copy.copy(inputs[k])
                each.name = own_name(heart, each.name) if len(hearts) > 1 else each.name
                yield each, inputs.roles[k], (s, k)


def _shared(inputs: Inputs) -> Iterator[Column]:
    for k in _common_to_all(inputs):
        yield inputs[k], inputs.roles[k], (ALL, k)


def _common_to_all(inputs: Inputs) -> list[int]:
    """Places of the causes, and of what concerns the noise."""
    noise = [isinstance(each, HeavyTails) for each in inputs]
    return np.flatnonzero(inputs.of_role("suspected") | noise).tolist()


def _room(own: Sequence[Stiffness], known: pd.DataFrame) -> tuple[float, float]:
    """Range of the log of a common factor that keeps known values within those of the inputs."""
    values = np.log(known[[each.name for each in own]].to_numpy(float))
    down = values - np.log([each.low for each in own])
    up = np.log([each.high for each in own]) - values
    for room, end in ((down, "low"), (up, "high")):
        heart, at = np.unravel_index(room.argmin(), room.shape)
        if room[heart, at] < LEAST_ROOM:
            name, value = own[at].name, np.exp(values[heart, at])
            raise InputError(
                f"known stiffness of {known.index[heart]}: {name} = {value:g} is too near to the "
                f"end of its range, {getattr(own[at], end):g}, which leaves no room for common "
                "factors on the reference material; leave this heart out, or widen design.lower "
                "and design.upper (parameters.bounds)"
            )
    most = np.log(LARGEST_FACTOR)
    return max(-most, -down.min()), min(most, up.min())


class Hearts:
    """D observed outputs of S hearts (`potential.Emulated`), from the emulator of one with U
    channels: outputs in the order of the hearts, covariances in blocks (`Observed`).

    emulated: of the U channels of all hearts, at a heart's K inputs. present (S, U).
    """

    def __init__(self, emulated: Emulated, joint: JointInputs, present: torch.Tensor):
        self.emulated, self.joint, self.present = emulated, joint, present
        self.both = present[:, :, None] & present[:, None, :]

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(M, D)."""
        return self._by_heart(self.emulated.mean(self._points(x)))[:, self.present]

    def linearise(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D) and its derivatives (M, D, K') with respect to the scaled coordinates."""
        mean, slopes = map(self._by_heart, self.emulated.linearise(self._points(x)))
        slopes = torch.einsum("msuk,skj->msuj", slopes, self.joint.moves)
        return mean[:, self.present], slopes[:, self.present]

    @property
    def simulated_names(self) -> tuple[str, ...]:
        """Of the inputs that the simulator has."""
        return self.emulated.simulated_names

    def of_each(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled coordinates (M, S, K) of each heart's inputs."""
        return self.joint.of_each(x)

    def simulated_at(self, x: torch.Tensor) -> torch.Tensor:
        """Values (M S, k) of each heart's simulated inputs, draw by draw."""
        return self.emulated.simulated_at(self._points(x))

    def predict(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D), and the covariance (M or 1, S, U, U) of its errors."""
        mean, covariance = self.emulated.predict(self._points(x))
        blocks = covariance[None] if len(covariance) == 1 else self._by_heart(covariance)
        return self._by_heart(mean)[:, self.present], torch.where(self.both, blocks, 0.0)

    def _points(self, x):
        return self.joint.of_each(x).flatten(0, 1)

    def _by_heart(self, values):
        return values.unflatten(0, (-1, len(self.present)))


def potential_of_tables(
    emulator: InputEmulator,
    inputs: Inputs,
    tables: Mapping[str, pd.DataFrame],
    noise_prior_scale: float,
    known: pd.DataFrame | None = None,
) -> Potential:
    """The posterior of one heart or of several.

    emulator: of the simulated ones of the K `inputs` of a heart. tables: of each heart, as
    `read_measured` returns them. noise_prior_scale: of the half-normal prior of an unknown noise,
    in sds of an output over the training data. known: as for `JointInputs.of`.

    Raises InputError as `Noise.of_subject` and `JointInputs.of`.
    """
    tables = {heart: table.set_index("output") for heart, table in tables.items()}
    names = [n for n in emulator.outputs if any(n in table.index for table in tables.values())]
    emulator = emulator.select(names)
    own = {s: [n for n in names if n in table.index] for s, table in tables.items()}
    parts = [tables[s].loc[own[s]] for s in tables]
    y = torch.as_tensor(np.concatenate([part["value"].to_numpy(float) for part in parts]))
    noise = _noise(emulator, parts, noise_prior_scale)
    departure = departure_covariance(emulator.channels, emulator.output_sd.numpy())
    one = EmulatedInputs(emulator, inputs)
    if len(tables) == 1 and known is None:
        return Potential(one, inputs, y, noise, departure, Observed.one(emulator.channels))
    joint = JointInputs.of(inputs, [*tables], known)
    observed = Observed.several(own, emulator.channels)
    hearts = Hearts(one, joint, observed.present)
    departures = torch.where(hearts.both, departure, 0.0)
    return Potential(hearts, joint.inputs, y, noise, departures, observed)


def _noise(emulator: InputEmulator, tables: Sequence[pd.DataFrame], prior_scale: float) -> Noise:
    """Of the outputs of all hearts, with one unknown scale for each quantity."""
    parts = []
    for table in tables:
        mine = emulator.select([*table.index])
        value, sd = (table[column].to_numpy(float) for column in ("value", "sd"))
        parts.append(Noise.of_subject(mine, value, sd, prior_scale))
    groups = {
        quantity: torch.cat([p.groups.get(quantity, torch.zeros_like(p.sd)) for p in parts])
        for quantity in dict.fromkeys(name for part in parts for name in part.groups)
    }
    return Noise(torch.cat([part.sd for part in parts]), groups, float(prior_scale))


def read_known_theta(
    paths: Sequence[str | Path], subjects: Sequence[str], names: Sequence[str]
) -> pd.DataFrame:
    """Known values by subject and by the `names` of stiffness factors, from tables (CSV) with the
    column `subject` and one for each of them.

    Raises InputError for a missing column or subject, and for a value that is no positive number.
    """
    tables = []
    for path in paths:
        with reading(path, "check the path, and save it as CSV in UTF-8"):
            table = pd.read_csv(path, dtype={"subject": str})
        require_columns(path, table, ("subject", *names), "add what is missing")
        tables.append(table.set_index("subject")[list(names)])
    values = pd.concat(tables)
    where = ", ".join(map(str, paths[:3]))
    absent = [s for s in subjects if s not in values.index]
    if absent:
        raise InputError(f"{where}: no row for {', '.join(absent)}; add a row for each subject")
    values = values.reset_index().drop_duplicates().set_index("subject").loc[[*subjects]]
    if len(twice := values.index[values.index.duplicated()]):
        raise InputError(f"{where}: different rows of {twice[0]}; keep one for each subject")
    numbers = values.apply(pd.to_numeric, errors="coerce")
    wrong = ~((numbers > 0) & np.isfinite(numbers))
    for subject, column in wrong.stack()[lambda each: each].index:
        raise InputError(
            f"{where}, row {subject}: {column} is {values.loc[subject, column]}, no finite number "
            "above zero; correct it"
        )
    return numbers
