"""Strains of another measure than the model reports."""

from regional_lv.criticism.hypotheses.base import MeasureHypothesis, with_value

LINE_SHARES = {"tensor component": 0.0, "material line": 1.0}
"""What a strain can be of -> `observables.line_share`."""


class StrainMeasure(MeasureHypothesis):
    name = "strain_measure"
    parameter = "exponent of the strain measure (Seth-Hill)"
    unit = "1"
    # Almansi's (-2) and Green's (2) lie at the ends of what is in use. The range goes one further
    # on either side: an estimate that means one of them is then not at an end.
    base, low, high = 2.0, -3.0, 3.0
    path = ("observables", "strain_exponent")
    values = (-2.0, 0.0, 1.0, 2.0)
    nodes = (-2.0, 0.0, 1.0)
    order = 1
    description = (
        "Strain has many measures, which agree while it is small: (l^n - 1) / n of the stretch l, "
        "with n = 2 for Green's, 1 for the nominal (engineering) one, 0 for the logarithmic one "
        "and -2 for Almansi's. Codes and image software report any of them, and do not always say "
        "which. Where a wall thins by 40 %, Green's radial strain is 0.89, the nominal one 0.67 "
        "and the logarithmic one 0.51; shortening differs the other way. Psi is the exponent. A "
        "component of the tensor and a line of tissue have the same strain in Green's measure "
        "alone: in a study of Green's strain, the cause is another measure of one or of the other."
    )
    source = (
        "Seth 1964, in: Second-order effects in elasticity, plasticity and fluid dynamics; Hill "
        "1968, J Mech Phys Solids 16:229-242, doi 10.1016/0022-5096(68)90031-8; in imaging: "
        "Amzulescu et al. 2019, Eur Heart J Cardiovasc Imaging 20:605-619, doi "
        "10.1093/ehjci/jez041"
    )

    def for_study(self, physics):
        found = super().for_study(physics)
        if found.base == 2:
            own = physics["observables"]["line_share"]
            found.components = ("", *(of for of, share in LINE_SHARES.items() if share != own))
        return found

    def extend(self, physics, value, component=""):
        physics = super().extend(physics, value)
        if not component:
            return physics
        return with_value(physics, ("observables", "line_share"), LINE_SHARES[component])

    def strain_exponent(self, psi, own):
        return psi
