"""Values of a configuration mean what they look like, in a file and on the command line."""

import math

import pytest
import yaml

from regional_lv import config
from regional_lv.config import yaml_core
from regional_lv.errors import InputError

VALUES = {
    # what is written, and what it is
    **{"12": 12, "012": 12, "-007": -7, "+1": 1, "0": 0, "0o14": 12, "0x1F": 31},
    **{"1e3": 1e3, "1E-8": 1e-8, "1.": 1.0, ".5": 0.5, "-.5e1": -5.0, "01.50": 1.5},
    **{".inf": math.inf, "-.INF": -math.inf},
    **{"true": True, "False": False, "TRUE": True, "~": None, "null": None, "": None},
    # Numbers, truth values and dates of YAML 1.1 are text.
    **{t: t for t in ("1:30", "1:30.5", "190:20:30", "1_000", "1_0.5", "0b11", "0o9", "inf")},
    **{t: t for t in ("yes", "No", "on", "OFF", "y", "n", "tRue", "2020-02-31", "=", "8 mmHg")},
}


@pytest.mark.parametrize(("text", "value"), VALUES.items())
def test_a_value_is_what_it_looks_like(text, value):
    places = f"plain: {text}\nlist: [{text}]\nnested: {{deep: {{er: {text}}}}}\nquoted: '{text}'"
    read = yaml_core.parse(places)
    found = (yaml_core.value_of(text), read["plain"], *read["list"], read["nested"]["deep"]["er"])
    # An empty entry of a list is no entry.
    assert len(found) == 4 or text == ""
    assert all(v == value and type(v) is type(value) for v in found)
    assert read["quoted"] == text


@pytest.mark.parametrize("key", ["012", "1:30", "no", "1e3", "true", "~", "1_0"])
def test_a_key_is_its_text(key):
    assert yaml_core.parse(f"a: {{{key}: 1}}\n{key}: 2") == {"a": {key: 1}, key: 2}
    with pytest.raises(yaml.YAMLError, match="is in line 1 already"):
        yaml_core.parse(f"{key}: 1\n{key}: 2")


def test_aliases_and_merged_sections_keep_their_values():
    text = "base: &b {seed: 010, 1: &n 07}\nown: {<<: *b, seed: 3}\n*n : *n"
    assert yaml_core.parse(text) == {
        "base": {"seed": 10, "1": 7},
        "own": {"seed": 3, "1": 7},
        "07": 7,
    }


def test_the_last_file_counts_first_and_the_command_line_before_it(tmp_path):
    (tmp_path / "below.yaml").write_text("seed: 012\nnuts: {draws: 0600, chains: 2}\n")
    (tmp_path / "above.yaml").write_text("study: mine\nseed: 013\nnuts: {draws: 0700}\n")
    files = [tmp_path / "below.yaml", tmp_path / "above.yaml"]
    # Snakemake reads 600 in a section of the command line as text, and a number alone as such.
    given = {"nuts": {"warmup": "0600"}, "map": {"starts": ["1e1", "yes"]}, "evaluation": False}
    assert config.gather(files, given) == {
        "study": "mine",
        "seed": 13,
        "nuts": {"draws": 700, "chains": 2, "warmup": 600},
        "map": {"starts": [10.0, "yes"]},
        "evaluation": False,
    }
    assert config.gather(files[::-1], {})["seed"] == 12


def test_a_number_that_is_none_names_file_and_key(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("study: mine\nloading: {pressure_mmhg: 1:30}\nevaluation: yes\n")
    with pytest.raises(InputError) as error:
        config.load(path)
    first, second = str(error.value).splitlines()
    assert first.startswith(f"{path}: evaluation: 'yes' is not true or false")
    assert second.startswith(f"{path}: loading.pressure_mmhg: '1:30' is not a number")
