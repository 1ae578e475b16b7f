"""Hostile variants of valid input, as Hypothesis strategies, and what a reader may do with them."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import hypothesis.strategies as st
from hypothesis import HealthCheck, settings

from regional_lv.errors import InputError

REMEDY = re.compile(
    r"\b(add|attach|begin|change|check|choose|close|convert|correct|did you mean|exchange|export|"
    r"fill in|flip|flatten|give|keep|leave|lower|make|move|multiply|must|allowed here|"
    r"name|omit|raise|remove|rename|save|separate|set|shorten|smooth|sort|split|tag|turn|use|write)\b"
)
"""Words of which the remedy in a message has one."""

NASTY_TEXT = (
    *("", " ", "nan", "inf", "-inf", "1e309", "-1", "0", "1e-320", "99999999999999999999", "0x10"),
    *("1_0", "1,5", "١٢", "½", "²", "null", "true", "\x00", "\x85", "\u2028", "\ufeff", "\ud7ff"),
    *('"', '"a\nb"', "=1+1", "#", "../../etc/passwd", "<script>alert(1)</script>", "a" * 200_000),
    *("é", "\U0001f4a9", "1;2", "1\t2", "\r", "\n", "%s%n", "{0}", "{x}", "--", "volume", "1.0.0"),
)
NASTY_BYTES = (
    *(b"\x00", b"\xff", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1f\x8b\x08", b"PK\x03\x04", b"\x80\x04"),
    *(b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00" * 64, b"-", b"9" * 25, b"<", b">", b"&a;"),
    *(b'"', b"'", b"\n", b"\r", b",", b"*", b"\t", b" ", b"1e999", b"nan", b"\xc3\x28", b"!!"),
)


def profile(share: float = 1.0) -> settings:
    """Deterministic; FUZZ_EXAMPLES (default 10) times `share` examples."""
    examples = max(1, round(share * int(os.environ.get("FUZZ_EXAMPLES", "10"))))
    return settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        print_blob=False,
        suppress_health_check=list(HealthCheck),
    )


def accepted_or_refused(path: str | Path, read: Callable, *arguments):
    """What `read` makes of a file, or None if it says which file cannot be used, and the remedy."""
    try:
        return read(*arguments)
    except InputError as error:
        message = str(error)
        assert Path(path).name in message, message
        assert REMEDY.search(message), message
        assert len(message) < 20_000, message[:500]
        return None


@st.composite
def broken_bytes(draw, valid: bytes) -> bytes:
    """One to four edits of bytes: changed, lost, repeated, moved, put in, cut off, re-encoded."""
    data = valid
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        if draw(st.booleans()):  # the beginning has the header
            start %= 400
        end = start + draw(st.integers(0, draw(st.sampled_from((4, 40, 4000)))))
        kind = draw(st.sampled_from(("put", "change", "lose", "repeat", "cut", "flip", "encode")))
        if kind == "put":
            data = data[:start] + draw(st.sampled_from(NASTY_BYTES)) + data[start:]
        elif kind == "change":
            new = draw(st.sampled_from(NASTY_BYTES) | st.binary(max_size=8))
            data = data[:start] + new + data[start + len(new) :]
        elif kind == "lose":
            data = data[:start] + data[end:]
        elif kind == "repeat":
            data = data[:end] + data[start:end] * draw(st.integers(1, 3)) + data[end:]
        elif kind == "cut":
            data = data[:start] if draw(st.booleans()) else data[start:]
        elif kind == "flip" and start < len(data):
            bit = 1 << draw(st.integers(0, 7))
            data = data[:start] + bytes([data[start] ^ bit]) + data[start + 1 :]
        elif kind == "encode" and draw(st.integers(0, 5)) == 0:
            coding = draw(st.sampled_from(("utf-16", "utf-16-le", "utf-32", "cp037")))
            data = data.decode("latin-1").encode(coding, "replace")
    return data


@st.composite
def broken_table(draw, valid: list[list[str]], first: int = 0) -> str:
    """One to four edits of cells, rows and columns of a table of text; its lines joined."""
    rows = [list(row) for row in valid]
    separator = ","
    for _ in range(draw(st.integers(1, 4))):
        if not rows:
            break
        i = draw(st.integers(0, len(rows) - 1))
        if draw(st.integers(0, 3)) == 0:
            i = min(first, len(rows) - 1)
        j = draw(st.integers(0, max(len(rows[i]) - 1, 0)))
        kind = draw(
            st.sampled_from(("cell", "cell", "cell", "number", "row", "again", "column", "sep"))
        )
        if kind == "cell" and rows[i]:
            rows[i][j] = draw(st.sampled_from(NASTY_TEXT) | st.text(max_size=6))
        elif kind == "number" and rows[i]:
            rows[i][j] = repr(draw(st.floats() | st.integers() | st.floats(-300, 300)))
        elif kind == "row":
            del rows[i]
        elif kind == "again":
            rows.insert(draw(st.integers(0, len(rows))), list(rows[i]))
        elif kind == "column":
            keep = draw(st.booleans())
            for row in rows:
                if j < len(row):
                    row.append(row[j]) if keep else row.pop(j)
        elif kind == "sep":
            separator = draw(st.sampled_from((";", "\t", ", ", " ", "|", ",")))
    return draw(st.sampled_from(("\n", "\n", "\r\n", "\r"))).join(map(separator.join, rows))


NASTY_VALUES = (
    *(None, True, "", " ", "nan", "1e-8", "../../x", "/etc/passwd", "x\ny", "x\n", "a" * 5000),
    *("\x00", "<script>", -1, 0, 1, 2**31, 2**63, 10**400, -(10**400), 1e308, -1e308, 1e-320),
    *(float("nan"), float("inf"), float("-inf"), 0.5, [], {}, [[]], [None], [{}], {"a": {}}),
    *([1, 2], ["x", "x"], {"x": 1}, {"../x": {}}, {"x\n": {}}, {"": {}}, "volunteer", "/dev/zero"),
)


def values():
    """Values that YAML can hold."""
    plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    nested = st.recursive(
        plain,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
        max_leaves=6,
    )
    return st.sampled_from(NASTY_VALUES) | nested


def places(value, path: tuple = ()) -> list[tuple]:
    """The paths of all entries of nested sections and lists."""
    found = [path] if path else []
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    for key, inner in items:
        found += places(inner, (*path, key))
    return found
