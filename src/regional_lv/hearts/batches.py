"""Many hearts in one job: the emulator is read once, and a heart that fails does so alone."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from regional_lv.errors import InputError
from regional_lv.hearts.cohort import collected_warnings, configure
from regional_lv.hearts.listing import Listed
from regional_lv.study.layout import BatchFiles

log = logging.getLogger(__name__)

OF_THE_MACHINE = (OSError, MemoryError)
"""What no heart is to blame for: the job fails, and is done again as a whole."""


def answer_batch(
    hearts: Sequence[Mapping],
    shared: Mapping,
    folders: Sequence[str],
    folder: str | Path,
    answer: Callable[[Mapping, Path], None] | None = None,
) -> None:
    """Answer the hearts of a batch, and write (JSON) why others could not be answered.

    hearts: each as the fields of `listing.Listed`. shared, folders: as of `cohort.configure`.
    folder: of the batch (`study.layout.BatchFiles`). answer: `hearts.fast.answer` by default.
    """
    how, files, failed = answer or _fast(), BatchFiles(str(folder)), dict[str, str]()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for one in hearts:
        listed = Listed(**one)
        try:
            with collected_warnings():  # they are among those of `check_cohort`
                config = configure(listed, shared, folders)
            how(config, Path(files.heart(listed.name).folder))
        except OF_THE_MACHINE:
            raise
        except InputError as error:
            failed[listed.name] = str(error)
        except Exception as error:
            log.exception("%s", listed.name)
            failed[listed.name] = f"{type(error).__name__}: {error}"
        log.info("%s: %s", listed.name, failed.get(listed.name, "answered"))
    Path(files.failed).write_text(json.dumps(failed, indent=1) + "\n")


def _fast() -> Callable[[Mapping, Path], None]:
    # Imported here: it brings PyTorch and figures along, which listing and tests need not wait for.
    from regional_lv.hearts.fast import answer

    return answer
