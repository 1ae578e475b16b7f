"""What the documentation says of files, targets, keys and versions is there."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from regional_lv import config as study_config
from regional_lv import data
from regional_lv.config.docs import describe
from regional_lv.inputs import __main__ as inputs
from regional_lv.session import Study

ROOT = Path(__file__).parents[2]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    ROOT / "config" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, or of those of the page that it includes."""
    text = page.read_text()
    if included := re.search(r"```{include} (\S+)", text):
        text = (page.parent / included[1]).read_text()
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    missing = []
    for link in re.findall(r"\]\((?!https?:)([^)\s]+)\)", page.read_text()):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in headings(target)):
            missing.append(link)
    assert missing == []


def test_named_targets_and_studies_exist():
    text = "\n".join(page.read_text() for page in PAGES)
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    assert set(re.findall(r"(?:`|^)make ([a-z-]+)", text, flags=re.MULTILINE)) - targets == set()
    studies = re.findall(r"--configfile ((?:config/\S+?\.yaml ?)+)", text)
    assert len(studies) > 5
    assert [s for one in studies for s in one.split() if not (ROOT / s).exists()] == []


def test_ten_keys_are_keys():
    keys = {key.path for key in describe()}
    text = (ROOT / "docs" / "configuration.md").read_text()
    named = re.findall(r"^## \d+\. (.*)$", text, flags=re.MULTILINE)
    assert len(named) == 10
    for key in (key for title in named for key in re.findall(r"`([^`]+)`", title)):
        assert any(path == key or path.startswith(f"{key}.") for path in keys), key


def test_one_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    released = re.findall(r"^## (\d\S+)", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert released[0] == version
    assert f"version {version}." in (ROOT / "docs" / "citing.md").read_text()


def test_code_of_the_page_is_a_study(tmp_path, monkeypatch):
    shutil.copy(data.path("volunteer_segments.csv"), tmp_path / "segments.csv")
    code = re.search(
        r"```python\n(.*?)```", (ROOT / "docs" / "from_python.md").read_text(), flags=re.DOTALL
    )[1]
    calls = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    made = next(call for call in calls if ast.unparse(call.func) == "Study")
    monkeypatch.chdir(tmp_path)
    assert study_config.load(ast.literal_eval(made.args[0]))["design"]["natural"] == 120
    methods = {call.func.attr for call in calls if isinstance(call.func, ast.Attribute)}
    assert methods == {"make_heart", "simulate", "train", "infer"}
    assert all(callable(getattr(Study, name)) for name in methods)


def test_plugin_of_the_contributing_page_is_the_example():
    example = (ROOT / "config" / "examples" / "plugin.py").read_text()
    page = (ROOT / "CONTRIBUTING.md").read_text()
    shown = re.search(r"```python\n(.*?)```", page, flags=re.DOTALL)[1]
    classes = [node for node in ast.parse(shown).body if isinstance(node, ast.ClassDef)]
    assert len(classes) == 1
    assert ast.get_source_segment(shown, classes[0]) in example


def test_notebook_is_stored_with_its_outputs():
    cells = json.loads((ROOT / "docs" / "library.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not any(output["output_type"] == "error" for output in outputs)
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2


@pytest.mark.parametrize(("page", "of"), [("inputs", inputs)])
def test_pages_of_catalogues_are_these(page, of):
    assert (ROOT / "docs" / f"{page}.md").read_text() == of.document(), "run `make format`"


@pytest.mark.parametrize(
    ("module", "page"),
    [("config", "config/README.md"), ("inputs", "docs/inputs.md")],
)
def test_what_make_format_writes(tmp_path, module, page):
    """As the Makefile runs it, on a page whose tables are out of date."""
    made = tmp_path / "page.md"
    made.write_text(f"{(ROOT / page).read_text()}| old | row |\n")
    command = [sys.executable, "-m", f"regional_lv.{module}", str(made)]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": str(ROOT / "src")})
    assert made.read_text() == (ROOT / page).read_text()


def test_page_of_the_papers_figures_is_complete():
    text = (ROOT / "docs" / "paper_figures.md").read_text()
    rows = re.findall(r"^\| (Figure|Table) (S?\d+) \|.*", text, flags=re.MULTILINE)
    figures = [number for what, number in rows if what == "Figure"]
    tables = [number for what, number in rows if what == "Table"]
    assert figures == [*map(str, range(1, 13)), *(f"S{n}" for n in range(1, 7))]
    assert tables == ["1", *(f"S{n}" for n in range(1, 7))]
    package, captions = ROOT / "src" / "regional_lv", ROOT / "workflow" / "report"
    for module in re.findall(r"`((?:paper\.)?plots\.\w+)`", text):
        file = (package / module.replace(".", "/")).with_suffix(".py")
        assert file.exists() and (captions / f"{file.stem}.rst").exists()
    for module, name in re.findall(r"`((?:paper\.)?tables\.\w+):(\w+)`", text):
        file = (package / module.replace(".", "/")).with_suffix(".py")
        assert f"\ndef {name}(" in file.read_text(), name
        assert (captions / f"table_{name}.rst").exists(), name


def test_images_of_the_documentation_are_shown():
    text = "\n".join(page.read_text() for page in PAGES)
    waiting = re.findall(r"^\*Not here yet:\* `(\S+)`", text, flags=re.MULTILINE)
    assert [name for name in waiting if (ROOT / "docs" / name).exists()] == []
    images = {image.name for image in (ROOT / "docs").glob("*/*.png")}
    assert images - set(re.findall(r"\]\([^)]*?([^/)]+\.png)\)", text)) == set()
