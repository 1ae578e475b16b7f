"""Each segment predicted from all other channels, by a model that is linear about its fit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import torch

from regional_lv.criticism import contract
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.criticism.patterns import groups_of
from regional_lv.emulators.gaussian import LOG_2PI, Z95
from regional_lv.emulators.reduction import VOLUME
from regional_lv.inference.observed import Observed


@dataclass(frozen=True)
class LeftOut:
    """Predictions of D channels, each from those outside its group: mean and sd (D,). y (D,): what
    was observed. elpd (F,): log predictive density of each group (`groups_of`)."""

    observed: Observed
    y: torch.Tensor
    mean: torch.Tensor
    sd: torch.Tensor
    elpd: torch.Tensor

    def rmse(self, mask: Sequence[bool]) -> float | None:
        """Of the predictions of some channels (D,); None without any."""
        error = (self.y - self.mean)[torch.tensor(mask)]
        return float(error.square().mean().sqrt()) if len(error) else None

    @property
    def coverage(self) -> float:
        """Share of the channels within their 95 % intervals."""
        return float(((self.y - self.mean).abs() <= Z95 * self.sd).double().mean())

    def channels(self, subjects: Sequence[str]) -> list[contract.Channel]:
        """As the findings have them; subjects: name of each heart."""
        values = (self.y, self.mean, self.sd)
        rows = zip(self.observed.channels, self.observed.heart, *values, strict=True)
        return [
            {
                "subject": subjects[heart],
                "output": channel.name,
                "quantity": channel.quantity,
                "segment": channel.segment,
                "load_fraction": channel.load_fraction,
                "observed": float(y),
                "predicted": float(mean),
                "sd": float(sd),
                "z": float((y - mean) / sd),
            }
            for channel, heart, y, mean, sd in rows
        ]


def left_out(linear: LinearModel) -> LeftOut:
    """Leave each group of channels out in turn.

    Noise scales are estimated from the other channels, and the parameters have their posterior
    given these, within their ranges (`evidence.integrate`). Errors that channels have in common,
    those of the emulator and of measured inputs, tell of those left out, too.
    """
    groups = groups_of(linear.observed)
    keep = torch.ones(len(groups), len(linear.y), dtype=torch.bool)
    for row, at in enumerate(groups):
        keep[row, at] = False
    mean, sd, elpd = linear.y.clone(), torch.ones_like(linear.y), []
    waiting = iter(groups)
    for part in linear.batches(keep):
        found = linear.fit(linear.y.expand(len(part), -1), part)
        change, covariance = linear.posterior(found)
        error = linear.y - linear.mean - change @ linear.slopes.mT
        precision = linear.precision(found.log_sigma).expand(len(part), -1, -1)
        for row, at in enumerate(islice(waiting, len(part))):
            own = torch.linalg.inv(precision[row][at[:, None], at])
            given, moved = (
                own @ precision[row, at] @ columns for columns in (error[row], linear.slopes)
            )
            spread = own + moved @ covariance[row] @ moved.mT
            distance = given @ torch.linalg.solve(spread, given)
            elpd.append(-0.5 * (distance + torch.logdet(spread) + len(at) * LOG_2PI))
            mean[at] -= given
            sd[at] = spread.diagonal().sqrt()
    return LeftOut(linear.observed, linear.y, mean, sd, torch.stack(elpd))


def gain(before: LeftOut, after: LeftOut) -> tuple[float, float]:
    """Gain of log predictive density, and its standard error, as of a sample of groups (Vehtari,
    Gelman and Gabry 2017, doi 10.1007/s11222-016-9696-4, eq. 24); NaN of a single group."""
    difference = after.elpd - before.elpd
    count = len(difference)
    error = math.sqrt(count * float(difference.var())) if count > 1 else math.nan
    return float(difference.sum()), error


def gains(before: LeftOut, after: LeftOut | None) -> contract.Gain:
    """What a model gains over the model as it is; None: there is no other one."""
    elpd, error = gain(before, after) if after else (None, None)
    channels = before.observed.channels
    strains = [channel.kind.is_strain for channel in channels]
    volumes = [channel.quantity == VOLUME for channel in channels]
    last = after or before
    return {
        "elpd": elpd,
        "elpd_se": error,
        "elpd_before": float(before.elpd.sum()),
        "rmse_before": before.rmse(strains),
        "rmse_after": last.rmse(strains),
        "rmse_volume_ml_before": before.rmse(volumes),
        "rmse_volume_ml_after": last.rmse(volumes),
        "coverage_before": before.coverage,
        "coverage_after": last.coverage,
    }
