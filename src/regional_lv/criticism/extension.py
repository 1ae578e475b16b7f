"""What an extended model does differently from the base model, at any theta and psi."""

import copy
import json
import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.differences import Scale
from regional_lv.criticism.hypotheses.base import (
    REGISTRY,
    Hypothesis,
    ReportHypothesis,
    SimulatorHypothesis,
)
from regional_lv.criticism.polynomial import lagrange
from regional_lv.emulators.base import Emulator, Prediction
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.errors import InputError
from regional_lv.gaussian import Z95
from regional_lv.inference.departure import noise_units
from regional_lv.parameters import Parameterisation
from regional_lv.progress import Progress
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

EMULATOR = {"hyperparameter_rows": 24, "iterations": 40}
"""Settings of the gradient-enhanced emulator of the differences."""

LEAST_SPREAD = 1e-9
"""Outputs whose change (on the scale of `differences`) spreads less than this do not change."""

HELD_OUT = 5
"""One anchor in so many is left out, once, to see how well the differences are known."""


class Extension:
    """What the effect of one hypothesis and component adds to the outputs without it.

    A closed form, nothing (noise, and another load, which `ExtendedEmulator` knows), or, of
    simulated hypotheses, the polynomial in psi through zero at the base and emulated changes
    (`differences`) at the nodes.

    Attributes: hypothesis, with base and range as in the study; component; outputs (names of the
    D outputs); fraction_simulated, the share of the asked simulations that converged. exponent: of
    the study's strain measure. emulator: None for closed forms, noise, and simulated effects that
    change none of the outputs.
    """

    def __init__(
        self,
        hypothesis: Hypothesis,
        outputs: Sequence[str],
        exponent: float,
        component: str = "",
        fraction_simulated: float = 1.0,
        emulator: Emulator | None = None,
    ):
        self.hypothesis, self.component = hypothesis, component
        self.fraction_simulated = fraction_simulated
        self.outputs = tuple(outputs)
        self._scale = Scale(Channels.parse(self.outputs), exponent)
        self._emulator = emulator
        if emulator is not None:
            self._changing = _changing(emulator, len(hypothesis.nodes))

    def difference(
        self, outputs: torch.Tensor, theta: torch.Tensor, psi: torch.Tensor
    ) -> Prediction:
        """What the effect adds to `outputs` (..., D), those at `theta` (..., P) with all that acts
        before it, at `psi` (...); natural units.

        Mean (..., D) and covariance (..., D, D) of its own error, zero for closed forms; exactly
        zero at psi = base.
        """
        psi = psi.expand(theta.shape[:-1])
        if self._emulator is None:
            found = self.mean(outputs, theta, psi)
            return Prediction(found, torch.zeros(*found.shape, found.shape[-1], dtype=found.dtype))
        change, covariance = self._change(self._emulator.predict(theta), psi)
        difference, slope = self._differences(outputs, change, psi)
        return Prediction(difference, slope[..., :, None] * covariance * slope[..., None, :])

    def mean(self, outputs: torch.Tensor, theta: torch.Tensor, psi: torch.Tensor) -> torch.Tensor:
        """The mean (..., D) of `difference` alone: for thousands of points, the covariance is what
        costs. Without a graph, but for closed forms."""
        psi = psi.expand(theta.shape[:-1])
        if isinstance(self.hypothesis, ReportHypothesis):
            return self.hypothesis.reported(outputs, self.outputs, psi) - outputs
        if self._emulator is None:
            return torch.zeros_like(outputs)
        with torch.no_grad():
            weights, count = self._weights(psi), len(self.hypothesis.nodes)
            by_node = self._emulator.predict_mean(theta).reshape(*psi.shape, count, -1)
            change = torch.zeros_like(outputs)
            at = [self.outputs.index(name) for name in self._changing]
            change[..., at] = (weights[..., None] * by_node).sum(-2)
            return self._differences(outputs, change, psi)[0]

    def select(self, outputs: Sequence[str]) -> "Extension":
        """The extension of some of the outputs, in the order given."""
        chosen = copy.copy(self)
        chosen.outputs = tuple(outputs)
        chosen._scale = Scale(Channels.parse(chosen.outputs), self._scale.exponent)
        if self._emulator is not None:
            kept = [name for name in outputs if name in self._changing]
            nodes = _node_names(kept, len(self.hypothesis.nodes))
            chosen._emulator = self._emulator.select(nodes) if kept else None
            chosen._changing = kept
        return chosen

    def _differences(self, mean, change, psi) -> tuple[torch.Tensor, torch.Tensor]:
        """Differences (..., D) from outputs `mean`, and their derivatives about the change."""
        exponent = self.hypothesis.strain_exponent(psi, self._scale.exponent)
        return self._scale.differences(mean, change, exponent)

    def _weights(self, psi) -> torch.Tensor:
        """Weights (..., J) of the nodes at psi (...)."""
        h = self.hypothesis
        known = [h.scale(value) for value in (h.base, *h.nodes)]
        return torch.stack(lagrange(known, h.scale(psi))[1:], dim=-1)

    def _change(self, at_nodes: Prediction, psi) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (..., D) and covariance (..., D, D) at psi (...)."""
        weights = self._weights(psi)
        count, changing = len(self.hypothesis.nodes), len(self._changing)
        by_node = at_nodes.mean.reshape(*psi.shape, count, changing)
        mean = (weights[..., None] * by_node).sum(-2)
        # The errors at the nodes are correlated as the emulator has found them to be.
        between = at_nodes.output_covariance.reshape(count, changing, count, changing)
        between = between.permute(0, 2, 1, 3).reshape(count * count, changing * changing)
        pairs = (weights[..., :, None] * weights[..., None, :]).reshape(*psi.shape, count * count)
        covariance = (pairs @ between).reshape(*psi.shape, changing, changing)
        covariance = at_nodes.variance[..., None, None] * covariance
        place = torch.zeros(changing, len(self.outputs), dtype=mean.dtype)
        place[range(changing), [self.outputs.index(name) for name in self._changing]] = 1.0
        return mean @ place, place.T @ covariance @ place

    def state(self) -> dict:
        """Everything that `from_state` needs, in tensors and plain values."""
        h = self.hypothesis
        return {
            "hypothesis": h.name,
            "range": (h.base, h.low, h.high),
            "nodes": list(h.nodes) if isinstance(h, SimulatorHypothesis) else [],
            "outputs": list(self.outputs),
            "exponent": self._scale.exponent,
            "component": self.component,
            "fraction_simulated": self.fraction_simulated,
            "emulator": None if self._emulator is None else self._emulator.content(),
        }

    @classmethod
    def from_state(cls, path, state: dict, hypothesis: Hypothesis) -> "Extension":
        """The extension whose `state` this is; `path` is named in errors."""
        hypothesis = copy.copy(hypothesis)
        hypothesis.base, hypothesis.low, hypothesis.high = state["range"]
        if isinstance(hypothesis, SimulatorHypothesis):
            hypothesis.nodes = tuple(state["nodes"])
        emulator = state["emulator"]
        return cls(
            hypothesis,
            state["outputs"],
            state["exponent"],
            state["component"],
            state["fraction_simulated"],
            None if emulator is None else GradientGP.from_content(emulator, path),
        )


def read_extensions(paths: Sequence[str | Path]) -> list[Extension]:
    """All components of the hypotheses in the given files, in their order."""
    return [
        Extension.from_state(path, state, REGISTRY[state["hypothesis"]])
        for path in paths
        for state in torch.load(path, weights_only=True)
    ]


# ------------------------------------------------------------------------------------ training


def train_extension(
    hypothesis: str,
    physics: Mapping,
    parameters: Parameterisation,
    channels: Channels,
    seed: int,
    extension: str | Path,
    report: str | Path,
    batches: Sequence[str | Path] = (),
) -> None:
    """Learn the differences of one hypothesis from its simulations; write them and a report (JSON).

    hypothesis: its name. batches: files of `simulate_extension`; none for closed forms and noise.
    seed: the study's. A component of which too few simulations converged is left out of the search,
    and the report says so (`left_out`).
    The report says per component how many of the simulations converged, what they cost and, with
    one anchor in `HELD_OUT` left out, how well the differences there are known: `size` and `error`
    at the nodes in `noise_units` (root mean squares over anchors and outputs), their ratio, that at
    the median anchor, the coverage of 95 % intervals, and the relative error of the slope at the
    base against the tangent's.
    """
    asked = REGISTRY[hypothesis].for_study(physics)
    exponent = float(physics["observables"]["strain_exponent"])
    found: list[dict] = []
    if not isinstance(asked, SimulatorHypothesis):
        extensions = [Extension(asked, channels.names, exponent)]
    else:
        table = pd.concat([pd.read_parquet(batch) for batch in batches], ignore_index=True)
        extensions = []
        progress = Progress(hypothesis, len(asked.components))
        scale = Scale(channels, exponent)
        for component, rows in table.groupby("component", sort=False):
            own = derive(seed, "extension", hypothesis, component)
            try:
                learnt, errors = learn(asked, component, rows, scale, parameters, own)
                extensions.append(learnt)
            except InputError as error:
                # One cause that cannot be simulated does not stop the search for the others.
                log.warning("%s", error)
                errors = {"left_out": str(error)}
            found.append({"component": component} | errors)
            progress.step()
    torch.save([each.state() for each in extensions], extension)
    content = {"hypothesis": hypothesis, "components": found}
    Path(report).write_text(json.dumps(content, indent=2) + "\n")


def learn(
    hypothesis, component, rows: pd.DataFrame, scale: Scale, parameters, seed
) -> tuple[Extension, dict]:
    """Extension of one component, and what its report says.

    rows: of `simulate_extension`, of all anchors at the base and at every node.
    """
    started = time.monotonic()
    nodes = list(hypothesis.nodes)
    converged = rows["status"] == "converged"
    fraction = float(converged[rows["psi"] != hypothesis.base].mean())
    good = rows[converged].groupby("anchor").filter(lambda anchor: len(anchor) == len(nodes) + 1)
    anchors = good["anchor"].nunique()
    if anchors < HELD_OUT:
        raise InputError(
            f"criticism.hypotheses: {hypothesis.name} converged at all values of psi for "
            f"{anchors} of {rows['anchor'].nunique()} anchors only, too few to learn from; leave "
            "it out, or narrow the design (design.lower, design.upper)"
        )
    data = _Simulated(hypothesis, good, scale, parameters)
    held = np.arange(anchors) % HELD_OUT == HELD_OUT - 1
    partial = _fit(hypothesis, component, fraction, data, ~held, seed)
    report = {
        "anchors": anchors,
        "fraction_simulated": fraction,
        "simulation_cpu_s": float(rows["cpu_s"].sum()),
    }
    report |= _errors(partial, data, held)
    extension = _fit(hypothesis, component, fraction, data, held | ~held, seed)
    report["training_s"] = time.monotonic() - started
    return extension, report


class _Simulated:
    """What the anchors say of one component.

    theta (n, P); base (n, D) and at_nodes (n, J, D) outputs; change (n, J, D) on the scale of the
    differences, by_theta (n, J, D, P) its d/dtheta; slope (n, D) the exact d(outputs)/d(psi) at the
    base, or None where there is none. unit: (D,), what errors are counted in.
    """

    def __init__(
        self,
        hypothesis: SimulatorHypothesis,
        good: pd.DataFrame,
        scale: Scale,
        parameters: Parameterisation,
    ):
        self.scale, self.parameters = scale, parameters
        tables = [
            good[good["psi"] == psi].sort_values("anchor")
            for psi in (hypothesis.base, *hypothesis.nodes)
        ]
        outputs = [table[list(scale.channels.names)].to_numpy() for table in tables]
        (first, *others) = [
            scale.logarithms(
                y,
                np.stack(table["sensitivity"]).reshape(*y.shape, -1),
                hypothesis.strain_exponent(psi, scale.exponent),
            )
            for y, table, psi in zip(
                outputs, tables, (hypothesis.base, *hypothesis.nodes), strict=True
            )
        ]
        self.theta = tables[0][list(parameters.names)].to_numpy()
        self.base, self.at_nodes = outputs[0], np.stack(outputs[1:], axis=1)
        self.unit = noise_units(scale.channels, self.base.std(axis=0))
        self.change = np.stack([value - first[0] for value, _ in others], axis=1)
        self.by_theta = np.stack([slope - first[1] for _, slope in others], axis=1)
        self.slope = np.stack(tables[0]["slope"]) if hypothesis.slope_at_base else None


def _fit(hypothesis, component, fraction, data: _Simulated, used, seed) -> Extension:
    """Extension learnt from the anchors `used` (n,)."""
    change, by_theta = data.change[used], data.by_theta[used]
    varies = np.flatnonzero((np.ptp(change, axis=0) > LEAST_SPREAD).all(axis=0))
    outputs = data.scale.channels.names
    known = (hypothesis, outputs, data.scale.exponent, component, fraction)
    if not len(varies):
        return Extension(*known)
    names, nodes = [outputs[i] for i in varies], len(hypothesis.nodes)
    emulator = GradientGP(**EMULATOR).fit(
        data.theta[used],
        change[:, :, varies].reshape(len(change), -1),
        by_theta[:, :, varies].reshape(len(change), -1, len(data.parameters)),
        parameters=data.parameters,
        outputs=_node_names(names, nodes),
        seed=seed,
    )
    return Extension(*known, emulator)


def _errors(extension: Extension, data: _Simulated, held: np.ndarray) -> dict:
    """Errors at the nodes and of the slope at the anchors `held` (n,)."""
    h, theta, unit = extension.hypothesis, torch.as_tensor(data.theta[held]), data.unit
    base, psi = torch.as_tensor(data.base[held]), torch.zeros(int(held.sum()), dtype=theta.dtype)
    errors, sizes, inside = [], [], []
    for j, node in enumerate(h.nodes):
        found = extension.difference(base, theta, psi + node)
        sizes.append((data.at_nodes[held, j] - data.base[held]) / unit)
        errors.append(found.mean.numpy() / unit - sizes[-1])
        sd = found.sd.numpy() / unit
        inside.append((np.abs(errors[-1]) <= Z95 * sd)[sd > 0])
    errors, sizes = np.stack(errors, axis=1), np.stack(sizes, axis=1)
    report = {
        "held_out": int(held.sum()),
        "size": _rms(sizes),
        "error": _rms(errors),
    }
    if not sizes.any():
        return report
    report |= {
        "relative_error": _rms(errors) / _rms(sizes),
        "relative_error_median_anchor": float(
            np.median([_rms(e) / _rms(s) for e, s in zip(errors, sizes, strict=True)])
        ),
        "coverage95": float(np.concatenate(inside).mean()),
    }
    if data.slope is not None:
        at = (psi + h.base).requires_grad_(True)
        mean = extension.difference(base, theta, at).mean
        columns = [
            torch.autograd.grad(mean[:, i].sum(), at, retain_graph=True)[0].numpy()
            for i in range(mean.shape[1])
        ]
        exact = data.slope[held] / unit
        report["relative_error_of_slope"] = _rms(np.stack(columns, 1) / unit - exact) / _rms(exact)
    return report


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _node_names(outputs: Sequence[str], nodes: int) -> list[str]:
    """Names of the emulated numbers: every output at the first node, then at the second, ..."""
    return [f"{output}@{j}" for j in range(nodes) for output in outputs]


def _changing(emulator: Emulator, nodes: int) -> list[str]:
    count = len(emulator.outputs) // nodes
    return [name.rsplit("@", 1)[0] for name in emulator.outputs[:count]]
