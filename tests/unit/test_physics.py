"""What simulations depend on, out of a configuration."""

from regional_lv import config
from regional_lv.inputs.physics import physics_of
from regional_lv.inputs.stiffness import StiffnessInputs
from tests.unit.configurations import changed


def test_physics_is_what_the_simulator_is_made_from():
    loaded = config.load(changed("geometry.wall_thickness_scale", 1.1))
    described = physics_of(loaded)
    assert described["geometry"] == {"wall_thickness_scale": 1.1}
    assert StiffnessInputs.from_spec(described["parameters"]) == StiffnessInputs()
    assert described["supports"] == loaded["supports"]
