"""Tests that every plugin has to pass, for the tests of its author (pytest).

    from regional_lv.testing import MaterialContract

    class TestDemiray(MaterialContract):
        plugin = Demiray

`EmulatorContract`, `MaterialContract`, `QuantityContract` and `InputContract` take the class as
`plugin`, which is registered while they run. The package's own classes pass the same tests.
"""

import pytest

pytest.register_assert_rewrite(
    *(f"{__name__}.{module}" for module in ("emulators", "inputs", "materials", "quantities"))
)

from regional_lv.testing.emulators import EmulatorContract  # noqa: E402
from regional_lv.testing.inputs import InputContract  # noqa: E402
from regional_lv.testing.materials import MaterialContract  # noqa: E402
from regional_lv.testing.quantities import QuantityContract  # noqa: E402

__all__ = ["EmulatorContract", "InputContract", "MaterialContract", "QuantityContract"]
