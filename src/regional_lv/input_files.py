"""Files that people bring: opened, bounded, and handed to readers that may fail in any way.

Whatever a reader of another library raises over such a file becomes an InputError here, and it may
not take more memory than `MOST_GB` on top of what the process has.
"""

import codecs
import contextlib
import hashlib
import os
import re
import resource
from collections.abc import Iterator
from pathlib import Path

from regional_lv.errors import InputError

MOST_MB = 500
"""Size of a file that is read at all."""
MOST_GB = 4
"""Memory that reading one file may take."""

WORKBOOKS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
"""How files of spreadsheets begin."""

COUNTS = re.compile(rb'NumberOf\w+\s*=\s*["\'](\d+)|^element \w+ (\d+)', re.MULTILINE)
"""How XML of VTK and PLY announce numbers of points and cells."""


def reason_of(error: OSError | ValueError) -> str:
    """What a system call says of its failure, in lower case."""
    return (getattr(error, "strerror", None) or str(error)).lower()


def check_file(path: str | Path, most_mb: float = MOST_MB, remedy: str = "check the path") -> Path:
    """The path of a regular file of at most `most_mb`. Raises InputError for anything else."""
    path = Path(path)
    try:
        size, is_file = path.stat().st_size, path.is_file()
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; {remedy}") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({reason_of(error)}); {remedy}") from error
    if not is_file:
        raise InputError(f"{path}: is no file; {remedy}")
    if size > most_mb * 1e6:
        raise InputError(
            f"{path}: has {size / 1e6:.0f} MB, and at most {most_mb:g} are read; give a smaller "
            "file"
        )
    return path


def check_counts(path: Path) -> None:
    """Raise InputError for a mesh whose header announces more points or cells than it has bytes."""
    content = path.read_bytes()
    most = max((int(a or b) for a, b in COUNTS.findall(content)), default=0)
    if most > len(content):
        raise InputError(
            f"{path}: announces {most} points or cells in {len(content)} bytes; it is cut off or "
            "damaged: export it again"
        )


def without_mark(content: bytes) -> bytes:
    """Text without a byte order mark; what is in UTF-16 becomes UTF-8."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16").encode()
    return content.removeprefix(codecs.BOM_UTF8)


def without_braces(path: str, folder: str | Path) -> str:
    """A path of the same file that has no braces, which Snakemake takes for wildcards: `path`
    itself, or a link in `folder`, which is made."""
    if not set(path) & set("{}"):
        return path
    target = os.path.abspath(path)
    digest = hashlib.sha256(target.encode("utf-8", "surrogateescape")).hexdigest()[:12]
    link = Path(folder) / f"{digest}-{re.sub('[{}]', '', Path(path).name)}"
    if not link.is_symlink():
        link.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):  # made by another process at the same moment
            link.symlink_to(target)
    return str(link)


def read_text(path: str | Path, most_mb: float = MOST_MB) -> str:
    """The text of a file in UTF-8, with or without a byte order mark, or in UTF-16 with one. Raises
    InputError."""
    check_file(path, most_mb)
    with reading(path, "save it in UTF-8", most_mb):
        content = Path(path).read_bytes()
        if content.startswith(WORKBOOKS):
            raise InputError(f"{path}: is a workbook of Excel; save it as CSV (UTF-8)")
        return without_mark(content).decode()


@contextlib.contextmanager
def reading(path: str | Path, remedy: str, most_mb: float = MOST_MB) -> Iterator[None]:
    """Within it, a reader of another library works on `path`; it may fail, but only as InputError.

    Raises InputError with the `remedy` for whatever is raised inside, for a file that is too large
    and for one that takes too much memory.
    """
    check_file(path, most_mb, remedy)
    with _bounded_memory():
        try:
            yield
        except InputError:
            raise
        except MemoryError:
            complaint = f"reading it takes more than {MOST_GB} GB of memory"
        except RecursionError:
            complaint = "it is nested too deeply"
        except SystemExit:  # meshio ends the process over some files
            complaint = "it is damaged, or not of the kind that its name says"
        except Exception as error:
            complaint = f"{type(error).__name__}: {str(error)[:500]}"
        else:
            return
    # Outside the handler, so that what was read so far is free again.
    raise InputError(f"{path}: cannot be read ({complaint}); {remedy}")


@contextlib.contextmanager
def _bounded_memory() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MOST_GB * 2**30
    if before[0] != resource.RLIM_INFINITY:
        most = min(most, before[0])
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
