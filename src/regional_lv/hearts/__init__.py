"""Any heart from its segment table: the emulator that ships, and answers from it."""

from pathlib import Path

CONFIG = "config.yaml"
"""The configuration in the folder of a heart or of a cohort."""

ONE_HEART = Path(__file__).parent / "one_heart.yaml"
"""What the configuration of a heart goes on top of, where the emulator of any heart is asked."""
