"""What every input does."""

import copy
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest

from regional_lv import config
from regional_lv.inputs.base import ROLES
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.model import model_of
from regional_lv.testing.contract import Contract


def same(one, other) -> bool:
    """Whether two models, or parts of them, are equal to round-off."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, float | tuple | list | np.ndarray):
        if np.shape(one) != np.shape(other):
            return False
        try:
            return np.allclose(one, other, rtol=1e-12, atol=1e-13)
        except TypeError:
            pass
    return one.equals(other) if isinstance(one, pd.DataFrame) else one is other or one == other


class InputContract(Contract):
    """Of an `inputs.base.Input`.

    study: sections of the configuration with which a study has the input, if the defaults do not.
    """

    registry = INPUTS
    study: ClassVar[dict] = {}

    @pytest.fixture(scope="class")
    @classmethod
    def model(cls, kind):
        return model_of(config.load({"study": "contract", **cls.study}))

    @pytest.fixture(scope="class")
    @classmethod
    def members(cls, kind, model):
        """All inputs of the class in the study."""
        assert not kind.why_not(model)
        return kind.members(model)

    def test_says_what_it_is(self, members):
        assert len({each.name for each in members}) == len(members) > 0
        for each in members:
            for text in ("name", "family", "parameter", "unit", "description", "source"):
                assert isinstance(getattr(each, text), str) and getattr(each, text), text
            assert each.roles and set(each.roles) <= set(ROLES)

    def test_nominal_value_lies_in_the_range(self, members):
        for each in members:
            assert each.low < each.high and each.low <= each.middle <= each.high

    def test_scale_there_and_back(self, members):
        for each in members:
            values = [each.low, each.middle, each.high]
            scaled = [each.scale(value) for value in values]
            assert np.isfinite(scaled).all() and scaled == sorted(scaled)
            np.testing.assert_allclose(
                [each.scale.inverse(s) for s in scaled], values, rtol=1e-9, atol=1e-12
            )

    def test_model_is_as_it_was_at_the_nominal_value(self, members, model):
        for each in members:
            if each.nominal is not None:
                assert same(each.act(model, each.nominal), model)

    def test_changes_its_section_and_nothing_in_place(self, members, model):
        for each in members:
            if not each.is_simulated:
                continue
            before = each.act(model, each.low)
            kept = copy.deepcopy(before[each.changes])
            other = each.act(model, each.high)
            assert not same(before[each.changes], other[each.changes])
            assert same(before[each.changes], kept)
            assert all(
                other[section] is model[section] for section in model.keys() - {each.changes}
            )
