"""What the user's machine has set, kept away from the project's processes.

A backend of matplotlib for notebooks, a home that cannot be written, modules in the working folder:
none of these may change or stop a study.
"""

import os
import sys
import tempfile
import warnings
from importlib.util import find_spec
from pathlib import Path

PLACES = {
    "XDG_CACHE_HOME": "~/.cache",
    "XDG_CONFIG_HOME": "~/.config",
    "MPLCONFIGDIR": None,
}
"""Variables of folders that libraries write to, and what stands for one that is not set."""


def settle() -> None:
    """Change the environment of a process of the project's, for itself and for those that it
    starts: figures need no display, text is UTF-8, modules of the working folder are not found, and
    libraries compute on one core, unless the user says how many (OMP_NUM_THREADS)."""
    os.environ |= {"MPLBACKEND": "agg", "PYTHONSAFEPATH": "1", "PYTHONUTF8": "1"}
    # Matrices are small here, so that threads wait for each other most of the time, and jobs run
    # beside each other: beside two other jobs on two cores, simulations take 1.8 times the CPU
    # time on all cores, and the fast answer six times.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _forget_working_folder()
    # For those who write programs with ArviZ, on the first import of a day, and with PyTorch.
    for start in (r"\s*ArviZ is undergoing", r"`torch\.jit\."):
        warnings.filterwarnings("ignore", start, FutureWarning)


def adapt() -> None:
    """Change what would stop imports, in whatever program; called when the package is imported.

    Folders of caches that cannot be written are replaced by one under TMPDIR, and a line on stderr
    says so.
    """
    _replace_backend()
    _move_caches()


def _replace_backend() -> None:
    """Of matplotlib, if it is a module that is not there: shells that a notebook starts inherit the
    notebook's, and matplotlib cannot be imported then."""
    module = os.environ.get("MPLBACKEND", "").removeprefix("module://")
    try:
        there = "." not in module or find_spec(module) is not None
    except ImportError:
        there = False
    if not there:
        os.environ["MPLBACKEND"] = "agg"


def _forget_working_folder() -> None:
    """Drop what PYTHONPATH has of the working folder, unless this package is there: an empty entry,
    such as the one that `PYTHONPATH=$PYTHONPATH:/opt/lib` makes, and relative ones."""
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    own = Path(__file__).resolve().parents[2]
    kept = [os.path.abspath(p) for p in entries if os.path.isabs(p) or Path(p).resolve() == own]
    dropped = {os.path.abspath(path) for path in entries if path} | {os.getcwd()}
    if any(entries):
        os.environ["PYTHONPATH"] = os.pathsep.join(kept)
        sys.path[:] = [path for path in sys.path if path not in dropped - set(kept)]


def _move_caches() -> None:
    if not os.path.isdir(os.path.expanduser("~")):
        # Whoever asks for it without need of it would be stopped, too.
        os.environ["HOME"] = str(_other_home())
        _say("there is no home folder", os.environ["HOME"])
    for variable, usual in PLACES.items():
        place = os.environ.get(variable) or usual
        if place is None:
            continue
        place = os.path.expanduser(place)
        try:
            os.makedirs(place, exist_ok=True)
            with tempfile.TemporaryFile(dir=place) as file:
                file.write(b"a cache")
        except OSError as error:
            from regional_lv.input_files import reason_of

            new = _other_home() / variable.lower()
            new.mkdir(exist_ok=True)
            os.environ[variable] = str(new)
            _say(f"{place} cannot be written ({reason_of(error)})", new)


def _other_home() -> Path:
    """A folder under TMPDIR that is this user's and nobody else's: compiled code is loaded from
    it."""
    folder = Path(tempfile.gettempdir()) / f"regional-lv-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if folder.is_symlink() or found.st_uid != os.getuid() or found.st_mode & 0o022:
        return Path(tempfile.mkdtemp(prefix="regional-lv-"))
    return folder


def _say(what, folder) -> None:
    print(f"note: {what}; caches go to {folder}", file=sys.stderr)
