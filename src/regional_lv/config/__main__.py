"""Write the tables of keys: `python -m regional_lv.config config/README.md`."""

import sys
from pathlib import Path

from regional_lv.config.docs import write

write(Path(sys.argv[1]))
