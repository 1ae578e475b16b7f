"""Holzapfel and Ogden's orthotropic law of passive myocardium, the paper's."""

from regional_lv.mechanics.materials.base import Constant, Factor, Material


class HolzapfelOgden(Material):
    """Matrix, fibres, sheets and their shear, each an exponential (the paper's equation 1).

    The references of the factors were found by the rule `calibrate_reference` on volumes and mean
    strains of the published simulations: unscaled, the wall is far too stiff for the paper's
    baseline.
    """

    name = "holzapfel_ogden"
    source = (
        "Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091; values: Wang et al. 2013, "
        "doi 10.1002/cnm.2497"
    )
    factors = (
        Factor("C_a", "scales a, a_f, a_s and a_fs", 0.2572, scales_stress=True),
        Factor("C_b", "scales the exponents b, b_f, b_s and b_fs", 0.4834),
    )
    constants = (
        Constant("a_kpa", 0.2362, "kPa", "C_a", "matrix"),
        Constant("b", 10.81, "1", "C_b", "exponent of the matrix"),
        Constant("a_f_kpa", 20.037, "kPa", "C_a", "fibres"),
        Constant("b_f", 14.154, "1", "C_b", "exponent of the fibres"),
        Constant("a_s_kpa", 3.7245, "kPa", "C_a", "sheets"),
        Constant("b_s", 5.1645, "1", "C_b", "exponent of the sheets"),
        Constant("a_fs_kpa", 0.4108, "kPa", "C_a", "shear of fibres and sheets"),
        Constant("b_fs", 11.3, "1", "C_b", "exponent of the shear"),
    )

    def energy(self, F, fibre, sheet, constants):
        """As in the base class. The term -a ln J changes only the Lagrange multiplier; with it the
        unloaded state is free of stress at multiplier zero. Fibres and sheets carry no
        compression: max(I4, 1) in the paper's equation (1)."""
        import ufl

        k, C = constants, F.T * F
        energy = k["a_kpa"] / (2 * k["b"]) * (ufl.exp(k["b"] * (ufl.tr(C) - 3)) - 1)
        energy -= k["a_kpa"] * ufl.ln(ufl.det(F))
        for direction, a, b in ((fibre, "a_f_kpa", "b_f"), (sheet, "a_s_kpa", "b_s")):
            stretch = ufl.dot(direction, C * direction) - 1
            tension = ufl.conditional(ufl.gt(stretch, 0), stretch, 0)
            energy += k[a] / (2 * k[b]) * (ufl.exp(k[b] * tension**2) - 1)
        shear = ufl.dot(fibre, C * sheet)
        return energy + k["a_fs_kpa"] / (2 * k["b_fs"]) * (ufl.exp(k["b_fs"] * shear**2) - 1)
