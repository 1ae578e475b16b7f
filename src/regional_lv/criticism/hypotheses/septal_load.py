"""The right ventricle's pressure on the septum."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis


class SeptalLoad(SimulatorHypothesis):
    name = "septal_load"
    parameter = "right-ventricular pressure"
    unit = "mmHg"
    base, low, high = 0.0, 0.0, 6.0
    path = ("loading", "septal_pressure_mmhg")
    in_the_form = True
    nodes = (1.5, 3.5, 6.0)  # further apart, Newton's method needs steps in between
    description = (
        "The septum is filled from both sides: the right ventricle's end-diastolic pressure, a "
        "few mmHg in health and more with pulmonary hypertension, pushes it into the left cavity. "
        "The base model leaves the septum's outside free. Psi acts as a dead load along the "
        "normal of the unloaded epicardium of segments 2, 3, 8 and 9: the septum strains less, "
        "the cavity holds less. At lower loads both pressures are lower alike."
    )
    source = (
        "Little et al. 1984, Circ Res 54:719-730, doi 10.1161/01.RES.54.6.719; right-heart "
        "pressures: Rudski et al. 2010, doi 10.1016/j.echo.2010.05.010"
    )
