"""Inputs of the observation: where in the wall strains are seen, and which strains they are."""

from regional_lv.inputs.base import KeyInput
from regional_lv.inputs.keys import with_value
from regional_lv.quantities import QUANTITIES

WALDMAN = (
    "Waldman et al. 1985, Circ Res 57:152-163, doi 10.1161/01.RES.57.1.152; Claus et al. 2015, "
    "JACC Cardiovasc Imaging 8:1444-1460, doi 10.1016/j.jcmg.2015.11.001"
)
HILL = "Hill 1968, J Mech Phys Solids 16:229-242, doi 10.1016/0022-5096(68)90031-8"


class ObservationInput(KeyInput):
    """A number of the section `observables`, which the wall strains depend on."""

    family = "observation"

    @classmethod
    def why_not(cls, model):
        if not any(QUANTITIES[name].is_strain for name in model["observables"]["quantities"]):
            return "no strain is observed (observables.quantities)"
        return ""


class LayerInput(ObservationInput):
    """The share of the layer that is seen (`observables.layer`) which is cut off at one side."""

    path = ("observables", "layer")
    low, high = least, most = 0.0, 1.0

    def value_in(self, model):
        return 0.0


class EndocardialSampling(LayerInput):
    name = "endocardial_sampling"
    parameter = "share of the wall, from the outside, that is not seen"
    description = (
        "Filling stretches the endocardium about twice as much as the epicardium. Tracked features "
        "lie on the endocardial border, where the contrast is: the window shrinks from the whole "
        "wall (0) to the endocardium itself (1), and strains get larger."
    )
    source = WALDMAN

    def act(self, model, value):
        inner, outer = model["observables"]["layer"]
        return with_value(model, self.path, (inner, outer - value * (outer - inner)))


class EpicardialSampling(LayerInput):
    name = "epicardial_sampling"
    parameter = "share of the wall, from the inside, that is not seen"
    description = (
        "Where the endocardial border is lost among trabeculae and papillary muscles, what is "
        "tracked lies in the outer wall: the window shrinks from the whole wall (0) to the "
        "epicardium itself (1), and strains get smaller."
    )
    source = WALDMAN

    def act(self, model, value):
        inner, outer = model["observables"]["layer"]
        return with_value(model, self.path, (inner + value * (outer - inner), outer))


class StrainMeasure(ObservationInput):
    name = "strain_measure"
    path = ("observables", "strain_exponent")
    parameter = "exponent of the strain measure (Seth-Hill)"
    low, high = -3.0, 3.0
    description = (
        "(l^n - 1) / n of the stretch l: n = 2 for Green's strain, 1 for the nominal one, 0 for "
        "the logarithmic one, -2 for Almansi's. Codes and image software report any of them, and "
        "do not always say which."
    )
    source = (
        "Seth 1964, in: Second-order effects in elasticity, plasticity and fluid dynamics; "
        f"{HILL}; in imaging: Amzulescu et al. 2019, doi 10.1093/ehjci/jez041"
    )


class LineStrain(ObservationInput):
    name = "line_strain"
    path = ("observables", "line_share")
    parameter = "share of the material line's strain"
    low, high = least, most = 0.0, 1.0
    description = (
        "A code reports the component of a strain tensor along a direction; an image shows how "
        "much longer a line of tissue along that direction became. Mixes linearly from the "
        "tensor's component (0) to the line's strain (1), which are the same of Green's strain."
    )
    source = f"{HILL}; in imaging: {WALDMAN}"


class DirectionsOfStrain(ObservationInput):
    name = "unloaded_directions"
    path = ("observables", "unloaded_share")
    parameter = "share of the strain along directions of the unloaded state"
    low, high = least, most = 0.0, 1.0
    description = (
        "Strains are along the circumferential, radial and longitudinal directions of the "
        "end-diastolic wall (0, as in the paper), or along those of the unloaded wall, which turn "
        "with the tissue (1, as finite element codes and tagged lines have them); linear between."
    )
    source = f"{HILL}; frames of strains: {WALDMAN}"


class SegmentRotation(ObservationInput):
    name = "segment_rotation"
    path = ("observables", "segment_rotation_deg")
    parameter = "rotation of the segments"
    unit = "deg"
    low, high = -15.0, 15.0
    step = 1e-4  # mesh lines lie on the segments' borders to the nanometre: a kink at no rotation
    description = (
        "Sectors are counted from where the right ventricle meets the septum, a point that is set "
        "by hand. Turns the borders of the measured segments against the simulated ones, "
        "counter-clockwise seen from the base."
    )
    source = "Cerqueira et al. 2002, Circulation 105:539-542, doi 10.1161/hc0402.102975"
