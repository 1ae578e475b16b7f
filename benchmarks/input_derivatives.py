"""Derivatives with respect to every input against differences of whole solutions.

    python benchmarks/input_derivatives.py config/hidden_effects.yaml

On the mesh of a configuration, at a state with springs, loads and compressibility on; torsion and
shortening are observed beside volume and strains. Prints the largest relative error of the inputs
of each kind. Five minutes of one core.
"""

import sys
import tempfile

import numpy as np

from regional_lv import config as study_config
from regional_lv.channels import DEFAULT_QUANTITIES
from regional_lv.geometry.mesh import read_mesh
from regional_lv.inputs.model import model_of
from regional_lv.inputs.space import Inputs, catalogue
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.problem import Problem
from regional_lv.session import Study
from regional_lv.verification.input_derivatives import (
    EVERYTHING_ON,
    TIGHT,
    check_derivatives,
)

THETA = (1.3, 0.8, 0.9, 1.2, 0.7, 1.5, 2.0, 0.6, 1.1, 1.0)
OBSERVED = {"quantities": [*DEFAULT_QUANTITIES, "torsion", "shortening"]}


def main(file: str) -> None:
    given = study_config.read(file)
    with tempfile.TemporaryDirectory() as folder:
        study = Study(given | {"observables": OBSERVED}, folder)
        mesh = read_mesh(study.make_heart())
    model = model_of(study.config)
    problem = Problem(mesh, Inputs(model, catalogue(model)))
    values = dict(zip(problem.inputs.names, problem.inputs.nominal, strict=True))
    values |= dict(zip(problem.parameters.names, THETA, strict=True)) | EVERYTHING_ON
    solver = Solver(problem, study.config["solver"] | TIGHT)
    start = solver.inflate(np.array(list(values.values())), problem.full_pressure, Effort())
    table = check_derivatives(solver, start)
    table["kind"] = [type(each).name for each in problem.inputs]
    print(table.groupby("kind", sort=False)["error"].agg(["size", "max"]).to_string())


if __name__ == "__main__":
    main(*sys.argv[1:])
