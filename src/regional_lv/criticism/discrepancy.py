"""A discrepancy that no listed cause makes: the rival of all of them.

A smooth departure of unknown size and shape (Kennedy and O'Hagan 2001, doi
10.1111/1467-9868.00294): in equal parts common to a quantity, to its levels, to its walls, and each
channel's own. Of several hearts, it is another one in each, or common to all, as a defect of the
simulator is. Where it explains the data better than any set of causes, the catalogue lacks
something.
"""

import torch

from regional_lv.criticism.observations import Observations
from regional_lv.inference.departure import departure_covariance

AMPLITUDES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Its sd, in a good measurement's noise (`noise_units`); all equally likely."""


def unlisted_covariance(observations: Observations, emulator) -> torch.Tensor:
    """(S, D, D) at an amplitude of one, another one in each heart; zero where nothing was
    observed."""
    present = observations.present
    pattern = unlisted_pattern(observations, emulator)
    return torch.where(present[:, :, None] & present[:, None, :], pattern, 0.0)


def unlisted_pattern(observations: Observations, emulator) -> torch.Tensor:
    """(D, D) covariance of all channels at an amplitude of one."""
    return departure_covariance(observations.channels, emulator.output_sd.numpy())
