"""What stops a job through no fault of its input, in words: a full disk, a folder that cannot be
written, too little memory, a damaged file."""

import errno
import json
from collections.abc import Callable, Iterable
from pathlib import Path

from regional_lv.errors import InputError
from regional_lv.input_files import reason_of
from regional_lv.study.layout import Layout, study_of

AGAIN = "run the same command again: what is finished is kept"

FULL = {errno.ENOSPC, errno.EDQUOT}
REFUSED = {errno.EROFS, errno.EACCES, errno.EPERM}
FULL_WORDS = ("No space left on device", "Disk quota exceeded")
"""How libraries that raise an error of their own quote the system's."""


def explain(error: BaseException, inputs: Iterable[str], outputs: Iterable[str]) -> str:
    """What happened and the remedy, if `error` of a job with these files is such a fault; else "".

    Inputs are read, whole, only here: after a job has failed.
    """
    number = getattr(error, "errno", None)
    folder = next((str(Path(file).parent) for file in outputs), ".")
    if number in FULL or any(words in str(error) for words in FULL_WORDS):
        return f"{folder}: no space left on its disk; make room and {AGAIN}"
    if isinstance(error, OSError) and number in REFUSED:
        where = error.filename or folder
        return f"{where}: {reason_of(error)}; make it accessible and {AGAIN}"
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):
        return (
            "the memory of this machine does not suffice; run fewer jobs at a time (`--cores 1`), "
            f"or simulate on a coarser mesh (`mesh`), and {AGAIN}"
        )
    if isinstance(error, InputError):
        # It says what is wrong with a file of the user's. Of one that the study made, which is
        # half there or empty, it says only what is missing in it.
        made = tuple(f"{Layout.of(study_of(file)).folder}/" for file in outputs)
        inputs = [file for file in inputs if str(file).startswith(made)]
    for file in inputs:
        if damage := damage_of(file):
            return (
                f"{file}: damaged ({damage}); if the study made it, delete it and {AGAIN}; if it "
                "is your own, replace it"
            )
    return ""


def damage_of(file: str | Path) -> str:
    """Why a file cannot be read as what its ending says; "" if it can, or if nothing is known of
    such files."""
    path = Path(file)
    read = READERS.get(path.suffix)
    if read is None or not path.is_file():
        return ""
    if path.stat().st_size == 0:
        return "empty"
    try:
        read(path)
    except SystemExit:  # meshio's way
        return "cannot be read"
    except Exception as error:
        return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
    return ""


def _csv(path: Path) -> None:
    import pandas as pd

    pd.read_csv(path, comment="#")


def _json(path: Path) -> None:
    json.loads(path.read_text())


def _netcdf(path: Path) -> None:
    import xarray as xr

    xr.load_datatree(path, engine="h5netcdf")


def _npz(path: Path) -> None:
    import numpy as np

    with np.load(path, allow_pickle=False) as arrays:
        for name in arrays:
            arrays[name]


def _parquet(path: Path) -> None:
    import pyarrow.parquet as pq

    pq.read_table(path)


def _torch(path: Path) -> None:
    import torch

    torch.load(path, weights_only=True)


def _mesh(path: Path) -> None:
    import meshio

    meshio.read(path)


READERS: dict[str, Callable[[Path], None]] = {
    ".csv": _csv,
    ".json": _json,
    ".nc": _netcdf,
    ".npz": _npz,
    ".parquet": _parquet,
    ".pt": _torch,
    ".vtu": _mesh,
}
"""Ending -> what reads such a file whole, and raises if it cannot."""
