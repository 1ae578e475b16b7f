"""Networks that look at the wall around a segment: the trend of an emulator over shapes.

What a segment does depends on the wall around it, in the same way all around a level. One network
serves all segments of a level: it sees every quantity that segments have (stiffness, thickness,
radius) level by level around the axis, from the segment on that it is asked about. So each
simulation teaches it as much as six, or four, would teach a network of one segment. What belongs to
the heart as a whole, as its volume, is the mean of what one network says of all segments. They
learn from derivatives as well as from values (Czarnecki et al. 2017, arXiv 1706.04859).
"""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

BATCH, LEAST_STEPS = 64, 8
"""Simulations of a step, at most, and steps of a pass, at least."""

FEW, MORE_PASSES = 2, 3
"""A network that looks from so few segments gets so many times as many passes: the simulations
teach it less."""

LARGEST_STEP, DECAY = 4e-3, 0.3
"""Of AdamW, which learns biases, last layer and linear part."""

LARGEST_OF_LAYERS, DECAY_OF_LAYERS = 5e-3, 0.1
"""Of Muon (Jordan et al. 2024, https://kellerjordan.github.io/posts/muon), which learns the weights
of the layers: in a quarter of the passes that AdamW takes."""

WARM_UP = 0.1
"""Share of the steps in which these grow to the largest (Smith and Topin 2019, doi
10.1117/12.2520589)."""

APEX = LEVELS["apex"][0]

RADIUS, LEVEL_ENDS = "endo_radius", ("basal_end", "mid_end", "apical_end")
"""Names of the field and of the inputs that the volume of the cavity depends on most."""

STILL = 1e-9
"""What varies by no more does not vary."""

STEEP = 0.9
"""Quantile of the sizes of slopes, from which on a simulation weighs less: a few soft and thin
walls answer ten times as much as all others."""


def surroundings(coordinates: Coordinates, segment: int, turn: float = 0.0) -> np.ndarray:
    """What a network sees (F, P), of P scaled coordinates, around an AHA segment: of each level as
    many values as it has segments, from the angle of that one on, or from the anterior wall as seen
    from the apex; `turn` (rad) is added to it."""
    rows = np.eye(len(coordinates))
    rings = [numbers for numbers in LEVELS.values() if len(numbers) > 1]
    level = next((ring for ring in rings if segment in ring), None)
    start = turn if level is None else turn + _angles(level)[level.index(segment)]
    found, seen = [], np.zeros(len(coordinates), dtype=bool)
    for places in coordinates.fields.values():
        wall = np.stack([rows[list(at)].sum(0) for at in places])
        seen |= wall.any(0)
        found += [_turned(ring, start) @ wall[[s - 1 for s in ring]] for ring in rings]
        found.append(wall[[APEX - 1]])
    return np.concatenate([*found, rows[~seen]])


def _angles(ring: range) -> np.ndarray:
    """Of the middles of a level's segments, from the anterior wall's on (rad)."""
    return 2 * np.pi * np.arange(len(ring)) / len(ring)


def _turned(ring: range, start: float) -> np.ndarray:
    """Weights (n, n) of a level's n segments, n even, in the values at their angles plus `start`;
    between segments by waves around the axis (trigonometric interpolation)."""
    angles, most = _angles(ring), len(ring) // 2
    apart = start + angles[:, None] - angles
    waves = [np.cos(number * apart) for number in range(1, most)]
    return ((1 + 2 * sum(waves) + np.cos(most * apart)) / len(ring)).round(12)


class Discs:
    """Logarithm of the volume (...) of the unloaded cavity as discs, one for each segment, of the
    radius that it has, at scaled coordinates z (..., P): most of what volumes of ventricles of
    other shapes differ by.

    there: whether radii of all segments, and the ends of the levels, are inputs.
    """

    def __init__(self, coordinates: Coordinates):
        radii = coordinates.fields.get(RADIUS, ())
        self.there = bool(radii) and all(radii) and {*LEVEL_ENDS} <= {*coordinates.names}
        if self.there:
            self._coordinates = coordinates
            self._radii = [at[0] for at in radii]
            self._ends = [coordinates.names.index(name) for name in LEVEL_ENDS]

    def __call__(self, z: torch.Tensor) -> torch.Tensor:
        x = self._coordinates.natural(z)
        squares, ends = x[..., self._radii].square(), x[..., self._ends]
        depths = torch.diff(ends, prepend=torch.zeros_like(ends[..., :1]))
        depths = torch.cat([depths, 1 - ends[..., -1:]], -1)
        areas = [squares[..., [s - 1 for s in ring]].mean(-1) for ring in LEVELS.values()]
        return (depths * torch.stack(areas, -1)).sum(-1).log()

    def with_slopes(self, z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The same, and its derivatives (..., P)."""
        with torch.enable_grad():
            here = z.detach().requires_grad_(True)
            value = self(here)
            (slopes,) = torch.autograd.grad(value.sum(), here)
        return value.detach(), slopes


@dataclass
class Ring:
    """Outputs that one network predicts.

    outputs (S, C): places of C outputs in each of S segments; or (1, C), of the mean over these.
    maps (S, F, P): what it sees there. levels (S, L): 1 for the level of each segment, where there
    are several. centre, spread (F,): of what it sees; offset, scale (C,): of the outputs.
    """

    outputs: torch.Tensor
    maps: torch.Tensor
    levels: torch.Tensor
    centre: torch.Tensor
    spread: torch.Tensor
    offset: torch.Tensor
    scale: torch.Tensor

    @classmethod
    def of(cls, group: "Group", coordinates: Coordinates) -> "Ring":
        """What it sees and predicts as it is."""
        maps = np.stack([surroundings(coordinates, *place) for place in group.seen_from])
        of_level = np.array(
            [[segment in ring for ring in LEVELS.values()] for segment, _ in group.seen_from]
        )
        several = of_level.any(0).sum() > 1
        levels = torch.as_tensor(of_level[:, of_level.any(0) & several]).double()
        sizes = maps.shape[1], group.outputs.shape[1]
        standards = [make(n).double() for n in sizes for make in (torch.zeros, torch.ones)]
        outputs = torch.as_tensor(group.outputs)
        return cls(outputs, torch.as_tensor(maps), levels, *standards)

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers that the network has to be given, and that it gives."""
        return self.maps.shape[1] + self.levels.shape[1], self.outputs.shape[1]

    @property
    def pooled(self) -> bool:
        """Whether an output is the mean over segments."""
        return len(self.outputs) < len(self.maps)

    def seen(self, z: torch.Tensor) -> torch.Tensor:
        """What the network sees at z (..., P), standardised: (..., S, F + L)."""
        seen = (z @ self.maps.flatten(0, 1).T).reshape(*z.shape[:-1], *self.maps.shape[:2])
        levels = self.levels.expand(*z.shape[:-1], -1, -1)
        return torch.cat([(seen - self.centre) / self.spread, levels], -1)


@dataclass(frozen=True)
class Group:
    """Outputs that one network predicts: their places, as of `Ring`, and from where it looks, AHA
    segments and turns (rad) of `surroundings`."""

    seen_from: list[tuple[int, float]]
    outputs: np.ndarray


def groups_of(outputs: Sequence[str]) -> list[Group]:
    """By network: outputs of all segments of a level together; of the heart as a whole; of the
    apex, which sees no difference if all is turned by half a turn; and what is left."""
    channels, left = Channels.parse(outputs), dict(enumerate(outputs))
    found: list[Group] = []
    rings = [ring for ring in LEVELS.values() if len(ring) > 1]
    for ring in rings:
        columns = []
        kinds = dict.fromkeys((one.quantity, one.load_fraction) for one in channels)
        for kind in kinds:
            at = {
                one.segment: d
                for d, one in enumerate(channels)
                if (one.quantity, one.load_fraction) == kind and one.segment in ring
            }
            if len(at) == len(ring):
                columns.append([at[segment] for segment in ring])
        if columns:
            found.append(Group([(segment, 0.0) for segment in ring], np.array(columns).T))
            for d in np.ravel(columns):
                del left[d]
    everywhere = [(segment, 0.0) for ring in rings for segment in ring]
    of_the_apex = [(APEX, 0.0), (APEX, np.pi)]
    segments = [one.segment for one in channels]
    for seen_from, which in ((everywhere, None), (of_the_apex, APEX)):
        places = [d for d in left if segments[d] == which]
        if places:
            found.append(Group(seen_from, np.array([places])))
            for d in places:
                del left[d]
    if left:
        found.append(Group([(APEX, 0.0)], np.array([list(left)])))
    return found


class Network(torch.nn.Module):
    """From F numbers to C, with residual layers, in single precision: three times as fast, and it
    changes an output by a millionth of its sd."""

    def __init__(self, inputs: int, outputs: int, width: int, layers: int):
        super().__init__()
        sizes = [inputs, *[width] * layers]
        self.layers = torch.nn.ModuleList([torch.nn.Linear(*pair) for pair in pairwise(sizes)])
        self.last = torch.nn.Linear(width, outputs)
        self.linear = torch.nn.Linear(inputs, outputs, bias=False)

    @property
    def dtype(self) -> torch.dtype:
        return self.last.weight.dtype

    def forward(self, u: torch.Tensor) -> torch.Tensor:
        first, *others = self.layers
        hidden = torch.nn.functional.silu(first(u))
        for layer in others:
            hidden = hidden + torch.nn.functional.silu(layer(hidden))
        return self.last(hidden) + self.linear(u)

    def with_slopes(self, u: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs (..., C) at u (..., F), and their derivatives (..., C, F)."""
        first, *others = self.layers
        before = [first(u)]
        hidden = torch.nn.functional.silu(before[0])
        for layer in others:
            before.append(layer(hidden))
            hidden = hidden + torch.nn.functional.silu(before[-1])
        rates = [_silu_slope(each)[..., None, :] for each in before]
        back = self.last.weight.expand(*u.shape[:-1], -1, -1)
        for layer, rate in zip(others[::-1], rates[:0:-1], strict=True):
            back = back + (back * rate) @ layer.weight
        slopes = (back * rates[0]) @ first.weight + self.linear.weight
        return self.last(hidden) + self.linear(u), slopes


def _silu_slope(x: torch.Tensor) -> torch.Tensor:
    share = torch.sigmoid(x)
    return share * (1 + x * (1 - share))


class SegmentNetworks:
    """Outputs v (M, D) at scaled coordinates z (M, P), by networks for each of `rings`.

    Attributes: outputs, their names (D).

    Parameters
    ----------
    coordinates: of the inputs. width, layers: of each network. members: networks of a ring, of
    other seeds, of which the mean counts: what they err by from chance averages out
    (Lakshminarayanan et al. 2017, arXiv 1612.01474).
    """

    def __init__(
        self,
        coordinates: Coordinates,
        outputs: Sequence[str],
        width: int,
        layers: int,
        members: int,
    ):
        self.outputs, self._shape = tuple(outputs), (width, layers, members)
        self._discs = Discs(coordinates)
        volumes = Channels.parse(outputs).of_quantity("volume")
        self._volumes = np.flatnonzero(volumes & self._discs.there)
        self.rings = [Ring.of(group, coordinates) for group in groups_of(outputs)]
        self.networks = [[self._network(ring) for _ in range(members)] for ring in self.rings]

    def _network(self, ring: Ring) -> Network:
        width, layers, _ = self._shape
        # One that is asked about all segments costs as much as all others, and errs no more.
        width = width // 2 if ring.levels.numel() else width
        return Network(*ring.sizes, width, layers)

    def fit(
        self, z: torch.Tensor, v: torch.Tensor, slopes: torch.Tensor, passes: int, seed: int
    ) -> "SegmentNetworks":
        """Learn from n simulations: outputs v (n, D) at z (n, P), and dv/dz (n, D, P); `passes`
        times through them. Returns itself."""
        if len(self._volumes):
            v, slopes = v.clone(), slopes.clone()
            known, its_slopes = self._discs.with_slopes(z)
            v[:, self._volumes] -= known[:, None]
            slopes[:, self._volumes] -= its_slopes[:, None]
        *_, members = self._shape
        for number, ring in enumerate(self.rings):
            started = time.monotonic()
            _standardise(ring, z, v)
            more = MORE_PASSES if len(ring.maps) <= FEW else 1
            seeds = [derive(seed, f"network {number} {member}") for member in range(members)]
            given = ring, z, v, slopes, more * passes
            self.networks[number] = [self._trained(*given, of_member) for of_member in seeds]
            log.info(
                "network %d of %d: trained on %d simulations in %.0f s",
                number + 1,
                len(self.rings),
                len(z),
                time.monotonic() - started,
            )
        return self

    def _trained(self, ring: Ring, z, v, slopes, passes: int, seed: int) -> Network:
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            network = self._network(ring)
            _train(network, ring, z, v, slopes, passes)
        return network.requires_grad_(False)

    def __call__(self, z: torch.Tensor) -> torch.Tensor:
        """(..., D), differentiable."""
        found = z.new_empty(*z.shape[:-1], len(self.outputs))
        for ring, networks in zip(self.rings, self.networks, strict=True):
            seen = ring.seen(z).to(networks[0].dtype)
            values = sum(network(seen).double() for network in networks) / len(networks)
            values = values.mean(-2, keepdim=True) if ring.pooled else values
            found[..., ring.outputs] = ring.offset + ring.scale * values
        if len(self._volumes):
            found[..., self._volumes] += self._discs(z)[..., None]
        return found

    @torch.no_grad()
    def with_slopes(self, z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """v (..., D), and dv/dz (..., D, P)."""
        found = z.new_empty(*z.shape[:-1], len(self.outputs))
        slopes = z.new_empty(*found.shape, z.shape[-1])
        for ring, networks in zip(self.rings, self.networks, strict=True):
            seen = ring.seen(z).to(networks[0].dtype)
            parts = zip(*[network.with_slopes(seen) for network in networks], strict=True)
            values, by_seen = (sum(each).double() / len(networks) for each in parts)
            by_seen = by_seen[..., : len(ring.spread)] / ring.spread * ring.scale[:, None]
            by_z = by_seen @ ring.maps
            if ring.pooled:
                values, by_z = values.mean(-2, keepdim=True), by_z.mean(-3, keepdim=True)
            found[..., ring.outputs] = ring.offset + ring.scale * values
            slopes[..., ring.outputs, :] = by_z
        if len(self._volumes):
            known, its_slopes = self._discs.with_slopes(z)
            found[..., self._volumes] += known[..., None]
            slopes[..., self._volumes, :] += its_slopes[..., None, :]
        return found, slopes

    def content(self) -> dict:
        """What `from_content` needs beside the coordinates, in tensors and plain values."""
        return {
            "outputs": self.outputs,
            "shape": self._shape,
            "standards": [
                [ring.centre, ring.spread, ring.offset, ring.scale] for ring in self.rings
            ],
            "networks": [[each.state_dict() for each in networks] for networks in self.networks],
        }

    @classmethod
    def from_content(cls, content: dict, coordinates: Coordinates) -> "SegmentNetworks":
        """Those of whose `content` this is, of the inputs with these coordinates."""
        found = cls(coordinates, content["outputs"], *content["shape"])
        for ring, standards in zip(found.rings, content["standards"], strict=True):
            ring.centre, ring.spread, ring.offset, ring.scale = standards
        for networks, states in zip(found.networks, content["networks"], strict=True):
            for network, state in zip(networks, states, strict=True):
                network.load_state_dict(state)
                network.requires_grad_(False)
        return found


def out_of_fold(
    make: Callable[[], SegmentNetworks],
    z: torch.Tensor,
    v: torch.Tensor,
    slopes: torch.Tensor,
    passes: int,
    folds: int,
    seed: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    """What networks that did not learn from a simulation leave of it: v (n, D) and dv/dz
    (n, D, P), each by networks of its fold. The arguments are those of `SegmentNetworks.fit`."""
    fold = torch.as_tensor(np.random.default_rng(seed).permutation(len(z)) % folds)
    values_left, slopes_left = v.clone(), slopes.clone()
    for number in range(folds):
        log.info("networks for the errors, part %d of %d", number + 1, folds)
        rest, own = fold != number, fold == number
        networks = make().fit(z[rest], v[rest], slopes[rest], passes, derive(seed, str(number)))
        for part in own.nonzero()[:, 0].split(BATCH):
            values, by_z = networks.with_slopes(z[part])
            values_left[part] -= values
            slopes_left[part] -= by_z
    return values_left, slopes_left


def _standardise(ring: Ring, z: torch.Tensor, v: torch.Tensor) -> None:
    """Set what a ring's network sees and predicts to mean 0 and sd 1 over all of its segments."""
    ring.centre, ring.spread = _standards(torch.einsum("np,sfp->nsf", z, ring.maps))
    ring.offset, ring.scale = _standards(v[:, ring.outputs])


def _standards(values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and sd (K,) of values (n, S, K), an sd of 1 for what does not vary."""
    sd = values.std((0, 1))
    return values.mean((0, 1)), torch.where(sd > STILL, sd, torch.ones_like(sd))


def _train(network: Network, ring: Ring, z, v, slopes, passes: int) -> None:
    """Least squares of values and of derivatives, alike in weight; of derivatives of one of the
    outputs in each step, drawn at random, which costs a third."""
    inputs = z.std(0)
    maps = (ring.maps / ring.spread[:, None] * inputs).float()
    seen = ring.seen(z).float()
    values = ((v[:, ring.outputs] - ring.offset) / ring.scale).float()
    slopes = (slopes[:, ring.outputs] / ring.scale[:, None] * inputs).float()
    # By segment of a simulation: what is steep weighs less.
    steep = slopes.square().sum(-1).mean(-1)
    weight = (steep.quantile(STEEP) / steep).clamp(max=1.0)
    of_slopes = 1 / (weight[..., None, None] * slopes.square()).sum(-1).mean()
    n, outputs = len(z), ring.outputs.shape[1]
    batch = min(BATCH, -(-n // LEAST_STEPS))
    # The schedule's warm-up may not be of exactly one step, whose length is then zero.
    steps = max(passes * -(-n // batch), round(1 / WARM_UP) + 1)
    layers = [layer.weight for layer in network.layers]
    others = [each for each in network.parameters() if all(each is not one for one in layers)]
    optimisers = (
        torch.optim.AdamW(others, lr=LARGEST_STEP, weight_decay=DECAY),
        torch.optim.Muon(
            layers,
            lr=LARGEST_OF_LAYERS,
            weight_decay=DECAY_OF_LAYERS,
            adjust_lr_fn="match_rms_adamw",
        ),
    )
    schedules = [
        torch.optim.lr_scheduler.OneCycleLR(
            optimiser, largest, total_steps=steps, pct_start=WARM_UP, cycle_momentum=False
        )
        for optimiser, largest in zip(optimisers, (LARGEST_STEP, LARGEST_OF_LAYERS), strict=True)
    ]
    for _ in range(passes):
        for rows in torch.randperm(n).split(batch):
            u = seen[rows].requires_grad_(True)
            found = network(u)
            found = found.mean(1, keepdim=True) if ring.pooled else found
            error = (found - values[rows]).square().mean(-1)
            c = int(torch.randint(outputs, ()))
            (by_seen,) = torch.autograd.grad(found[..., c].sum(), u, create_graph=True)
            by_z = torch.einsum("nsf,sfp->nsp", by_seen[..., : maps.shape[1]], maps)
            by_z = by_z.sum(1, keepdim=True) if ring.pooled else by_z
            along = by_z - slopes[rows][:, :, c]
            loss = (weight[rows].sqrt() * error).mean()
            loss = loss + of_slopes * (weight[rows] * along.square().sum(-1)).mean()
            network.zero_grad()
            loss.backward()
            for optimiser, schedule in zip(optimisers, schedules, strict=True):
                optimiser.step()
                schedule.step()
