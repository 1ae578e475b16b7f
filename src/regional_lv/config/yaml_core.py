"""YAML whose values mean what they look like: the core schema of YAML 1.2.

PyYAML follows YAML 1.1, in which 012 is ten, 1:30 is ninety, 1_000 is a thousand, `no` is false and
1e3 is text. Section 10.3.2 of the specification of YAML 1.2.2 says what they are here: 012 is
twelve, 0o14 too, 1e3 is a number, `true` and `false` are the only truth values, and the others are
text. Keys are text, whatever they look like.
"""

import copy
import re
from typing import ClassVar

import yaml

_TAG = "tag:yaml.org,2002:"
_NUMBER_STARTS = list("-+.0123456789")


class _Loader(yaml.SafeLoader):
    """Also refuses a key that occurs twice, of which YAML takes the last one without a word."""

    yaml_implicit_resolvers: ClassVar[dict] = {}

    def compose_mapping_node(self, anchor):
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for at, (key, value) in enumerate(node.value):
            name = str(key.value)
            if name in lines:
                there = f"`{name}` is in line {lines[name]} already; remove one of both"
                raise yaml.composer.ComposerError(None, None, there, key.start_mark)
            lines[name] = key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode) and key.tag != f"{_TAG}merge":
                # An alias may use the same node as a value.
                key = copy.copy(key)
                key.tag = f"{_TAG}str"
                node.value[at] = (key, value)
        return node

    def construct_int(self, node) -> int:
        text = self.construct_scalar(node)
        base = {"0o": 8, "0x": 16}.get(text[:2], 10)
        return int(text if base == 10 else text[2:], base)

    def construct_float(self, node) -> float:
        text = self.construct_scalar(node).lower()
        return float(re.sub(r"\.(?=inf|nan)", "", text))


for _kind, _form, _starts in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", _NUMBER_STARTS),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
        r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        _NUMBER_STARTS,
    ),
    ("merge", "<<", ["<"]),
):
    _Loader.add_implicit_resolver(f"{_TAG}{_kind}", re.compile(rf"(?:{_form})\Z"), _starts)
_Loader.add_constructor(f"{_TAG}int", _Loader.construct_int)
_Loader.add_constructor(f"{_TAG}float", _Loader.construct_float)


def parse(text: str):
    """What a document holds: sections, lists, text, numbers, truth values and None.

    Raises yaml.YAMLError, also for a key that occurs twice.
    """
    return _Loader(text).get_single_data()


def value_of(text: str):
    """What a value without quotes means."""
    loader = _Loader("")
    tag = loader.resolve(yaml.ScalarNode, text, (True, False))
    return loader.construct_object(yaml.ScalarNode(tag, text))
