"""What is observed: a quantity at a place and a load, and the list of them that a study observes.

A channel is known everywhere by its name, which is the column of every table: `volume_ml`,
`circumferential_07`, `torsion_basal-apical`, and with the load fraction behind it where that is not
the end-diastolic one, `circumferential_07@0.5`. `Channel.parse` reads the name again.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from regional_lv.aha import level_of
from regional_lv.errors import InputError
from regional_lv.quantities import QUANTITIES, Quantity

DEFAULT_QUANTITIES = ("volume", "circumferential", "radial", "longitudinal")


@dataclass(frozen=True)
class Channel:
    """One observed number.

    quantity: a name of `QUANTITIES`. place: one of the quantity's places. load_fraction: share of
    the end-diastolic pressure at which it is observed, above 0 and at most 1.
    """

    quantity: str
    place: str = ""
    load_fraction: float = 1.0

    @property
    def kind(self) -> type[Quantity]:
        """The class of its quantity."""
        return QUANTITIES[self.quantity]

    @property
    def name(self) -> str:
        """Column of the tables."""
        return at_load(self.kind.column_of(self.place), self.load_fraction)

    @property
    def unit(self) -> str:
        return self.kind.unit

    @property
    def sign(self) -> int:
        """-1 or 1 where values of a filling ventricle have that sign, else 0."""
        return self.kind.sign

    @property
    def segment(self) -> int | None:
        """AHA number of a segment's channel, else None."""
        return int(self.place) if self.place.isdigit() else None

    @property
    def level(self) -> str:
        """Level of a segment's channel, else empty."""
        return "" if self.segment is None else level_of(self.segment)

    @classmethod
    def parse(cls, name: str) -> "Channel":
        """The channel of a column. Raises InputError for a name that is none."""
        column, at, fraction = name.partition("@")
        try:
            load = float(fraction) if at else 1.0
        except ValueError:
            load = np.nan  # at no load
        for quantity, kind in QUANTITIES.items():
            stem = kind.column_of("")
            if column == stem or column.startswith(f"{stem}_"):
                place = column[len(stem) + 1 :]
                if place in kind.places and 0 < load <= 1:
                    return cls(quantity, place, load)
        raise InputError(
            f"{name}: not the name of a channel; give for instance volume_ml, circumferential_07 "
            "or circumferential_07@0.5"
        )


def at_load(column: str, fraction: float) -> str:
    """The column of a quantity at a load fraction, `volume_ml@0.5`; at full load as it is."""
    return column if fraction == 1 else f"{column}@{fraction:g}"


class Channels(Sequence):
    """The channels of a study, D of them: by load, the full one first, then by quantity and place.

    Iterating gives `Channel`s; `names` are the columns of every table.
    """

    def __init__(self, channels: Iterable[Channel]):
        self._channels = tuple(channels)
        if len(set(self.names)) < len(self._channels):
            twice = sorted({n for n in self.names if self.names.count(n) > 1})
            raise InputError(f"channels: {', '.join(twice)} is listed twice; name each once")

    @classmethod
    def of(
        cls,
        quantities: Sequence[str] = DEFAULT_QUANTITIES,
        places: Mapping[str, Sequence[str]] | None = None,
        load_fractions: Sequence[float] = (),
    ) -> "Channels":
        """All places of some quantities, at end diastole and at further load fractions.

        places: by quantity, those that are observed; a quantity that is not named has its default
        ones. load_fractions: rising, between 0 and 1.

        Raises InputError for a quantity or a place that there is not, and for a load fraction
        outside (0, 1).
        """
        places = {name: [str(p) for p in some] for name, some in (places or {}).items()}
        for name in places:
            if name not in quantities:
                raise InputError(
                    f"observables.places.{name}: {name} is not observed; add it to "
                    "observables.quantities or remove it here"
                )
        for fraction in load_fractions:
            if not 0 < fraction < 1:
                raise InputError(
                    f"loading.frames: {fraction:g} is no load fraction between 0 and 1; end "
                    "diastole, 1, is observed anyway"
                )
        wanted = []
        for name in quantities:
            kind = QUANTITIES[name]
            some = places.get(name, kind.default_places or kind.places)
            wanted += [(name, _known_place(kind, place)) for place in some]
        return cls(
            Channel(name, place, float(fraction))
            for fraction in (1.0, *sorted(load_fractions, reverse=True))
            for name, place in wanted
        )

    @classmethod
    def from_config(cls, config: Mapping) -> "Channels":
        """From a checked configuration: its sections `observables` and `loading`."""
        observed = config["observables"]
        for name in observed["scale"]:
            if name not in observed["quantities"]:
                raise InputError(
                    f"observables.scale.{name}: {name} is not observed; add it to "
                    "observables.quantities or remove it here"
                )
        return cls.of(observed["quantities"], observed["places"], config["loading"]["frames"])

    @classmethod
    def parse(cls, names: Iterable[str]) -> "Channels":
        """The channels of columns, in their order. Raises InputError for a name that is none."""
        return cls(Channel.parse(name) for name in names)

    # ------------------------------------------------------------------------------ a sequence

    def __len__(self) -> int:
        return len(self._channels)

    def __getitem__(self, at):
        return self._channels[at]

    def __iter__(self) -> Iterator[Channel]:
        return iter(self._channels)

    def __contains__(self, name) -> bool:
        """Whether a name (or a Channel) is among them."""
        return (name.name if isinstance(name, Channel) else name) in self.names

    def __eq__(self, other) -> bool:
        return isinstance(other, Channels) and self.names == other.names

    def __hash__(self) -> int:
        return hash(self.names)

    def __repr__(self) -> str:
        return f"Channels({', '.join(self.names)})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Columns (D) of the tables."""
        return tuple(channel.name for channel in self._channels)

    # --------------------------------------------------------------------------------- parts

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities, in the order in which they first appear."""
        return tuple(dict.fromkeys(channel.quantity for channel in self))

    @property
    def load_fractions(self) -> tuple[float, ...]:
        """The loads at which something is observed, the largest first."""
        return tuple(sorted({channel.load_fraction for channel in self}, reverse=True))

    def of_quantity(self, quantity: str) -> np.ndarray:
        """Mask (D,) of one quantity's channels."""
        return np.array([channel.quantity == quantity for channel in self], dtype=bool)

    def at(self, load_fraction: float) -> np.ndarray:
        """Mask (D,) of the channels at one load."""
        return np.array([channel.load_fraction == load_fraction for channel in self], dtype=bool)

    @cached_property
    def is_strain(self) -> np.ndarray:
        """Mask (D,) of the wall strains."""
        return np.array([channel.kind.is_strain for channel in self], dtype=bool)

    @cached_property
    def segments(self) -> np.ndarray:
        """AHA numbers (D,), 0 for what belongs to no segment."""
        return np.array([channel.segment or 0 for channel in self], dtype=int)


def _known_place(kind: type[Quantity], place: str) -> str:
    place = place.zfill(2) if place.isdigit() else place
    if place not in kind.places:
        offered = ", ".join(kind.places) if kind.places != ("",) else "none"
        raise InputError(
            f"observables.places.{kind.name}: {place!r} is no place of it; there are {offered}"
        )
    return place
