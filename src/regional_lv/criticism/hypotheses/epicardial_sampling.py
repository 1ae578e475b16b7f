"""Strains seen nearer to the epicardium than the wall's mean."""

from regional_lv.criticism.hypotheses.base import LayerHypothesis, with_value


class EpicardialSampling(LayerHypothesis):
    name = "epicardial_sampling"
    parameter = "share of the wall, from the inside, that is not seen"
    description = (
        "Strain differs through the wall: filling stretches the endocardium about twice as much "
        "as the epicardium. Where the endocardial border is lost among trabeculae and papillary "
        "muscles, what is tracked lies in the outer wall. Psi is the share of the wall, from the "
        "inside, that is not seen: the window shrinks from the whole wall (0) to the epicardium "
        "itself (1), and strains get smaller."
    )
    source = (
        "Waldman et al. 1985, Circ Res 57:152-163, doi 10.1161/01.RES.57.1.152; Claus et al. "
        "2015, JACC Cardiovasc Imaging 8:1444-1460, doi 10.1016/j.jcmg.2015.11.001"
    )

    def extend(self, physics, value, component=""):
        return with_value(physics, self.path, [float(value), 1.0])
