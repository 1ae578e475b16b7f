"""Guccione's transversely isotropic exponential law of passive myocardium."""

from regional_lv.mechanics.materials.base import Constant, Factor, Material


class Guccione(Material):
    """W = c/2 (exp Q - 1), Q = b_f E_ff^2 + b_t (E_ss^2 + E_nn^2 + 2 E_sn^2)
    + 2 b_fs (E_fs^2 + E_fn^2), E = (F^T F - I) / 2 about fibre, sheet and normal."""

    name = "guccione"
    source = (
        "Guccione, McCulloch and Waldman 1991, doi 10.1115/1.2894084 (values of its table for the "
        "canine left ventricle); form of Land et al. 2015, doi 10.1098/rspa.2015.0641"
    )
    has_sheets = False
    factors = (
        Factor("C_c", "scales c", scales_stress=True),
        Factor("C_b", "scales the exponents b_f, b_t and b_fs"),
    )
    constants = (
        Constant("c_kpa", 0.876, "kPa", "C_c", "stiffness"),
        Constant("b_f", 18.48, "1", "C_b", "exponent along the fibres"),
        Constant("b_t", 3.58, "1", "C_b", "exponent across the fibres"),
        Constant("b_fs", 1.627, "1", "C_b", "exponent of the shear with the fibres"),
    )

    def energy(self, F, fibre, sheet, constants):
        """As in the base class. With Q quadratic the unloaded state is free of stress."""
        import ufl

        k, E = constants, (F.T * F - ufl.Identity(3)) / 2
        total = ufl.inner(E, E)
        along = E * fibre
        shared, axial = ufl.dot(along, along), ufl.dot(fibre, along) ** 2
        # Across the fibres the law is isotropic: what is neither axial nor shear with them.
        exponent = (
            k["b_f"] * axial
            + k["b_t"] * (total - 2 * shared + axial)
            + 2 * k["b_fs"] * (shared - axial)
        )
        return k["c_kpa"] / 2 * (ufl.exp(exponent) - 1)
