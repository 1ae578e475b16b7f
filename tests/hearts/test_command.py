"""`regional-lv cohort` and `check` of a cohort."""

import pytest
from click.testing import CliRunner

from regional_lv.cli import main
from regional_lv.errors import InputError
from regional_lv.hearts import cohort
from tests.hearts.folders import NAMES, write_cohort, write_heart


@pytest.fixture
def call(monkeypatch, tmp_path):
    """The command line beside an emulator that knows all hearts but those at 25 mmHg."""

    def check_reach(config):
        if config["loading"]["pressure_mmhg"] >= 25:
            raise InputError("loading.pressure_mmhg: 25 mmHg; the emulator knows 3 to 20")

    monkeypatch.setattr(cohort, "reach_of_emulator", lambda: check_reach)
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, list[str]]:
        done = CliRunner().invoke(main, arguments)
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        return done.exit_code, done.output.splitlines()

    return call


def test_every_heart_is_told_of(call, tmp_path):
    write_cohort(tmp_path / "group")
    write_heart(tmp_path / "group" / "hearts" / "gina", loading={"pressure_mmhg": 25}, scale=1.1)
    (tmp_path / "group" / "hearts" / "emil" / "measured.csv").unlink()
    code, lines = call("check", "group")
    assert code == 0, lines
    assert lines[0] == "group/config.yaml: study group, 7 hearts"
    for name in set(NAMES) - {"emil"}:
        assert any(line.startswith(f"{name}: 8 mmHg; unloaded cavity 104.8 mL") for line in lines)
        assert any(line.startswith(f"{name}: warning: heart: ") for line in lines)
    assert any(line.startswith("emil: left out: group/hearts/emil/config.yaml: ") for line in lines)
    assert "gina: left out: loading.pressure_mmhg: 25 mmHg; the emulator knows 3 to 20" in lines
    assert lines[-1] == "5 of 7 hearts can be answered."


def test_a_configuration_without_cohort(call, tmp_path):
    heart = write_heart(tmp_path / "anna")
    code, (line,) = call("cohort", str(heart))
    assert code == 1 and "cohort: missing; name the hearts, such as `cohort: hearts/*/`" in line


def test_a_pattern_without_hearts_names_the_configuration(call, tmp_path):
    (tmp_path / "config.yaml").write_text("study: group\ncohort: nowhere/*/\n")
    code, (line,) = call("check", "config.yaml")
    assert code == 1 and line.startswith("config.yaml: cohort.hearts: nowhere/*/: no heart there")


def test_nothing_runs_with_half_of_the_hearts(call, tmp_path):
    write_cohort(tmp_path / "group")
    for name in NAMES[:3]:
        (tmp_path / "group" / "hearts" / name / "segments.csv").write_text("damaged")
    code, lines = call("cohort", "group")
    assert code == 1 and "cohort: 3 of 6 hearts cannot be answered" in lines[1]
    assert [line.split(":")[0] for line in lines[2:5]] == list(NAMES[:3])


def test_what_is_run(call, tmp_path, root, capfd):
    """Batches of hearts, then the tables, figures and the page, and nothing of a single heart."""
    write_cohort(tmp_path / "group")
    code, lines = call("cohort", "group", "--dry-run", "--workflow", str(root))
    assert code == 0, lines
    planned = "".join(capfd.readouterr())
    for rule in ("check_cohort", "answer_hearts", "summarise_cohort", "make_cohort_page"):
        assert rule in planned
    assert "simulate" not in planned and "make_mesh" not in planned
