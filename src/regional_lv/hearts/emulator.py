"""The emulator of any heart in the coordinates of one: what its shape, its pressure and the inputs
that its study holds fixed make of it.

A ventricle that is scaled as a whole has the same strains, and one whose stresses, loads and
springs are all multiplied by one number moves as before: every heart is looked up at one length and
one pressure, with the figures that its wall has over the emulator's sectors (`hearts.sectors`).
"""

import copy
import math
from collections.abc import Mapping, Sequence

import torch

from regional_lv.channels import Channels
from regional_lv.emulators.base import Prediction
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.errors import InputError
from regional_lv.geometry.described import log_volumes
from regional_lv.hearts.by_surfaces import BySurfaces
from regional_lv.hearts.difference import Difference
from regional_lv.hearts.population import SHAPE
from regional_lv.hearts.sectors import Mixing, Sectors
from regional_lv.inputs.base import Input
from regional_lv.inputs.closed_forms import LENGTH_POWERS
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.evaluation import carry
from regional_lv.inputs.shape import Length
from regional_lv.inputs.space import SECTION, Inputs, catalogue


def length_power(each: Input) -> int:
    """The power of a ventricle's size that an input's value goes with: of its own lengths, too."""
    return 1 if each.unit == "mm" else each.length_power


def inputs_of(model: Mapping, known: Inputs) -> list[Input]:
    """The emulator's inputs as another model has them. Raises InputError for one that this cannot
    have."""
    here = {each.name: each for each in catalogue(model)}
    for name in known.names:
        if name not in here:
            raise InputError(
                f"{SECTION}.{name}: this study has no such input, and the emulator has it"
            )
    return [here[name] for name in known.names]


class InputMap:
    """Values of the emulator's E inputs, at values of the k simulated inputs of one heart's study.

    Attributes: factor (E,), what values in the study's units are multiplied by, at its nominal
    length; direct, places of emulator's and study's inputs that are the same; length, the place of
    the study's input of that name, or None.

    Parameters
    ----------
    known: the emulator's inputs, in the model that they are about.
    inputs: the study's, simulated ones alone.

    Raises InputError for a study without one of the emulator's inputs.
    """

    def __init__(self, known: Inputs, inputs: Inputs):
        here = self._here = inputs_of(inputs.base, known)
        # Of a stiffness nothing is known beforehand: it is among the study's.
        values = [each.value_in(inputs.base) for each in here]
        self._values = torch.tensor(
            [math.nan if value is None else value for value in values], dtype=torch.float64
        )
        places = {name: e for e, name in enumerate(known.names)}
        pairs = [(places[name], k) for k, name in enumerate(inputs.names) if name in places]
        self.direct = torch.tensor(pairs, dtype=torch.long).T
        self._directions = [(k, each) for k, each in enumerate(inputs) if each.carries]
        self.length = inputs.names.index(Length.name) if Length.name in inputs.names else None
        self._nominal_length = _length(inputs)
        self.length_powers = torch.tensor([length_power(each) for each in known]).double()
        self.sectors = Sectors.between(known.base, inputs.base)
        self._shape_places = {
            column: torch.tensor([places[name] for name in names])
            for column, names in SHAPE.items()
            if names[0] in places
        }
        stress = torch.tensor([each.stress_power for each in known]).double()
        self.factor = (_pressure(known) / _pressure(inputs)) ** stress
        self.factor = self.factor * (_length(known) / _length(inputs)) ** self.length_powers

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """(M, E) at x (M, k)."""
        return self._look_up(x, None)

    @property
    def moved(self) -> torch.Tensor:
        """Mask (E,) of the emulator's inputs that those of the study move."""
        moves = {name for _, direction in self._directions for name in direction.moves}
        moved = torch.tensor([each.name in moves for each in self._here])
        moved[self.direct[0]] = True
        if self.sectors is not None:
            for at in self._shape_places.values():
                moved[at] = moved[at].any()
        return moved if self.length is None else moved | (self.length_powers != 0)

    def with_slopes(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The same, and its derivatives (M, E, k)."""
        by_x = x.new_zeros(len(x), len(self.factor), x.shape[1])
        theirs, own = self.direct
        by_x[:, theirs, own] = 1.0
        return self._look_up(x, by_x), by_x

    def size(self, x: torch.Tensor) -> torch.Tensor:
        """Length (M,) beside the nominal one."""
        if self.length is None:
            return torch.ones(len(x), dtype=x.dtype)
        return x[:, self.length] / self._nominal_length

    def _look_up(self, x: torch.Tensor, by_x: torch.Tensor | None) -> torch.Tensor:
        there = self._values.repeat(len(x), 1)
        theirs, own = self.direct
        there[:, theirs] = x[:, own]
        for k, direction in self._directions:
            carry(direction, k, x, self._here, there, by_x)
        if self.sectors is not None:
            for column, at in self._shape_places.items():
                over = self.sectors.means[column]
                there[:, at] = over(there[:, at])
                if by_x is not None:
                    by_x[:, at] = over.slopes @ by_x[:, at]
        factor = self.factor * self.size(x)[:, None] ** -self.length_powers
        there = there * factor
        if by_x is not None:
            by_x *= factor[..., None]
            if self.length is not None:
                by_x[:, :, self.length] -= self.length_powers * there / x[:, self.length, None]
        return there


def _length(inputs: Inputs) -> float:
    return float(inputs.base["geometry"]["length_mm"])


def _pressure(inputs: Inputs) -> float:
    return float(inputs.base["loading"]["pressure_mmhg"])


class HeartEmulator:
    """What `JointGP` offers to a posterior and a criticism, for one heart.

    Attributes: coordinates, of the study's k simulated inputs; outputs, channels; output_sd (D,);
    jacobian_factor, as of an emulator whose errors are calibrated already.

    Parameters
    ----------
    emulator: of any heart. known: its inputs, in the model that they are about.
    inputs: of the heart's study, which the emulator has to know (`hearts.reach`).
    described: whether its segment table describes surfaces that are known better.
    """

    jacobian_factor = 1.0

    def __init__(self, emulator: JointGP, known: Inputs, inputs: Inputs, described: bool = False):
        simulated = inputs.simulated
        self._there = InputMap(known, simulated)
        nominal = self._there(torch.as_tensor(simulated.nominal)[None])[0]
        self.emulator = emulator.at_fixed(nominal, ~self._there.moved)
        self._scale = _length(simulated) / _length(known)
        self._difference: Difference | None = None
        self.coordinates: Coordinates = simulated.coordinates
        self._mixing: Mixing | None = None
        sectors, surfaces = self._there.sectors, None
        if described:
            geometry = simulated.base["geometry"]
            apex = -geometry["length_mm"]
            volumes = log_volumes(geometry["table"], apex, apex - geometry["apex_mm"])
            surfaces = BySurfaces.of(self.emulator.channels, known, volumes)
        if sectors is not None or described:
            self._mixing = Mixing.of(self.emulator.channels, sectors, surfaces)

    @property
    def channels(self) -> Channels:
        return self.emulator.channels if self._mixing is None else self._mixing.channels

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.channels.names

    @property
    def output_sd(self) -> torch.Tensor:
        sd = self.emulator.output_sd
        return (sd if self._mixing is None else self._mixing.mixed(sd)) * self._scale**self._powers

    @property
    def _powers(self) -> torch.Tensor:
        """Of the size, that outputs (D,) go with."""
        return torch.tensor([LENGTH_POWERS[channel.unit] for channel in self.channels]).double()

    def _reported(self, x: torch.Tensor) -> torch.Tensor:
        """What outputs (M, D) that are looked up are multiplied by."""
        return (self._scale * self._there.size(x)[:, None]) ** self._powers

    def predict_mean(self, x: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) at values x (M, k) of the study's inputs."""
        there = self._there(x)
        y = self._mixed(self.emulator.predict_mean(there), there) * self._reported(x)
        return y if self._difference is None else self._difference.mean(x, y)

    def _mixed(self, outputs: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) of this heart's segments, looked up at the emulator's inputs (M, E)."""
        return outputs if self._mixing is None else self._mixing(outputs, there)

    def linearise(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The same, and their derivatives (M, D, k)."""
        found = self._looked_up(x)
        return found if self._difference is None else self._difference.linearise(x, *found)

    def _looked_up(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """`linearise` without what simulations of the heart say."""
        there, by_x = self._there.with_slopes(x)
        mean, slopes = self.emulator.linearise(there)
        if self._mixing is not None:
            slopes = self._mixing.slopes(mean, slopes, there)
            mean = self._mixing(mean, there)
        factor = self._reported(x)
        mean, slopes = mean * factor, (slopes @ by_x) * factor[..., None]
        if self._there.length is not None:
            by_length = mean * self._powers / x[:, self._there.length, None]
            slopes[:, :, self._there.length] += by_length
        return mean, slopes

    def predict(self, x: torch.Tensor) -> Prediction:
        """As `Emulator.predict`, at x (M, k)."""
        there, factor = self._there(x), self._reported(x)
        found = self.emulator.predict(there)
        covariance = found.covariance
        if self._mixing is not None:
            covariance = self._mixing.covariance(found.mean, covariance, there)
        covariance = factor[:, :, None] * covariance * factor[:, None]
        mean = self._mixed(found.mean, there) * factor
        if self._difference is None:
            return Prediction(mean, covariance)
        added = self._difference.predict(x, mean)
        return Prediction(added.mean, covariance + added.covariance)

    def errors_of(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Simulated outputs y (n, D) at x (n, k) less the emulated ones, in stated sds, (n, D)."""
        found = self.predict(x)
        return (y - found.mean) / found.sd

    @property
    def of_study_mesh(self) -> "HeartEmulator":
        """Without what a finer mesh changes."""
        return self._with(self.emulator.of_study_mesh)

    def select(self, outputs: Sequence[str]) -> "HeartEmulator":
        """For some of its outputs, as `Emulator.select`."""
        if self._mixing is None:
            chosen = self._with(self.emulator.select(outputs))
        else:  # all around the axis counts in what is interpolated
            chosen = self._with(self.emulator, self._mixing.select(outputs))
        if self._difference is not None:
            chosen._difference = self._difference.select(outputs)
        return chosen

    def condition(
        self, x: torch.Tensor, y: torch.Tensor, sensitivities: torch.Tensor, seed: int = 0
    ) -> "HeartEmulator":
        """This emulator given simulations of this heart as well: at x (m, k), of outputs y (m, D)
        on the emulator's mesh, with derivatives (m, D, k).

        The first ones tell how large its errors about this heart are (`Difference`, for which the
        seed is), which are stated instead of those about any heart from then on, and of what its
        table and sectors leave open. Raises InputError for too few of these.
        """
        plain = self.of_study_mesh
        emulated, simulated = plain._looked_up(x), (y, sensitivities)
        if self._difference is not None:
            given = self._with(self.emulator)
            given._difference = self._difference.condition(x, emulated, simulated)
            return given
        known = None if self._mixing is None else self._mixing.known
        given = self._with(self.emulator.with_known_errors, known)
        settings = self.emulator.settings
        given._difference = Difference.of(
            x, emulated, simulated, self.coordinates, self.outputs, settings, seed
        )
        return given

    def _with(self, emulator: JointGP, mixing: Mixing | None = None) -> "HeartEmulator":
        changed = copy.copy(self)
        changed.emulator, changed._mixing = emulator, mixing or self._mixing
        return changed
