"""How many ventricles a scenario has, and which of their zones may be stiff."""

from collections.abc import Mapping

from regional_lv.inputs.stiffness import StiffnessInputs


def stiff_zones(scenario: Mapping, parameters: StiffnessInputs) -> tuple[str, ...]:
    """What the column `zone` of a scenario's table holds: each zone in turn, or `all`.

    scenario: an entry of `scenarios.sets`.
    """
    return ("all",) if scenario["kind"] == "global" else parameters.zone_names


def scenario_size(scenario: Mapping, parameters: StiffnessInputs) -> int:
    """Number of ventricles of an entry of `scenarios.sets`."""
    if scenario["kind"] == "global":
        return scenario["samples"]
    return len(parameters.zones) * scenario["samples_per_zone"]
