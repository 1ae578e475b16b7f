"""Rule-based directions of fibres and sheets in the unloaded wall."""

import numpy as np
import ufl

KINDS = ("helix", "sheet")


def local_directions(transmural_gradient):
    """Circumferential, radial and longitudinal unit vectors (UFL) of the unloaded state.

    As `observables.motion.local_directions` defines them.
    """
    radial = transmural_gradient / ufl.sqrt(ufl.dot(transmural_gradient, transmural_gradient))
    horizontal = ufl.as_vector([-radial[1], radial[0], 0.0])
    circumferential = horizontal / ufl.sqrt(ufl.dot(horizontal, horizontal) + 1e-16)
    longitudinal = ufl.cross(radial, circumferential)
    return circumferential, radial, longitudinal


def fibre_directions(transmural, fibres: dict, constant):
    """Fibre and sheet unit vectors (UFL): angles linear through the wall.

    The helix angle turns the fibre from circumferential towards the base, the sheet angle turns
    the sheet from radial towards the in-wall normal of the fibre. `rotation_deg` is added to the
    helix angle at the endocardium and taken from that at the epicardium.

    fibres: section of the configuration. constant: makes a constant of the form out of a number.
    """
    circumferential, radial, longitudinal = local_directions(ufl.grad(transmural))
    turn = fibres["rotation_deg"]
    ends = {kind: [fibres[f"{kind}_{side}_deg"] for side in ("endo", "epi")] for kind in KINDS}
    ends["helix"] = [ends["helix"][0] + turn, ends["helix"][1] - turn]
    helix, tilt = (
        endo + (epi - endo) * transmural
        for endo, epi in ([constant(np.deg2rad(end)) for end in ends[kind]] for kind in KINDS)
    )
    fibre = ufl.cos(helix) * circumferential + ufl.sin(helix) * longitudinal
    across = ufl.cross(radial, fibre)
    sheet = ufl.cos(tilt) * radial + ufl.sin(tilt) * across
    return fibre, sheet
