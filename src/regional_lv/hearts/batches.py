"""Many hearts in one job: the emulator is read once, and a heart that fails does so alone."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from regional_lv.hearts.cohort import collected_warnings, configure, failing_alone
from regional_lv.hearts.listing import Listed
from regional_lv.study.layout import BatchFiles

log = logging.getLogger(__name__)


def answer_batch(
    hearts: Sequence[Mapping],
    shared: Mapping,
    folders: Sequence[str],
    checked: str | Path,
    folder: str | Path,
    answer: Callable[..., None] | None = None,
) -> None:
    """Answer the hearts of a batch, and write (JSON) why others could not be answered.

    hearts: each as the fields of `listing.Listed`. shared, folders: as of `cohort.configure`.
    checked: of `cohort.check_cohort`; a heart that this leaves out may be answered, and its page
    says why it is left out. folder: of the batch (`study.layout.BatchFiles`). answer:
    `hearts.fast.answer` by default.
    """
    left_out = json.loads(Path(checked).read_text())["left_out"]
    how, files, failed = answer or _fast(), BatchFiles(str(folder)), dict[str, str]()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for one in hearts:
        listed = Listed(**one)
        why = left_out.get(listed.name)
        notes = [] if why is None else [f"this heart is left out of its cohort: {why}"]
        with failing_alone(listed.name, failed):
            with collected_warnings():  # they are among those of `check_cohort`
                config = configure(listed, shared, folders)
            how(config, Path(files.heart(listed.name).folder), notes=notes)
        log.info("%s: %s", listed.name, failed.get(listed.name, "answered"))
    Path(files.failed).write_text(json.dumps(failed, indent=1) + "\n")


def _fast() -> Callable[..., None]:
    # Imported here: it brings PyTorch and figures along, which listing and tests need not wait for.
    from regional_lv.hearts.fast import answer

    return answer
