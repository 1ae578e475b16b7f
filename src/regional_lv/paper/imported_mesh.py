"""The imported mesh as it is (Q1-P0) against the re-meshed one (quadratic): the same 52 outputs."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import RBFInterpolator

from regional_lv.aha import outputs_from_published
from regional_lv.channels import Channels
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.predictor import Known
from regional_lv.simulation.batches import make_simulator

log = logging.getLogger(__name__)


def verify_imported_mesh(
    imported: str | Path,
    remeshed: str | Path,
    inputs: str | Path,
    outputs: str | Path,
    physics: dict,
    table: str | Path,
) -> None:
    """Write the outputs on both meshes, at theta = 1 and at the first published simulation (CSV).

    Columns: output, imported, remeshed at theta = 1; imported_row_1, remeshed_row_1 and
    published_row_1 at the first row of the published inputs (10 columns, in the order of the
    paper's parameters), published outputs converted from the published order. The re-meshed heart
    is inflated from nothing; its solutions are where Newton's method begins on the imported mesh.
    """
    row = np.loadtxt(inputs, delimiter=",", max_rows=1)
    published = outputs_from_published(np.loadtxt(outputs, delimiter=",", max_rows=1))
    coarse, fine = (make_simulator(mesh, physics) for mesh in (remeshed, imported))
    log.info("unknowns: imported %d, re-meshed %d", fine.size, coarse.size)
    solver, effort = Solver(coarse, physics["solver"]), Effort()
    pressure = coarse.full_pressure
    one = solver.inflate(np.ones(len(row)), pressure, effort)
    known = Known(coarse.size, coarse.coordinates)
    known.add(one.theta, one.w, coarse.tangents(one))
    other = solver.newton(known.field(row), row, pressure, effort)
    columns: dict[str, Sequence[str] | np.ndarray] = {"output": Channels.of().names}
    for name, state in (("", one), ("_row_1", other)):
        effort = Effort()
        start = transfer(coarse, fine, state.w)
        found = Solver(fine, physics["solver"]).newton(start, state.theta, pressure, effort)
        log.info("imported%s: %d factorisations", name, effort.newton_steps)
        columns[f"imported{name}"] = fine.observables(found.w)[0]
        columns[f"remeshed{name}"] = coarse.observables(state.w)[0]
    pd.DataFrame(columns | {"published_row_1": published}).to_csv(table, index=False)


def transfer(source, target, w):
    """Field of `target` (a Simulator) that is nearest to the field `w` of `source`."""
    found = np.zeros(target.size)
    for kind in ("displacement", "pressure"):
        dofs, nodes = getattr(source, f"{kind}_dofs"), getattr(source, f"{kind}_nodes")
        # Smooth between nodes and for the fraction of a millimetre beyond them.
        field = RBFInterpolator(nodes, w[dofs], kernel="cubic")
        found[getattr(target, f"{kind}_dofs")] = field(getattr(target, f"{kind}_nodes"))
    return target.supported(found)
