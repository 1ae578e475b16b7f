"""The imported mesh as it is (Q1-P0) against the re-meshed one (quadratic): the same 52 outputs."""

import logging

import numpy as np
import pandas as pd
from scipy.interpolate import RBFInterpolator

from regional_lv import aha
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.predictor import Known
from regional_lv.simulations import make_simulator

log = logging.getLogger(__name__)


def run(imported_vtu, remeshed_vtu, physics, inputs_csv, outputs_csv):
    """Table of the outputs on both meshes, at theta = 1 and at the first published simulation.

    Columns: output, imported, remeshed at theta = 1; imported_row_1, remeshed_row_1 and
    published_row_1 at the first row of the published inputs (10 columns, in the order of
    `aha.PARAMETERS`), published outputs converted from the published order. The re-meshed heart is
    inflated from nothing; its solutions are where Newton's method begins on the imported mesh.
    """
    row = np.loadtxt(inputs_csv, delimiter=",", max_rows=1)
    published = aha.outputs_from_published(np.loadtxt(outputs_csv, delimiter=",", max_rows=1))
    coarse, fine = (make_simulator(mesh, physics) for mesh in (remeshed_vtu, imported_vtu))
    log.info("unknowns: imported %d, re-meshed %d", fine.size, coarse.size)
    solver, effort = Solver(coarse, physics["solver"]), Effort()
    pressure = physics["loading"]["pressure_mmhg"]
    one = solver.inflate(np.ones(len(row)), pressure, effort)
    known = Known(coarse.size)
    known.add(one.theta, one.w, coarse.field_sensitivities(one.w))
    other = solver.newton(known.field(row), row, pressure, effort)
    columns = {"output": aha.OUTPUTS}
    for name, state in (("", one), ("_row_1", other)):
        effort = Effort()
        start = transfer(coarse, fine, state.w)
        found = Solver(fine, physics["solver"]).newton(start, state.theta, pressure, effort)
        log.info("imported%s: %d factorisations", name, effort.newton_steps)
        columns[f"imported{name}"] = fine.observables(found.w)
        columns[f"remeshed{name}"] = coarse.observables(state.w)
    return pd.DataFrame(columns | {"published_row_1": published})


def transfer(source, target, w):
    """Field of `target` (a Simulator) that is nearest to the field `w` of `source`."""
    found = np.zeros(target.size)
    for kind in ("displacement", "pressure"):
        dofs, nodes = getattr(source, f"{kind}_dofs"), getattr(source, f"{kind}_nodes")
        # Smooth between nodes and for the fraction of a millimetre beyond them.
        field = RBFInterpolator(nodes, w[dofs], kernel="cubic")
        found[getattr(target, f"{kind}_dofs")] = field(getattr(target, f"{kind}_nodes"))
    return target.supported(found)
