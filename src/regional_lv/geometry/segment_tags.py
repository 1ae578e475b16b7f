"""The AHA segment of every element of an imported mesh, from the files that can hold it."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import loadmat

from regional_lv import aha
from regional_lv.errors import InputError

COLUMNS = ["element", "aha_segment"]
PUBLISHED_FIELD = "elRegions"
"""Field of the paper's .mat file with one label per element, in the published order."""


def read_segment_tags(path, numbers):
    """AHA segment (m,) of the elements `numbers` (m,).

    `path`: a CSV with the columns `element` and `aha_segment`, or the paper's .mat file, whose
    labels are in the published order and in the order of the mesh file.
    """
    path = Path(path)
    if path.suffix.lower() == ".mat":
        return _read_published(path, len(numbers))
    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; give geometry.imported.segments a table of elements"
        ) from None
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a CSV table ({error}); save it as CSV in UTF-8") from None
    missing = [column for column in COLUMNS if column not in table.columns]
    if missing:
        raise InputError(f"{path}: column {', '.join(missing)} is missing; add it to the header")
    for column in COLUMNS:
        values = pd.to_numeric(table[column], errors="coerce")
        for row in np.flatnonzero(~(values % 1 == 0))[:1]:
            raise InputError(
                f"{path}, line {row + 2}: {column} is {table[column].iloc[row]!r}; give a whole "
                "number"
            )
        table[column] = values.astype(int)
    for row in np.flatnonzero(table["element"].duplicated())[:1]:
        raise InputError(
            f"{path}, line {row + 2}: element {table['element'].iloc[row]} was given before; keep "
            "one row per element"
        )
    for row in np.flatnonzero(~table["element"].isin(numbers))[:1]:
        raise InputError(
            f"{path}, line {row + 2}: the mesh has no element {table['element'].iloc[row]}; "
            "use the mesh file's own element numbers (from 1 in the file's order if it has none)"
        )
    # Elements without a row get 0, which is no segment.
    return table.set_index("element")["aha_segment"].reindex(numbers, fill_value=0).to_numpy()


def check_segment_tags(segment, numbers, origin):
    """Raise InputError for elements that belong to no segment and for segments without any."""
    wrong = numbers[~np.isin(segment, range(1, 18))]
    if len(wrong):
        raise InputError(
            f"{origin}: {name_elements(wrong)} without an AHA segment from 1 to 17; tag each "
            "element"
        )
    empty = sorted(set(range(1, 18)) - set(segment.tolist()))
    if empty:
        raise InputError(
            f"{origin}: segment {', '.join(map(str, empty))} has no element; tag the elements of "
            "all 17 segments with the official AHA numbers"
        )


def name_elements(numbers):
    """The first few element numbers in words."""
    shown = ", ".join(map(str, numbers[:5]))
    more = f" and {len(numbers) - 5} more" if len(numbers) > 5 else ""
    return f"element{'s' if len(numbers) > 1 else ''} {shown}{more}"


def _read_published(path, size):
    try:
        content = loadmat(path, simplify_cells=True)
    except OSError:  # SciPy's own, which is no FileNotFoundError
        raise InputError(
            f"{path}: no such file; give geometry.imported.segments the paper's .mat file"
        ) from None
    except (ValueError, NotImplementedError) as error:
        raise InputError(f"{path}: not a MATLAB file ({error}); give a CSV instead") from None
    fields = [value for value in content.values() if isinstance(value, dict)]
    labels = next((f[PUBLISHED_FIELD] for f in fields if PUBLISHED_FIELD in f), None)
    if labels is None:
        raise InputError(f"{path}: holds no {PUBLISHED_FIELD}; give a CSV of elements instead")
    labels = np.asarray(labels, dtype=int)
    if labels.shape != (size,):
        raise InputError(
            f"{path}: labels {labels.size} elements but the mesh has {size}; give the labels of "
            "this mesh"
        )
    known = (labels >= 1) & (labels <= 17)
    segment = np.zeros(size, dtype=int)
    segment[known] = aha.aha_to_published[labels[known] - 1] + 1
    return segment
