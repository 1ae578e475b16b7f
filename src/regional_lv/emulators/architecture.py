"""What kind of emulator it is, in the words of the paper's Table 1."""

from typing import NamedTuple


class Architecture(NamedTuple):
    """A row of that table."""

    label: str
    base_method: str
    training_scope: str
    output_structure: str
    deep_component: str = "none"
