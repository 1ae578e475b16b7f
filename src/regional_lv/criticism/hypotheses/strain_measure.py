"""Nominal strains taken for Green strains."""

from regional_lv.criticism.hypotheses.base import ObservationHypothesis


class StrainMeasure(ObservationHypothesis):
    name = "strain_measure"
    parameter = "share of nominal strain"
    unit = "1"
    base, low, high = 0.0, 0.0, 1.0
    section, key = "observables", "nominal_share"
    nodes = (1.0,)
    description = (
        "Strain has many measures, which agree while it is small. Green's, (F^-T F^-1 - I) / 2, is "
        "what the model reports; codes and image software also report the nominal (engineering) "
        "strain V^-1 - I, the change of length over the length, and do not always say so. Where a "
        "wall thins by 40 %, Green's radial strain is 0.89 and the nominal one 0.67; shortening "
        "differs the other way. Psi mixes linearly from Green's (0) to the nominal strain (1)."
    )
    source = (
        "Biot 1965, Mechanics of Incremental Deformations; Hill 1968, J Mech Phys Solids "
        "16:229-242, doi 10.1016/0022-5096(68)90031-8; in imaging: Amzulescu et al. 2019, Eur "
        "Heart J Cardiovasc Imaging 20:605-619, doi 10.1093/ehjci/jez041"
    )
