"""Write the page of the documentation about the emulator of any heart: its path is the argument."""

import sys
from pathlib import Path

from regional_lv.hearts.card import document
from regional_lv.hearts.file import shipped

if __name__ == "__main__":
    Path(sys.argv[1]).write_text(document(shipped()))
