"""What the sections of a configuration are made of: pydantic models, and types of their keys.

A key is a field: its type holds the limits, its docstring is the text of config/README.md and of
messages, and its default is what stands where nothing is given. What has to fit between keys is
said by `Section.check`.
"""

import ast
import functools
import glob
import inspect
import itertools
import os
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from regional_lv.errors import InputError, closest


@dataclass
class Reading:
    """A configuration that is being read, the context of its validation.

    folders: from which paths may count. files: those that keys name and that are there. empty:
    lines about keys that wait to be filled in.
    """

    folders: Sequence[str | Path] = ()
    files: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Note:
    """What else is said of a key, beside its type, default and docstring.

    unit: where the key's name does not end with it. reruns: what is made again when it changes,
    where that is not its section's. remedy: what to do about a value that is not possible, and
    names: about a name that is not.
    """

    unit: str = ""
    reruns: str = ""
    remedy: str = ""
    names: str = "use letters, digits and underscores, and begin with a letter"


def note(key: FieldInfo | None, what: str) -> str:
    """What the notes on a key say, such as its `unit`; the outermost one counts."""
    notes = [each for each in key.metadata if isinstance(each, Note)] if key else []
    return next(filter(None, (getattr(each, what) for each in notes)), getattr(Note, what))


# ------------------------------------------------------------------------------- types of values


def _whole(value):
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _once(values: list) -> list:
    if len(set(map(repr, values))) < len(values):
        raise PydanticCustomError("repeated", "repeated")
    return values


def _file(path: str, info: ValidationInfo) -> str:
    reading = info.context or Reading()
    if not os.path.isabs(path):
        for folder in reading.folders:
            if (Path(folder) / path).is_file():
                path = _from_here(Path(folder) / path)
                break
    if Path(path).is_file():
        reading.files.append(path)
    return path


def _pattern(pattern: str, info: ValidationInfo) -> str:
    if not os.path.isabs(pattern):
        for folder in (info.context or Reading()).folders:
            if glob.glob(os.path.join(glob.escape(str(folder)), pattern)):
                return os.path.join(glob.escape(_from_here(Path(folder))), pattern)
    return pattern


def _from_here(path: Path) -> str:
    """A path from the working directory. Behind a link `..` leads where the link's target lies,
    which the text of the path does not say."""
    return os.path.relpath(path.resolve() if ".." in path.parts else path)


Whole = Annotated[int, BeforeValidator(_whole)]
"""80 and 80.0 are the same value, or Snakemake sees a change where there is none."""
Count = Annotated[Whole, Field(ge=1)]
Natural = Annotated[Whole, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Part = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=-90, le=90)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
FilePath = Annotated[str, AfterValidator(_file)]
"""Counts from a folder of the configuration if it leads to a file from there."""
FilePattern = Annotated[str, AfterValidator(_pattern)]
"""As `FilePath`, a pattern of paths."""
ONCE = AfterValidator(_once)
"""Of a list that names nothing twice."""
WORD, OTHER = Tag("\0word"), Tag("\0other")
TEXT_OR_ELSE = Discriminator(lambda value: "\0word" if isinstance(value, str) else "\0other")
"""Of a key that takes words (`WORD`) or another type (`OTHER`), so that a mistake is one in the
type that was meant."""


def alternatives(annotation) -> list:
    """The types that an annotation allows, without what is annotated."""
    origin = typing.get_origin(annotation)
    if origin is Annotated:
        return alternatives(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        return [t for each in typing.get_args(annotation) for t in alternatives(each)]
    return [annotation]


def choices(kinds: list) -> list:
    """What a key of these types offers."""
    literal = typing.Literal
    offered = [c for k in kinds if typing.get_origin(k) is literal for c in typing.get_args(k)]
    return [*offered, *["null"] * (type(None) in kinds)] if offered else []


def is_section(kind) -> bool:
    """Whether a type is a section."""
    return isinstance(kind, type) and issubclass(kind, Section)


def by_default(**tag):
    """Of a union of kinds, the tag that counts where none is given."""
    return BeforeValidator(lambda given: tag | given if isinstance(given, dict) else given)


# -------------------------------------------------------------------------------------- sections


class Section(BaseModel):
    """Keys with values.

    Class arguments
    ---------------
    reruns: what is made again when a key of it changes; without, that of the section around it.
    added: gives the names of keys that plugins add, whose type is that of `__pydantic_extra__`;
        without, every name that this allows.
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    reruns: ClassVar[str] = ""
    added: ClassVar[Callable[[], Collection[str]] | None] = None

    def __init_subclass__(cls, reruns: str = "", added=None, **kwargs):
        super().__init_subclass__(**kwargs)
        cls.reruns = reruns or cls.reruns
        cls.added = added or cls.added

    def check(self, key: str, study) -> Iterator[str]:
        """Lines about what does not fit within the section, to the rest of the study or to files.

        key: path of the section. study: the whole, a `study.Configuration`. InputError, for what
        cannot be looked at because of a mistake that is reported elsewhere, ends it.
        """
        return iter(())

    @classmethod
    def of_added(cls) -> tuple:
        """The types of keys that plugins add."""
        hints = (vars(kind).get("__annotations__", {}) for kind in cls.__mro__)
        extra = next((h["__pydantic_extra__"] for h in hints if "__pydantic_extra__" in h), None)
        return typing.get_args(extra)[1:]


class Kind(Section):
    """A section whose keys depend on one of them, the `tag`.

    One class, the family, says which that is and has what all kinds share; its subclasses have what
    they have alone. In what is read, keys of other kinds have their defaults (null where they have
    none), so that code finds every key.
    """

    tag: ClassVar[str] = ""
    family: ClassVar[type["Kind"]]

    def __init_subclass__(cls, tag: str = "", **kwargs):
        super().__init_subclass__(**kwargs)
        if tag:
            cls.tag, cls.family = tag, cls

    @classmethod
    def tags(cls) -> tuple[str, ...]:
        """The values of the tag that this kind has; of a family, none."""
        return typing.get_args(cls.model_fields[cls.tag].annotation)

    @classmethod
    def kinds(cls) -> list[type["Kind"]]:
        """This kind, or of a family all that it has."""
        return [cls] if cls.tags() else [k for each in cls.__subclasses__() for k in each.kinds()]

    @classmethod
    def all_tags(cls, key: str | None = None) -> list[str]:
        """The tags of the family's kinds, or of those that have a key."""
        kinds = (kind for kind in cls.family.kinds() if key is None or key in kind.model_fields)
        return [tag for kind in kinds for tag in kind.tags()]

    @classmethod
    def absent_defaults(cls) -> dict:
        """The keys that only other kinds have, with their defaults."""
        fields = {k: v for kind in cls.family.kinds() for k, v in kind.model_fields.items()}
        others = {k: v for k, v in fields.items() if k not in cls.model_fields}
        values: dict = {k: None if v.is_required() else v.get_default() for k, v in others.items()}
        return {k: v.model_dump() if is_section(type(v)) else v for k, v in values.items()}

    @model_validator(mode="before")
    @classmethod
    def _drop_absent(cls, given):
        if not isinstance(given, dict):
            return given
        absent = cls.absent_defaults()
        return {k: v for k, v in given.items() if k not in absent or v not in (None, absent[k])}

    @model_serializer(mode="wrap")
    def _fill_absent(self, own):
        return own(self) | self.absent_defaults()


def text_of(section: type[Section], key: str) -> str:
    """The docstring of a key, that of a base class if it has none of its own."""
    texts = (_texts(c.__module__).get(c.__name__, {}) for c in section.__mro__ if is_section(c))
    return next((text[key] for text in texts if key in text), "")


@functools.cache
def _texts(module: str) -> dict[str, dict[str, str]]:
    """The docstrings of the keys of a module's classes, read when they are asked for: pydantic can
    read them for every process that imports the classes, which takes as long as the import."""
    code = ast.parse(inspect.getsource(sys.modules[module])).body
    texts: dict[str, dict[str, str]] = {}
    for section in (each for each in code if isinstance(each, ast.ClassDef)):
        for key, text in itertools.pairwise(section.body):
            match key, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value)):
                    texts.setdefault(section.name, {})[name] = " ".join(str(value).split())
    return texts


# -------------------------------------------------------------------------------------- messages


def key_path(*parts: str) -> str:
    """The names of sections and key as messages write them, with points between; "" is skipped."""
    return ".".join(part for part in parts if part)


def shown(value) -> str:
    """A value as messages write it, without the middle of what is long."""
    text = "an empty value" if value is None else repr(value)
    return text if len(text) <= 300 else f"{text[:200]} ... {text[-50:]}"


def offers(value, offered: Iterable) -> str:
    """What is wrong with a value that is not `offered`, and the remedy."""
    words = list(map(str, offered))
    close = closest(value, words)
    hint = f"; did you mean {close}?" if close else ""
    return f"{shown(value)} is not offered; choose one of {', '.join(words)}{hint}"


def not_offered(key: str, names: Iterable[str], known: Collection[str]) -> Iterator[str]:
    """Lines about names at `key` that are not among the `known` ones."""
    return (f"{key}: {offers(name, known)}" for name in names if name not in known)


def complaints(make: Callable, *arguments) -> list[str]:
    """What a function of the library has against its arguments."""
    try:
        make(*arguments)
    except InputError as error:
        return [str(error)]
    return []
