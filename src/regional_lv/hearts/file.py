"""The file of the emulator of any heart: small enough to come along with the package."""

import gzip
import hashlib
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import torch

from regional_lv.channels import Channels
from regional_lv.data import SHIPPED
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.errors import InputError
from regional_lv.hearts.emulator import HeartEmulator
from regional_lv.inputs.space import Inputs

LARGE = 500
"""Numbers from which on a tensor is kept in half its length."""

SHORT = {torch.float64: torch.float32, torch.float32: torch.float16, torch.int64: torch.int32}
"""Types of large tensors, and what they are kept as."""


@dataclass(frozen=True)
class AnyHeart:
    """The emulator of any heart.

    physics: what `inputs.space.sections_of` gave of the study that made it. card: what it says of
    itself (`hearts.card`). checksum: SHA-256 of its file.
    """

    emulator: JointGP
    physics: Mapping
    card: Mapping
    checksum: str

    @cached_property
    def known(self) -> Inputs:
        """The emulator's inputs, in the model that they are about."""
        return Inputs.from_config(self.physics).simulated

    def of_heart(
        self, physics: Mapping, channels: Channels, described: bool = False
    ) -> HeartEmulator:
        """In the coordinates of the simulated inputs of a heart within reach (`hearts.reach`),
        whose study `physics` describes, and of what that observes."""
        inputs = Inputs.from_config(physics)
        one = HeartEmulator(self.emulator, self.known, inputs, described)
        return one.select(channels.names)


def write(emulator: JointGP, physics: Mapping, card: Mapping, path: str | Path) -> None:
    """Write an `AnyHeart`. Of large arrays single precision is kept, of networks half."""
    plain = json.dumps({"physics": physics, "card": card}, default=float)
    content = {"emulator": emulator.content(), "plain": plain}
    raw = io.BytesIO()
    torch.save(_each(content, _shortened), raw)
    # Without name and time, so that the same emulator is the same file.
    Path(path).write_bytes(gzip.compress(raw.getvalue(), mtime=0))


def read(path: str | Path) -> AnyHeart:
    """What `write` wrote. Raises InputError for a file that is missing or is something else."""
    try:
        raw = Path(path).read_bytes()
        content = torch.load(io.BytesIO(gzip.decompress(raw)), weights_only=True)
        content = _each(content, _lengthened)
        emulator = JointGP.from_content(content["emulator"], path)
        plain = json.loads(content["plain"])
    except Exception as error:  # a damaged file makes PyTorch's reader raise nearly anything
        raise InputError(
            f"{path}: no emulator of any heart ({error}); `make heart-emulator` makes one"
        ) from error
    return AnyHeart(emulator, plain["physics"], plain["card"], hashlib.sha256(raw).hexdigest())


@cache
def shipped() -> AnyHeart:
    """The one that comes with the package, read once. Raises InputError where there is none."""
    return read(SHIPPED)


def _shortened(tensor: torch.Tensor) -> torch.Tensor:
    # Views of larger arrays would be kept with these.
    return tensor.to(SHORT.get(tensor.dtype, tensor.dtype)) if _is_large(tensor) else tensor.clone()


def _lengthened(tensor: torch.Tensor) -> torch.Tensor:
    long = {short: long for long, short in SHORT.items()}
    return tensor.to(long.get(tensor.dtype, tensor.dtype)) if _is_large(tensor) else tensor


def _is_large(tensor: torch.Tensor) -> bool:
    return tensor.numel() >= LARGE


def _each(content: Any, change: Callable[[torch.Tensor], torch.Tensor]) -> Any:
    """Plain values with every tensor changed."""
    if isinstance(content, torch.Tensor):
        return change(content)
    if isinstance(content, Mapping):
        return {key: _each(value, change) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return type(content)(_each(value, change) for value in content)
    return content
