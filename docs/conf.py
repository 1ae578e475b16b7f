"""Settings of the documentation, built by `make docs`."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]

project = "regional-lv"
author = "regional-lv developers"
release = version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]

extensions = ["myst_nb", "sphinx_copybutton"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
nb_execution_mode = "off"  # the notebook is stored with its outputs; `make docs-notebook` runs it
nb_output_stderr = "remove"

html_theme = "furo"
html_title = f"regional-lv {release}"
html_copy_source = False
copybutton_exclude = ".linenos, .gp"
