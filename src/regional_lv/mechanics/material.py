"""Strain energy of passive myocardium (Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091)."""

from typing import NamedTuple

import ufl


class HolzapfelOgden(NamedTuple):
    """Reference constants: a-type in kPa, b-type dimensionless (Wang et al. 2013).

    `a` and `b` describe the isotropic matrix, `a_f`, `b_f` the fibres, `a_s`, `b_s` the sheets,
    `a_fs`, `b_fs` their shear coupling.
    """

    a: float
    b: float
    a_f: float
    b_f: float
    a_s: float
    b_s: float
    a_fs: float
    b_fs: float

    @classmethod
    def from_config(cls, material: dict) -> "HolzapfelOgden":
        """Read the `material` section: literature values times the calibrated global factors."""
        factor = {"a": material["factor_a"], "b": material["factor_b"]}
        return cls(
            *(
                factor[name[0]] * material[f"{name}_kpa" if name[0] == "a" else name]
                for name in cls._fields
            )
        )


def strain_energy(F, fibre, sheet, reference: HolzapfelOgden, c_a, c_b):
    """Strain energy density (kPa) of the paper's equation (1), plus a pressure-like term.

    `F` is the deformation gradient, `fibre` and `sheet` are unit reference directions, `c_a` and
    `c_b` scale the a-type and b-type constants (equation 3). The term -a ln J changes only the
    Lagrange multiplier of the incompressible material; with it the reference state is free of
    stress at multiplier zero, so that Newton's method can start from nothing.
    """
    C = F.T * F
    J = ufl.det(F)
    I1 = ufl.tr(C)
    energy = c_a * reference.a / (2 * c_b * reference.b) * (
        ufl.exp(c_b * reference.b * (I1 - 3)) - 1
    ) - c_a * reference.a * ufl.ln(J)
    for direction, a_i, b_i in (
        (fibre, reference.a_f, reference.b_f),
        (sheet, reference.a_s, reference.b_s),
    ):
        stretch = ufl.dot(direction, C * direction) - 1
        # Fibres and sheets carry no compression: max(I4, 1) in the paper's equation (1).
        tension = ufl.conditional(ufl.gt(stretch, 0), stretch, 0)
        energy += c_a * a_i / (2 * c_b * b_i) * (ufl.exp(c_b * b_i * tension**2) - 1)
    shear = ufl.dot(fibre, C * sheet)
    energy += (
        c_a
        * reference.a_fs
        / (2 * c_b * reference.b_fs)
        * (ufl.exp(c_b * reference.b_fs * shear**2) - 1)
    )
    return energy
