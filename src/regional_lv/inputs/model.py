"""The model that inputs change: everything that the simulator takes, as plain values.

A model is what `physics_of` gives, in a form in which every number may vary: factors of the law by
segment, all constants of the law by name, supports as compliances (0 holds, infinity is free), and
the thickness, radius, length and apex of the segment table, which of surfaces and meshes describes
them. Values that an input returns are new mappings; a model is never changed in place.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.data.published import PUBLISHED_HEART
from regional_lv.errors import InputError
from regional_lv.geometry.shape import level_ends
from regional_lv.geometry.surfaces import Surfaces
from regional_lv.geometry.table import check_apices, read_segments
from regional_lv.inputs.physics import physics_of
from regional_lv.inputs.shape import NO_TABLE, is_of_table
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.supports import Base

TABLE = ("wall_thickness_mm", "endo_radius_mm")
"""Columns (17,) of the segment table that shape inputs change."""


def model_of(config: Mapping) -> dict:
    """The model of a checked configuration.

    Of a heart from a segment table, `geometry` has the `table` itself, its columns `TABLE` as
    arrays (17,), `length_mm` from the base to the endocardial apex, `apex_mm`, the thickness of
    the wall there, and where its levels end (`geometry.shape.LEVEL_KEYS`). One from surfaces or a
    mesh has those of the table that describes it, if the section `inputs` names any: reading them
    takes a second. Raises InputError for a table that cannot be used.
    """
    model = completed(physics_of(dict(config)))
    geometry = config["geometry"]
    if geometry["source"] == "segments":
        shape = _of_table(geometry)
    elif any(is_of_table(*each) for each in config.get("inputs", {}).items()):
        shape = _described(geometry)
    else:
        return model
    return model | {"geometry": model["geometry"] | shape}


def _described(geometry: Mapping) -> dict:
    """Of a heart from surfaces or a mesh; why no table describes it, if none does."""
    # Imported here: readers of surfaces take a second to load, and most hearts have a table.
    from regional_lv.geometry.described import table_of_heart

    if geometry["source"] == "mesh" and geometry["imported"]["file"] == PUBLISHED_HEART:
        raise InputError(
            f"geometry.imported.file: a study is planned before {PUBLISHED_HEART} is fetched, so "
            "that inputs of its segments' shape are not known; give the paths of its two files "
            "(geometry.imported.file and .segments), or remove these inputs"
        )
    try:
        found = table_of_heart(geometry)
        # The wall moves as the smooth one through the table's figures, if there is one.
        Surfaces(*found)
    except InputError as error:
        return {NO_TABLE: f"no segment table describes the heart ({error})"}
    return _shape(*found)


def _of_table(geometry: Mapping) -> dict:
    table = read_segments(geometry["segments"])
    apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
    check_apices(geometry["segments"], table, *apices)
    return _shape(table, *apices)


def _shape(table: pd.DataFrame, endo_apex_z_mm: float, epi_apex_z_mm: float) -> dict:
    shape = {"table": table, "length_mm": -endo_apex_z_mm}
    shape |= {"apex_mm": endo_apex_z_mm - epi_apex_z_mm}
    shape |= {column: table[column].to_numpy(float) for column in TABLE}
    return shape | level_ends(table, shape["length_mm"])


def completed(physics: Mapping) -> dict:
    """The model of a simulator's `physics`, its shape left as the mesh has it.

    `factors` has, by factor of the law, the multipliers (17,) of the reference by AHA segment.
    """
    material = material_from_config(physics["material"])
    factors = {name: np.ones(len(aha.SEGMENTS)) for name in material.references}
    factors[material.stress_factor()] = segment_factors(physics["material"])
    bulk = physics["material"]["bulk_modulus_kpa"]
    own = {"constants": dict(material.values), "reference": dict(material.references)}
    supports = physics["supports"]
    return {
        **physics,
        "factors": factors,
        "material": {
            **physics["material"],
            **own,
            "compressibility_per_kpa": 0.0 if bulk is None else 1 / bulk,
        },
        "supports": {**supports, "base": dict(Base(supports["base"]).compliance)},
    }


def segment_factors(material: Mapping) -> np.ndarray:
    """Multipliers (17,) of the wall's stiffness by AHA segment, 1 where none is named."""
    factors = np.ones(len(aha.SEGMENTS))
    for segment, factor in material["segment_factors"].items():
        factors[int(segment) - 1] = factor
    return factors
