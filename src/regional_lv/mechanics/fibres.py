"""Rule-based directions of fibres and sheets in the unloaded wall."""

from collections.abc import Mapping

import ufl

from regional_lv.geometry.directions import KINDS, fibre_angles
from regional_lv.mechanics.materials.base import plain


def local_directions(transmural_gradient):
    """Circumferential, radial and longitudinal unit vectors (UFL) of the unloaded state.

    As `observables.motion.local_directions` defines them.
    """
    radial = transmural_gradient / ufl.sqrt(ufl.dot(transmural_gradient, transmural_gradient))
    horizontal = ufl.as_vector([-radial[1], radial[0], 0.0])
    circumferential = horizontal / ufl.sqrt(ufl.dot(horizontal, horizontal) + 1e-16)
    longitudinal = ufl.cross(radial, circumferential)
    return circumferential, radial, longitudinal


def fibre_directions(transmural, fibres: Mapping, constant=plain, turn=0.0):
    """Fibre and sheet unit vectors (UFL): angles linear through the wall.

    The helix angle turns the fibre from circumferential towards the base, the sheet angle turns
    the sheet from radial towards the in-wall normal of the fibre.

    fibres: section of the configuration. constant: makes a constant of the form out of a number
    and its name (`fibre_angles`). turn: added to the helix angle at all depths (rad), a number or a
    field.
    """
    circumferential, radial, longitudinal = local_directions(ufl.grad(transmural))
    ends = {name: constant(angle, name) for name, angle in fibre_angles(fibres).items()}
    helix, tilt = (
        ends[f"{kind}_endo"] + (ends[f"{kind}_epi"] - ends[f"{kind}_endo"]) * transmural
        for kind in KINDS
    )
    helix = helix + turn
    fibre = ufl.cos(helix) * circumferential + ufl.sin(helix) * longitudinal
    across = ufl.cross(radial, fibre)
    sheet = ufl.cos(tilt) * radial + ufl.sin(tilt) * across
    return fibre, sheet
