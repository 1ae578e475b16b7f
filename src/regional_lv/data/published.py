"""Files that others published: where they are found, and how they are known to be the right ones.

A file comes from a local mirror, if one is named and has it, or else from the paper's public
repository at a pinned commit; its SHA-256 decides whether it is accepted.
"""

import hashlib
import http.client
import logging
import os
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from regional_lv.errors import InputError
from regional_lv.study.layout import Layout

log = logging.getLogger(__name__)

REPOSITORY = "Aether-Ren/MultiR_FixedG_JRSSC"
COMMIT = "76d81bc30478414e6ee7d841398ba4b83d463b8c"
MIRROR_VARIABLE = "REGIONAL_LV_PUBLISHED"
NOTICE_VARIABLE = "REGIONAL_LV_VOLUNTEER_NOTICE"
"""Set once a run has said that it leaves the volunteer out."""

VOLUNTEER = "measured/ACase.csv"
VOLUNTEER_SLICES = tuple(f"measured/slice{number}.csv" for number in range(1, 6))
"""Strains over the cine frames, a file per short-axis slice, from base to apex."""
SLICES_OF_LEVEL = ((1, 2), (3, 4), (5,))
"""Numbers of these slices at the basal, mid and apical level."""
HEART_MESH = "mesh/hexheartLVmeshF60S45.inp"
HEART_SEGMENTS = "mesh/AHALVMeshDivisionPCAReconstructed.mat"
TRAINING_INPUTS = "simulations/X_train_Final_10.csv"
TRAINING_OUTPUTS = "simulations/Y_data_train_Final.csv"
TEST_INPUTS = "simulations/X_test_128.csv"
TEST_OUTPUTS = "simulations/Y_data_test_128.csv"
TEST_ROWS = 128
"""Rows of both, the first ones of the published test tables; the paper's 120 are among them."""
PUBLISHED_HEART = "published_heart"
"""What a config calls `HEART_MESH` with `HEART_SEGMENTS`."""
PUBLISHED = "published"
"""What a config calls a set of `PUBLISHED_TABLES`."""
PUBLISHED_TABLES = {
    "train": {"inputs": TRAINING_INPUTS, "outputs": TRAINING_OUTPUTS},
    "test": {"inputs": TEST_INPUTS, "outputs": TEST_OUTPUTS},
}
"""Files of the paper's simulations by set."""
PUBLISHED_ROWS = {"train": 5661, "test": TEST_ROWS}
"""Rows of these."""


class Published(NamedTuple):
    """A published file: its path in the repository and the SHA-256 of its content.

    rows: how many lines of it are used, from the first; None: all. rows_sha256: of a file with
    these lines only, which a mirror may hold instead.
    """

    repository_path: str
    sha256: str
    rows: int | None = None
    rows_sha256: str | None = None


FILES = {
    VOLUNTEER: Published(
        "ACase/4.3Data/ACase.csv",
        "62a4c71de9f7608cb22edabb06e9b63aa58c6fa291f887bf7c2856d216e39906",
    ),
    **{
        path: Published(f"ACase/4.3Data/{Path(path).name}", digest)
        for path, digest in zip(
            VOLUNTEER_SLICES,
            (
                "1b215d983c501e9f5aa871c5a932cb9669b7268773c8edcfcecda492e806c11d",
                "773fde1d2f4c7a3be8417b560efc1afc69275f307a9688c8d4d6ef2684f03ce4",
                "ffd3d00811f71f0accc4b906acfe4902e6eec2ecfea6150da61584c9faeac645",
                "6d1b6e68a56dda6f3facf218e6226f137e1f686609826615a53e0e60ae1bbdcb",
                "dd2515530bc0868a99b249b9e73e984f960f7304b24bd9c20c3a0402c6fd44f2",
            ),
            strict=True,
        )
    },
    HEART_MESH: Published(
        "LVmeshV/hexheartLVmeshF60S45.inp",
        "28542da10e407e9544738da2c651ed3152d9fdcb6ba2c66446c9abb070add74a",
    ),
    HEART_SEGMENTS: Published(
        "LVmeshV/AHALVMeshDivisionPCAReconstructed.mat",
        "9bb1871e650f547ecb7068865ad9993b00de7a389735065f07a7018a18811448",
    ),
    TRAINING_INPUTS: Published(
        "SimulationData/Data20260110/X_train_Final_10.csv",
        "3b234f39a4d032b5d000e3e29b0c55a4d8fda9417254fd180c81840de5722723",
    ),
    TRAINING_OUTPUTS: Published(
        "SimulationData/Data20260110/Y_data_train_Final.csv",
        "08c4df7d0431bcfda79689cdb653561e9d2b3fade1fe74bd3058f99dac46b4c5",
    ),
    TEST_INPUTS: Published(
        "SimulationData/Data20260110/X_test.csv",
        "4355200f1ade11a5c74f1efe4729e5dd981584cab66c15a423daed36dc6b6502",
        TEST_ROWS,
        "7fa78401162de66e43a5fd2f0f9748ddaec8cd231b5b637b996bd2bb01bff9b6",
    ),
    TEST_OUTPUTS: Published(
        "SimulationData/Data20260110/Y_data_test_Final.csv",
        "79d7ffbe444d8d58512d82601de5fefbfbbd95d2376cd3762ef6b6556a27015a",
        TEST_ROWS,
        "2faf439b84fd6762b2f0ef0c86df2b8f1fb01c9fb950bae6b0578b0a25f581e8",
    ),
}
"""Published files by their path in a mirror. A mirror may also be a clone of the repository."""


def fetch_published(
    relative_path: str, mirror: str | None, download: bool, destination: str | Path
) -> Path:
    """Put a published file, or the lines of it that are used, at `destination`.

    Parameters
    ----------
    relative_path: a key of `FILES`.
    mirror: folder with the published files, or None; the environment variable
        REGIONAL_LV_PUBLISHED takes precedence.
    download: whether to ask the public repository for what the mirror does not have.

    Raises
    ------
    InputError: it is found nowhere, or its content is not the published one.
    """
    found = find_in_mirror(relative_path, mirror)
    if found:
        content, origin = found.read_bytes(), str(found)
    elif download:
        origin = repository_url(relative_path)
        try:
            with urllib.request.urlopen(origin, timeout=30) as answer:
                content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            without = (
                ", or do without the volunteer (resources.download: false)"
                if relative_path in (VOLUNTEER, *VOLUNTEER_SLICES)
                else ""
            )
            raise InputError(
                f"{origin}: cannot be fetched ({error}); {remedy()}{without}"
            ) from error
    else:
        raise InputError(f"{relative_path}: the mirror does not have it; {remedy()}")
    content = _checked(content, FILES[relative_path], origin)
    destination = Path(destination)
    destination.parent.mkdir(parents=True, exist_ok=True)
    part = destination.with_name(destination.name + ".part")
    part.write_bytes(content)
    part.replace(destination)
    log.info("%s from %s", destination, origin)
    return destination


def with_published_heart(config: Mapping) -> Mapping:
    """The section `geometry` of a checked configuration, with the study's copies of its files in
    place of `PUBLISHED_HEART`; they are fetched if they are not there. Raises InputError."""
    geometry = config["geometry"]
    if geometry["source"] != "mesh" or geometry["imported"]["file"] != PUBLISHED_HEART:
        return geometry
    resources, copies = config["resources"], {}
    for key, file in (("file", HEART_MESH), ("segments", HEART_SEGMENTS)):
        copies[key] = Layout.of(config["study"]).published(file)
        if not Path(copies[key]).is_file():
            fetch_published(file, resources["published_mirror"], resources["download"], copies[key])
    return {**geometry, "imported": {**geometry["imported"], **copies}}


def _checked(content: bytes, known: Published, origin: str) -> bytes:
    """The lines of `content` that are used. Raises InputError if it is not the published file."""
    digest = hashlib.sha256(content).hexdigest()
    if digest not in (known.sha256, known.rows_sha256):
        rows = f", or of its first {known.rows} rows, {known.rows_sha256}" if known.rows else ""
        raise InputError(
            f"{origin}: SHA-256 {digest} is not that of the published file ({known.sha256}{rows}); "
            f"replace it by {known.repository_path} of {REPOSITORY} at {COMMIT}"
        )
    if known.rows is None:
        return content
    return b"".join(content.splitlines(keepends=True)[: known.rows])


def find_in_mirror(relative_path: str, mirror: str | None) -> Path | None:
    """The file's place in the mirror, if there is one and it has the file."""
    mirror = os.environ.get(MIRROR_VARIABLE) or mirror
    if mirror is None:
        return None
    places = (Path(mirror) / relative_path, Path(mirror) / FILES[relative_path].repository_path)
    return next((place for place in places if place.is_file()), None)


def repository_url(relative_path: str) -> str:
    """Address of a published file at the pinned commit."""
    path = FILES[relative_path].repository_path
    return f"https://raw.githubusercontent.com/{REPOSITORY}/{COMMIT}/{path}"


def remedy() -> str:
    """How a user gets at the published files."""
    return (
        f"clone https://github.com/{REPOSITORY} (commit {COMMIT[:7]}) and name the folder in "
        f"resources.published_mirror or in the environment variable {MIRROR_VARIABLE}"
    )


def volunteer_available(config: dict) -> bool:
    """Whether a study has the published volunteer, so that one that cannot fetch completes without.

    Called whenever the workflow is parsed: it looks for the study's own copy and into the mirror;
    the repository is asked only by the job that fetches.
    """
    resources = config["resources"]
    available = (
        resources["download"]
        or Path(Layout.of(config["study"]).published(VOLUNTEER)).is_file()
        or find_in_mirror(VOLUNTEER, resources["published_mirror"]) is not None
    )
    # Said by the process that starts a run, and not by each of its jobs again.
    if not available and NOTICE_VARIABLE not in os.environ:
        os.environ[NOTICE_VARIABLE] = "given"
        log.warning(
            "The published volunteer is left out: resources.download is false and there is no "
            "mirror that has the file. To have it, %s.",
            remedy(),
        )
    return available
