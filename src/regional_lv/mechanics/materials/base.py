"""What every material law is: constants with units, factors that a zone may scale, an energy."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from regional_lv.errors import InputError


class Constant(NamedTuple):
    """One constant of a law: `name` (with its unit at the end, if it has one), reference `value`,
    `unit`, the `factor` of the law that scales it, and what it is."""

    name: str
    value: float
    unit: str
    factor: str
    description: str


class Factor(NamedTuple):
    """A number, 1 for the reference material, by which a zone scales some constants.

    reference: what it is multiplied by everywhere, so that theta = 1 is a heart as expected.
    scales_stress: whether all stresses are proportional to it.
    """

    name: str
    description: str
    reference: float = 1.0
    scales_stress: bool = False


def plain(value: float, name: str) -> float:
    """The number itself, in place of a constant of a form."""
    return float(value)


class Material(ABC):
    """An incompressible, hyperelastic wall; a new law is one file and one entry in `MATERIALS`.

    A law has exactly one factor with `scales_stress`: at several loads, in the criticism and for a
    stiff segment it stands for the wall's stiffness as a whole.

    Parameters
    ----------
    constants: by name, what differs from the law's reference values.
    references: by factor, what differs from its `reference`.

    Raises InputError for a constant or a factor that the law does not have, and for a value that is
    not positive.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    """Where law and reference values come from (citation with DOI)."""
    constants: ClassVar[tuple[Constant, ...]]
    factors: ClassVar[tuple[Factor, ...]]
    has_sheets: ClassVar[bool] = True
    """Whether the energy depends on the sheet direction."""

    def __init__(
        self,
        constants: Mapping[str, float] | None = None,
        references: Mapping[str, float] | None = None,
    ):
        self.values = {constant.name: constant.value for constant in self.constants}
        self.references = {factor.name: factor.reference for factor in self.factors}
        self._replace("constants", self.values, constants or {})
        self._replace("reference", self.references, references or {})

    def _replace(self, key: str, known: dict, given: Mapping[str, float]) -> None:
        for name, value in given.items():
            if name not in known:
                raise InputError(
                    f"material.{key}.{name}: the law {self.name} has no such entry; choose among "
                    f"{', '.join(known)}"
                )
            if not value > 0:
                raise InputError(
                    f"material.{key}.{name}: {value:g} is not positive; correct it or remove it"
                )
            known[name] = float(value)

    @classmethod
    def stress_factor(cls) -> str:
        """Name of the factor that all stresses are proportional to."""
        return next(factor.name for factor in cls.factors if factor.scales_stress)

    def scaled(self, factors: Mapping, constant=plain) -> dict:
        """The constants as the energy takes them, by name: each times its factor.

        factors: by name, UFL expressions or numbers (theta of a zone, 1 for the reference).
        constant: makes a constant of the form out of a number and its name, so that another value
        of it compiles no other form.
        """
        scale = {
            name: constant(reference, name) * factors[name]
            for name, reference in self.references.items()
        }
        return {
            c.name: constant(self.values[c.name], c.name) * scale[c.factor] for c in self.constants
        }

    @abstractmethod
    def energy(self, F, fibre, sheet, constants: Mapping):
        """Strain energy density (kPa), a UFL expression.

        F: deformation gradient. fibre, sheet: unit vectors of the unloaded wall. constants: by
        name, as `scaled` gives them. The unloaded state (F = I, multiplier p = 0) must be free of
        stress, so that Newton's method can start from nothing.
        """
