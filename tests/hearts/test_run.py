"""`regional-lv run`: which way a heart goes."""

import importlib
import shutil

import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from regional_lv.cli import main
from regional_lv.errors import InputError
from regional_lv.hearts import file as any_heart_file
from regional_lv.hearts.full import write_inputs_design
from regional_lv.hearts.reach import OutOfReach, within
from regional_lv.inputs.space import sections_of

cli = importlib.import_module("regional_lv.cli.run")  # the name in the package is the command's


@pytest.fixture
def folder(heart, file, tmp_path, monkeypatch):
    """Of a heart within reach of the emulator that comes with the package."""
    monkeypatch.setattr(any_heart_file, "SHIPPED", file)
    any_heart_file.shipped.cache_clear()
    monkeypatch.chdir(tmp_path)
    # The small emulator knows fewer inputs than the one that comes along.
    base = tmp_path / "one_heart.yaml"
    base.write_text(yaml.safe_dump({"study": "one_heart", "all_inputs": {"emulator": "shipped"}}))
    monkeypatch.setattr(cli, "ONE_HEART", base)
    heart()
    yield tmp_path
    any_heart_file.shipped.cache_clear()


@pytest.fixture
def run(folder, monkeypatch):
    """Call `run` on the heart; exit code, what it says, and what would be simulated."""
    simulated = []
    monkeypatch.setattr(cli, "inspect", lambda *heart: None)
    load = cli.load
    monkeypatch.setattr(
        cli, "load", lambda path, base: load(path, base if base.parent == path.parent else None)
    )
    monkeypatch.setattr(cli, "_simulate", lambda *heart: simulated.append(heart))

    def run(*options, can_simulate):
        monkeypatch.setattr(cli, "_can_simulate", lambda workflow: can_simulate)
        done = CliRunner().invoke(main, ["run", str(folder), *options])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        return done.exit_code, done.output, simulated

    return run


def test_without_a_simulator_the_answer_is_the_fast_one(run, folder):
    code, said, simulated = run(can_simulate=False)
    assert code == 0 and not simulated
    out = folder / "results" / "anna" / "fast" / "anna"
    assert "page of anna: results/anna/fast/anna/page.html" in said
    assert all((out / name).is_file() for name in ("page.html", "findings.json", "posterior.nc"))


@pytest.mark.parametrize("way", [(), ("--full",)])
def test_with_one_simulations_of_the_heart_join(way, run, folder):
    """On top of the heart's configuration goes what was cut to what the emulator knows."""
    code, _, simulated = run(*way, "--dry-run", can_simulate=True)
    assert code == 0
    assert not (folder / "results" / "anna").exists()
    ((path, base, _, _, dry_run, cut),) = simulated
    assert path == folder / "config.yaml" and dry_run
    assert yaml.safe_load(base.read_text())["all_inputs"]["emulator"] == "shipped"
    assert cut["parameters"]["bounds"] == {"C_a": [pytest.approx(0.12), 5.0]}
    assert cut["inputs"]["basal_motion"]["range"] == [0.0, pytest.approx(80.0)]


def test_nothing_is_simulated_beyond_what_the_emulator_knows(heart, file, any_heart, tmp_path):
    design = tmp_path / "design.parquet"

    def write(config):
        write_inputs_design(file, sections_of(config), "train", 8, 1, design)

    with pytest.raises(InputError, match=r"C_a is cut to 0\.12 to 5, .*inputs\.<name>"):
        write(heart())
    with pytest.raises(OutOfReach, match="wall_thickness_"):
        write(heart(lambda table: table.__setitem__("wall_thickness_mm", 2.2)))
    assert not design.exists()
    write(within(heart(), any_heart.emulator, any_heart.known)[0])
    assert len(pd.read_parquet(design)) == 8


def test_what_is_cut_is_on_top_only_while_it_is_asked_for(folder, monkeypatch):
    """A dry run leaves no file."""
    given = []
    monkeypatch.setattr(
        cli.started, "run_workflow", lambda project, files, *how: given.extend(files)
    )
    cut = {"parameters": {"bounds": {"C_a": [0.12, 5.0]}}}
    for dry_run in (True, False):
        cli._simulate(folder / "config.yaml", folder / "one_heart.yaml", 2, None, dry_run, cut)
        assert given.pop().exists() is not dry_run


def test_without_the_emulator_that_comes_along_nothing_longer_is_begun(run, folder, monkeypatch):
    monkeypatch.setattr(any_heart_file, "SHIPPED", folder / "none.pt.gz")
    code, said, simulated = run(can_simulate=True)
    assert code == 1 and "none.pt.gz: no emulator of any heart" in said and "--own" in said
    assert not simulated


def test_a_copy_of_the_folder_is_not_answered_into_its_results(run, folder, monkeypatch):
    """The fast way makes no manifest that names the configuration."""
    monkeypatch.setattr(cli, "_answer_fast", lambda config: None)
    assert run("--fast", can_simulate=False)[0] == 0
    copy = folder / "copy"
    copy.mkdir()
    for file in ("config.yaml", "segments.csv", "measured.csv"):
        shutil.copy(folder / file, copy)
    done = CliRunner().invoke(main, ["check", str(copy)])
    assert done.exit_code == 1
    assert f"results/anna holds the results of {folder}/config.yaml, which this" in done.output
    # It was moved.
    (folder / "config.yaml").unlink()
    assert "holds the results" not in CliRunner().invoke(main, ["check", str(copy)]).output


def test_a_cohort_is_not_taken_for_a_heart(run, folder, heart):
    config = yaml.safe_load((folder / "config.yaml").read_text())
    (folder / "config.yaml").write_text(yaml.safe_dump(config | {"cohort": "hearts/*/"}))
    code, said, _ = run(can_simulate=False)
    assert code == 1 and "`regional-lv cohort`" in said


def test_a_heart_out_of_reach_goes_the_long_way(run, folder, heart):
    heart(lambda table: table.__setitem__("wall_thickness_mm", 2.2))
    code, said, simulated = run("--fast", can_simulate=True)
    assert code == 1 and "wall_thickness_" in said and not simulated
    code, said, simulated = run(can_simulate=False)
    assert code == 1 and "--own" in said and not simulated
    code, said, simulated = run("--full", "--dry-run", can_simulate=True)
    assert code == 0 and "so it is simulated" in said
    ((_, base, *_),) = simulated
    assert base.name == "quick.yaml"


def test_the_long_way_asks_no_emulator(run, monkeypatch):
    monkeypatch.setattr(cli, "_answer_fast", None)
    code, _, ((_, base, *_),) = run("--own", can_simulate=True)
    assert code == 0 and base.name == "quick.yaml"


def test_a_size_is_one_of_a_study_of_its_own(run):
    code, said, simulated = run("--study", "study", "--fast", can_simulate=True)
    assert code == 1 and "--study study: goes with --own" in said and not simulated
    run("--study", "study", "--dry-run", can_simulate=True)
    ((_, base, *_),) = simulated
    assert base.name == "study.yaml"
