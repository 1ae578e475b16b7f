"""What the contracts share."""

from typing import ClassVar

import pytest

from regional_lv.registry import Registry, temporary


class Contract:
    """Tests of one class.

    Attributes: plugin, the class; registry, where it belongs.
    """

    plugin: ClassVar[type]
    registry: ClassVar[Registry]

    @pytest.fixture(scope="class")
    @classmethod
    def kind(cls):
        """The class, registered."""
        with temporary():
            yield cls.registry.add(cls.plugin)
