"""Published files: mirror before repository, checksums, and a study that can do without them."""

import hashlib
import http.server
import io
import logging
import re
import subprocess
import sys
import threading

import pytest

from regional_lv.data import published
from regional_lv.errors import InputError
from regional_lv.study import progress
from regional_lv.study.layout import Layout

PINNED = published.FILES
CONTENT = b"180.9,-0.1\n"
NAME = "measured/case.csv"


@pytest.fixture(autouse=True)
def clean_surroundings(monkeypatch, tmp_path):
    """No mirror, no notice given, no copy, and one published file whose content is known."""
    for variable in (published.MIRROR_VARIABLE, published.NOTICE_VARIABLE):
        # setenv first, so that what the tested code sets is taken back as well.
        monkeypatch.setenv(variable, "")
        monkeypatch.delenv(variable)
    digest = hashlib.sha256(CONTENT).hexdigest()
    known = published.Published("Case/case.csv", digest)
    monkeypatch.setattr(published, "FILES", {NAME: known, published.VOLUNTEER: known})
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def mirror(tmp_path):
    folder = tmp_path / "mirror"
    for name in (NAME, published.VOLUNTEER):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(CONTENT)
    return str(folder)


@pytest.fixture
def repository(monkeypatch):
    """A server in place of the public repository; yields the list of requests it got."""
    requests = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            requests.append(self.command)
            self.send_response(200)
            self.end_headers()
            self.wfile.write(CONTENT)

        def log_message(self, *_):
            """Keep the output of the tests clean."""

    server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}/case.csv"
    monkeypatch.setattr(published, "repository_url", lambda name: address)
    yield requests
    server.shutdown()
    server.server_close()


@pytest.fixture
def silence(monkeypatch):
    """A repository that cannot be reached: the port is closed."""
    monkeypatch.setattr(published, "repository_url", lambda name: "http://127.0.0.1:9/case.csv")


def study(mirror=None, download=True):
    return {"study": "mine", "resources": {"published_mirror": mirror, "download": download}}


def test_mirror_comes_first(tmp_path, mirror, repository):
    copy = published.fetch_published(NAME, mirror, True, tmp_path / "new" / "case.csv")
    assert copy.read_bytes() == CONTENT
    assert repository == []


def test_variable_takes_precedence(tmp_path, mirror, monkeypatch):
    monkeypatch.setenv(published.MIRROR_VARIABLE, mirror)
    copy = published.fetch_published(NAME, str(tmp_path / "elsewhere"), False, tmp_path / "c.csv")
    assert copy.read_bytes() == CONTENT


def test_clone_of_the_repository_serves_as_mirror(tmp_path):
    (tmp_path / "Case").mkdir()
    (tmp_path / "Case" / "case.csv").write_bytes(CONTENT)
    copy = published.fetch_published(NAME, str(tmp_path), False, tmp_path / "c.csv")
    assert copy.read_bytes() == CONTENT


def test_repository_serves_what_the_mirror_does_not_have(tmp_path, repository):
    copy = published.fetch_published(NAME, str(tmp_path), True, tmp_path / "c.csv")
    assert copy.read_bytes() == CONTENT
    assert repository == ["GET"]


def test_other_content_is_refused_and_nothing_is_left(tmp_path, mirror):
    (tmp_path / "mirror" / NAME).write_bytes(b"other")
    with pytest.raises(InputError, match=r"SHA-256 .* is not that of the published file.*replace"):
        published.fetch_published(NAME, mirror, True, tmp_path / "c.csv")
    assert not (tmp_path / "c.csv").exists()


TABLE = b"1.5,2\n0.1,3\n4,0.5\n"
TWO_ROWS = b"1.5,2\n0.1,3\n"


@pytest.fixture
def cut(monkeypatch):
    """Name of a published table of three rows, of which the first two are used."""
    digests = (hashlib.sha256(content).hexdigest() for content in (TABLE, TWO_ROWS))
    known = published.Published("Data/table.csv", next(digests), 2, next(digests))
    monkeypatch.setattr(published, "FILES", {"simulations/table_2.csv": known})
    return "simulations/table_2.csv"


@pytest.mark.parametrize(
    ("place", "content"), [("Data/table.csv", TABLE), ("simulations/table_2.csv", TWO_ROWS)]
)
def test_first_rows_come_from_the_whole_table_or_from_a_file_of_them(tmp_path, cut, place, content):
    held = tmp_path / "mirror" / place
    held.parent.mkdir(parents=True)
    held.write_bytes(content)
    copy = published.fetch_published(cut, str(tmp_path / "mirror"), False, tmp_path / "c.csv")
    assert copy.read_bytes() == TWO_ROWS


@pytest.mark.parametrize("place", ["Data/table.csv", "simulations/table_2.csv"])
def test_other_rows_are_refused(tmp_path, cut, place):
    """Neither the whole table nor its first rows."""
    held = tmp_path / "mirror" / place
    held.parent.mkdir(parents=True)
    held.write_bytes(TABLE.splitlines(keepends=True)[0])
    with pytest.raises(InputError) as error:
        published.fetch_published(cut, str(tmp_path / "mirror"), False, tmp_path / "c.csv")
    for words in (str(held), "first 2 rows", "replace it by Data/table.csv of", published.COMMIT):
        assert words in str(error.value)
    assert not (tmp_path / "c.csv").exists()


@pytest.mark.parametrize("download", [True, False])
def test_unreachable_file_names_the_remedy(tmp_path, silence, download):
    with pytest.raises(InputError, match=r"resources\.published_mirror") as error:
        published.fetch_published(NAME, str(tmp_path / "none"), download, tmp_path / "c.csv")
    assert published.MIRROR_VARIABLE in str(error.value)


@pytest.mark.parametrize("name", [NAME, published.VOLUNTEER])
def test_a_study_can_do_without_the_volunteer_and_nothing_else(tmp_path, silence, name):
    with pytest.raises(InputError) as error:
        published.fetch_published(name, None, True, tmp_path / "c.csv")
    without = "do without the volunteer (resources.download: false)"
    assert (without in str(error.value)) == (name == published.VOLUNTEER)


def test_volunteer_is_available_from_a_mirror(mirror):
    assert published.volunteer_available(study(mirror, download=False))


def test_volunteer_is_available_from_the_repository_without_asking(repository):
    assert published.volunteer_available(study())
    assert repository == []


def test_volunteer_once_fetched_stays_available(tmp_path):
    copy = tmp_path / Layout.of("mine").published(published.VOLUNTEER)
    copy.parent.mkdir(parents=True)
    copy.write_bytes(CONTENT)
    assert published.volunteer_available(study(download=False))


def test_volunteer_is_left_out_with_one_notice(repository, caplog):
    assert not published.volunteer_available(study(download=False))
    assert not published.volunteer_available(study(download=False))
    assert len(caplog.records) == 1
    assert "left out: resources.download is false" in caplog.text
    assert "resources.published_mirror" in caplog.text
    assert repository == []


CLONE = {
    "ACase/4.3Data/ACase.csv": published.VOLUNTEER,
    **{f"ACase/4.3Data/slice{n}.csv": f"measured/slice{n}.csv" for n in range(1, 6)},
    "LVmeshV/hexheartLVmeshF60S45.inp": published.HEART_MESH,
    "LVmeshV/AHALVMeshDivisionPCAReconstructed.mat": published.HEART_SEGMENTS,
    "SimulationData/Data20260110/X_train_Final_10.csv": published.TRAINING_INPUTS,
    "SimulationData/Data20260110/Y_data_train_Final.csv": published.TRAINING_OUTPUTS,
    "SimulationData/Data20260110/X_test.csv": published.TEST_INPUTS,
    "SimulationData/Data20260110/Y_data_test_Final.csv": published.TEST_OUTPUTS,
}
"""Where files lie in the public repository, looked up there, and what the project calls them."""


def test_every_file_is_found_in_a_clone_and_at_its_address(tmp_path, monkeypatch):
    """The repository answers with what lies at the place that it was asked for."""
    known = dict(PINNED)
    clone = tmp_path / "MultiR_FixedG_JRSSC"
    for place, name in CLONE.items():
        content = f"what {place} holds".encode()
        (clone / place).parent.mkdir(parents=True, exist_ok=True)
        (clone / place).write_bytes(content)
        known[name] = known[name]._replace(sha256=hashlib.sha256(content).hexdigest())

    def answer(address, timeout):
        host, owner, repository, commit, place = address.split("/", 6)[2:]
        assert (host, repository) == ("raw.githubusercontent.com", clone.name)
        assert re.fullmatch("[0-9a-f]{40}", commit) and owner == "Aether-Ren"
        return io.BytesIO(f"what {place} holds".encode())

    monkeypatch.setattr(published.urllib.request, "urlopen", answer)
    monkeypatch.setattr(published, "FILES", known)
    assert set(known) == set(CLONE.values())
    for place, name in CLONE.items():
        for mirror, download in ((str(clone), False), (None, True)):
            copy = published.fetch_published(name, mirror, download, tmp_path / "copy" / name)
            assert copy.read_bytes() == f"what {place} holds".encode()
    assert published.volunteer_available(study(str(clone), download=False))


@pytest.mark.parametrize("name", [published.TEST_INPUTS, published.TEST_OUTPUTS])
def test_a_test_table_of_other_content_is_refused(name, tmp_path, monkeypatch):
    monkeypatch.setattr(published, "FILES", PINNED)
    place = tmp_path / PINNED[name].repository_path
    place.parent.mkdir(parents=True)
    place.write_bytes(b"1,2\n" * 200)
    with pytest.raises(InputError, match=rf"{place}: SHA-256 .* first 128 rows.*replace it by"):
        published.fetch_published(name, str(tmp_path), False, tmp_path / "c.csv")
    assert not (tmp_path / "c.csv").exists()


def test_progress_tells_how_far_and_how_long(caplog):
    caplog.set_level(logging.INFO)
    loop = progress.Progress("train batch 0", 100, interval=3600)
    for item in range(100):
        loop.step(failed=item < 2)
    first, last = [record.getMessage() for record in caplog.records]
    assert first.startswith("train batch 0: done 1/100, failed 1, elapsed ")
    assert last.startswith("train batch 0: done 100/100, failed 2, elapsed ")
    assert last.endswith("left 0.0 s")


def test_progress_extrapolates():
    loop = progress.Progress("x", 10, interval=3600)
    loop.done = 4
    assert loop.line(100.0) == "x: done 4/10, failed 0, elapsed 1 min 40 s, left 2 min 30 s"
    assert progress.duration(7300) == "2 h 01 min"


@pytest.mark.parametrize("kind", ["InputError", "RuntimeError"])
def test_bad_input_ends_a_job_with_one_line_and_no_traceback(tmp_path, kind):
    code = (
        "from regional_lv.errors import InputError\n"
        "from regional_lv.study.progress import start_log\n"
        "start_log('job.log')\n"
        f"raise {kind}('a.csv, line 3: no value; give one')\n"
    )
    job = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert job.returncode == 1
    assert job.stderr == ""  # Snakemake shows the log of a job that failed
    text = (tmp_path / "job.log").read_text()
    lines = text.splitlines()
    if kind == "InputError":
        assert len(lines) == 1
        assert lines[0].endswith("CRITICAL stopped: a.csv, line 3: no value; give one")
    else:
        assert "Traceback" in text and lines[-1] == f"{kind}: a.csv, line 3: no value; give one"
