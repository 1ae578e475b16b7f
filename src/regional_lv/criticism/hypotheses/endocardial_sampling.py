"""Strains seen nearer to the endocardium than the wall's mean."""

from regional_lv.criticism.hypotheses.base import ObservationHypothesis


class EndocardialSampling(ObservationHypothesis):
    name = "endocardial_sampling"
    parameter = "share of the endocardial third"
    unit = "1"
    base, low, high = 0.0, 0.0, 1.0
    section, key = "observables", "endocardial_share"
    nodes = (1.0,)
    description = (
        "Strain differs through the wall: filling stretches the endocardium about twice as much "
        "as the epicardium. Images sample the wall unevenly: tracked features lie on the "
        "endocardial border, where the contrast is. Psi mixes linearly from the wall's mean (0) "
        "to the mean over its endocardial third (1)."
    )
    source = (
        "Waldman et al. 1985, Circ Res 57:152-163, doi 10.1161/01.RES.57.1.152; Claus et al. "
        "2015, JACC Cardiovasc Imaging 8:1444-1460, doi 10.1016/j.jcmg.2015.11.001"
    )

    def why_not(self, physics):
        if physics["observables"]["region"] == "endocardium":
            return "observables.region is the endocardium already"
        return super().why_not(physics)
