"""One simulator of the small heart, and solved states of it."""

import numpy as np
import pytest

from regional_lv.inputs.physics import physics_of
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.simulation.batches import make_simulator

PRESSURE = 8.0
THETA = np.array([1.3, 0.8, 0.9, 1.2, 0.7, 1.5, 2.0, 0.6, 1.1, 1.0])


@pytest.fixture(scope="session")
def physics(smoke_config):
    return physics_of(smoke_config)


@pytest.fixture(scope="session")
def simulator(small_mesh, physics):
    return make_simulator(small_mesh, physics)


@pytest.fixture(scope="session")
def solver(simulator, physics):
    return Solver(simulator, physics["solver"])


@pytest.fixture(scope="session")
def solved(solver):
    """Equilibrium at a theta that treats no two zones alike."""
    return solver.inflate(THETA, PRESSURE, Effort())
