"""Settings of a criticism, out of a configuration, without what takes seconds to load."""

from collections.abc import Mapping

from regional_lv.inputs.physics import physics_of, why_not_scaling


def settings_of(config: Mapping) -> dict:
    """What `study.Settings.from_config` reads, of a checked configuration: plain values."""
    section = config["criticism"]
    scales = not why_not_scaling(physics_of(dict(config)))
    return {
        **{key: section[key] for key in ("bootstrap", "level", "largest_set", "confirmation")},
        "load_fractions": section["load_fractions"] if scales else [],
        "noise_prior_scale": config["clinical"]["noise_prior_scale"],
        **{key: config["observables"][key] for key in ("strain_exponent", "line_share")},
    }
