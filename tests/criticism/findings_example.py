"""Findings of a heart with a septal load and a scar that its model does not have, and the averaged
posterior that goes with them: no critic ran, but all of it hangs together."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from regional_lv.channels import Channels
from regional_lv.criticism import words
from regional_lv.criticism.contract import (
    Cause,
    Channel,
    Findings,
    Gain,
    Histogram,
    MeasuredInput,
    Misfit,
    Set,
    Stiffness,
    Summary,
)
from regional_lv.inference.posteriors import write
from regional_lv.inputs.stiffness import StiffnessInputs

BASE, LOAD, SCAR = 0.004, ["septal_load"], ["septal_load", "focal_scar"]
UNLISTED = 0.01
DRAWS = 400


def example(
    parameters: StiffnessInputs | None = None,
    outputs: Sequence[str] = Channels.of().names,
    **changes,
) -> Findings:
    """The findings; `changes` replace what they hold. The first set with the causes of `best` is
    the best one, and the words are those of `words.verdict`."""
    parameters = parameters or StiffnessInputs()
    found: Findings = {
        "subject": "heart",
        "subjects": ["heart"],
        "misfit": misfit(outputs, 3.0),
        "data_checks": [
            {
                **{"subject": "heart", "name": "volume_preserving", "passed": True},
                "says": "the strains allow a wall that keeps its volume",
            }
        ],
        "hypotheses": [
            cause("septal_load", 0.996, estimate=2.1, unit="mmHg", high=6.0),
            cause("focal_scar", 0.966, "7", estimate=1.8, base=1.0, high=4.0),
            cause("fibre_rotation", 0.06, estimate=3.0, unit="deg", low=-20.0, high=20.0),
            cause("radial_scale", 0.02, base=1.0, low=0.7, high=1.3, identifiable=False),
        ],
        "sets": [
            one_set(SCAR, ["", "7"], 0.90, confirmed=True),
            one_set([*SCAR, "fibre_rotation"], ["", "7", ""], 0.06),
            one_set(LOAD, [""], 0.026),
        ],
        "base_probability": BASE,
        "unlisted_probability": UNLISTED,
        "named": SCAR,
        "groups": [],
        "acts_like": [],
        "explained": True,
        "trusted": True,
        "outliers": "",
        "confirmation": {
            "simulations": 12,
            "simulations_of_best": 8,
            "failed": 0,
            "emulator_error_sd": [2.4, 1.1],
            "largest_error_sd": 2.2,
            "agrees": True,
            "probability_not_simulated": 0.03,
            "channels": [
                {"output": name, "error": 0.001 * (1 + k % 3), "error_sd": 0.2 + 0.2 * (k % 11)}
                for k, name in enumerate(outputs)
            ],
        },
        "separating": [],
        "best": SCAR,
        "gain": gain(),
        "stiffness": [stiffness(k, name) for k, name in enumerate(parameters.names)],
        "measured_inputs": [
            known(f"wall_thickness_{segment}", "mm", 9.0, 1.0, 0.1 * (segment % 9))
            for segment in range(1, 18)
        ]
        + [known("end_diastolic_pressure", "mmHg", 8.0, 2.0, 0.4)],
        "noise": [],
        "remaining": misfit(outputs, 0.8),
        "level": 0.05,
        "least_probability": 0.95,
        "critical_z": 2.9,
        "least_p_value": 1 / 300,
        "ess": 1240.0,
        "limits": ["heart: no torsion was measured: nothing is concluded about it"],
        "words": [],
    }
    found |= changes  # type: ignore[typeddict-item]
    fits = [set(each["causes"]) == set(found["best"] or ["nothing"]) for each in found["sets"]]
    for n, each in enumerate(found["sets"]):
        each["best"] = fits[n] and not any(fits[:n])
    found["words"] = words.verdict(found)
    return found


def misfit(outputs: Sequence[str], size: float) -> Misfit:
    """Residuals of `size` sds on the septum, of noise elsewhere; found from 2 on."""
    rng, channels = np.random.default_rng(4), list[Channel]()
    for c in Channels.parse(outputs):
        septal = c.quantity == "radial" and c.segment in (2, 3, 8, 9)
        z = float(size if septal else 0.7 * rng.standard_normal())
        predicted, sd = (150.0, 1.5) if c.quantity == "volume" else (0.1, 0.012)
        channels.append(
            Channel(
                subject="heart",
                output=c.name,
                quantity=c.quantity,
                segment=c.segment,
                load_fraction=c.load_fraction,
                observed=predicted + z * sd,
                predicted=predicted,
                sd=sd,
                z=z,
            )
        )
    detected = size > 2
    p = 0.003 if detected else 0.4
    return {
        "detected": detected,
        "p_value": p,
        "families": {"overall": p, "channel": 2 * p, "wall": p, "cause": p},
        "largest": [{"family": "wall", "what": "septal radial", "z": size, "p_value": p}],
        "channels": channels,
    }


def cause(
    name: str,
    probability: float,
    component: str = "",
    estimate: float | None = None,
    base: float = 0.0,
    low: float = 0.0,
    high: float = 1.0,
    unit: str = "1",
    identifiable: bool = True,
) -> Cause:
    """Known to a tenth of its range if it is estimated."""
    middle, sd = (base if estimate is None else estimate), (high - low) / 10
    edges = np.linspace(max(middle - 3 * sd, low), min(middle + 3 * sd, high), 31)
    density = np.exp(-0.5 * ((edges[1:] + edges[:-1]) / 2 - middle) ** 2 / sd**2)
    density /= (density * np.diff(edges)).sum()
    histogram = Histogram(edges=edges.tolist(), density=density.tolist())
    return Cause(
        name=name,
        component=component,
        parameter="size of the effect",
        description="What it does.",
        source="Somebody 2012",
        base=base,
        range=[low, high],
        z=8 * probability,
        p_value=1 - 0.99 * probability,
        p_value_single=(1 - 0.99 * probability) / 4,
        probability=probability,
        component_probability=0.9 if component else 1.0,
        estimate=estimate,
        interval95=[max(middle - 1.96 * sd, low), min(middle + 1.96 * sd, high)],
        at_bound=False,
        unit=unit,
        identifiable=identifiable,
        why="the stiffness takes up all of its effect" if not identifiable else "clear",
        absorbed=0.3 if identifiable else 1.0,
        sd=sd,
        posterior=None if estimate is None else histogram,
    )


def one_set(
    causes: list[str], components: list[str], probability: float, confirmed: bool = False
) -> Set:
    return Set(
        causes=causes,
        components=components,
        best=False,
        fit=[1.0] * len(causes),
        probability=probability,
        log_evidence=float(np.log(probability / BASE)) + len(causes),
        log_prior=-float(len(causes)),
        elpd_gain=22.0 if confirmed else None,
        elpd_gain_se=6.0 if confirmed else None,
        misfit_p_value=0.4 if confirmed else None,
        confirmed=confirmed,
        simulations=8 if confirmed else 0,
        emulator_error_sd=1.1 if confirmed else None,
    )


def gain() -> Gain:
    return Gain(
        elpd=22.0,
        elpd_se=6.0,
        elpd_before=110.0,
        rmse_before=0.031,
        rmse_after=0.012,
        rmse_volume_ml_before=2.2,
        rmse_volume_ml_after=1.1,
        coverage_before=0.8,
        coverage_after=0.96,
    )


def known(name: str, unit: str, mean: float, sd: float, moved: float) -> MeasuredInput:
    return MeasuredInput(
        name=name, unit=unit, prior_mean=mean, prior_sd=sd, averaged=summary(mean + moved, 0.8 * sd)
    )


def summary(mean: float, sd: float) -> Summary:
    return {"mean": mean, "sd": sd, "interval95": [mean - 1.96 * sd, mean + 1.96 * sd]}


def stiffness(k: int, name: str) -> Stiffness:
    """The tenth factor moves by 7 sds of the model as it is, others by less than one."""
    mean, sd = 0.8 + 0.1 * (k % 9), 0.08
    shift = 7.0 if name == "C_b_septal" else 0.5
    sources = {
        **{"noise": 0.4, "emulator": 0.05},
        **{f"wall_thickness_{segment}": 0.01 for segment in range(1, 18)},
        **{"end_diastolic_pressure": 0.13, "ranges": 0.05},
    }
    return Stiffness(
        name=name,
        unit="1",
        averaged=summary(mean, sd),
        as_it_is=summary(mean - shift * sd / 2, sd / 2),
        sources=sources | {"models": 1 - sum(sources.values())},
        shift_sd=shift,
    )


def write_posterior(
    findings: Findings,
    y: Mapping[str, float],
    sd: Mapping[str, float],
    path: str | Path,
    draws: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Draws of what `findings` state of the stiffness and the noise, with observations y, predicted
    with `sd`; of some inputs others, `draws` (DRAWS,)."""
    rng = np.random.default_rng(1)
    names = [row["name"] for row in findings["stiffness"]]

    def group(
        stated: Sequence[Summary], scales: Sequence[float], other: Mapping[str, np.ndarray]
    ) -> xr.Dataset:
        mean, width = (np.array([s[key] for s in stated]) for key in ("mean", "sd"))
        spread = np.sqrt(np.log1p((width / mean) ** 2))  # factors are above zero: log-normal
        normal = rng.standard_normal((DRAWS, len(names)))
        value = mean * np.exp(spread * normal - spread**2 / 2)
        for name, of_it in other.items():
            value[:, names.index(name)] = of_it
        each = ("chain", "draw")
        columns = {"value": ((*each, "input"), value[None])}
        coordinates = {"input": names}
        if scales:
            sigma = scales * np.exp(0.1 * rng.standard_normal((1, DRAWS, len(scales))))
            columns["sigma"] = ((*each, "quantity"), sigma)
            coordinates["quantity"] = [row["quantity"] for row in findings["noise"]]
        return xr.Dataset(columns, coordinates)

    observed = np.array(list(y.values()))
    noise = np.array([sd[name] for name in y]) * rng.standard_normal((1, DRAWS, len(y)))
    output = {"output": list(y)}
    averaged, base = (
        [row[which] for row in findings["stiffness"]]  # type: ignore[literal-required]
        for which in ("averaged", "as_it_is")
    )
    after, before = ([row[when] for row in findings["noise"]] for when in ("after", "before"))
    write(
        xr.DataTree.from_dict(
            {
                "posterior": group(averaged, after, draws or {}),
                "posterior_predictive": xr.Dataset(
                    {"y": (("chain", "draw", "output"), observed + noise)}, output
                ),
                "observed_data": xr.Dataset({"y": ("output", observed)}, output),
                "as_it_is": group(base, before, {}),
            }
        ),
        path,
    )
