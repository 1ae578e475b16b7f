"""Several hearts in one posterior: against the same in one dense covariance, against each heart by
itself, and with known stiffness."""

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.separate import separating_measurement
from regional_lv.emulators.base import Prediction, row_jacobian
from regional_lv.errors import InputError
from regional_lv.inference.averaging import average
from regional_lv.inference.emulated import EmulatedInputs
from regional_lv.inference.evidence import fit
from regional_lv.inference.hearts import JointInputs, potential_of_tables, read_known_theta
from regional_lv.inference.potential import Potential
from regional_lv.inference.sources import sources_of_variance
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.scales import Logarithmic
from regional_lv.inputs.space import Inputs, Role
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.measured.tables import VOLUME_SHARE
from tests.inference.toys import Toy

NAMES = ["volume_ml", *(f"circumferential_{s:02d}" for s in range(1, 7)), "radial_01", "radial_02"]
ERROR = 0.02


class Factor(Stiffness):
    def __init__(self, zone, factor, low=0.1, high=5.0):
        self.name, self.zone, self.factor = f"{factor}_{zone}", zone, factor
        self.low, self.high = low, high


def inputs_of(measured=True, suspected=2, tails=False) -> Inputs:
    """Two factors in two zones, a measured input, and causes."""
    members = [Factor(zone, factor) for zone in ("septal", "apical") for factor in ("C_a", "C_b")]
    roles = {}
    if measured:
        members.insert(1, Toy("thickness", 4.0, 16.0, 8.0, Logarithmic()))
        roles["thickness"] = Role("measured", 1.0)
    for i in range(suspected):
        members.append(Toy(f"c{i}", -1.0, 1.0, 0.0))
        roles[f"c{i}"] = Role("suspected")
    if tails:
        members.append(HeavyTails({}))
        roles["heavy_tails"] = Role("suspected")
    return Inputs({}, members, roles)


class OfChannels:
    """An emulator of all inputs that bend its outputs a little, with errors in common."""

    jacobian_factor = 1.0

    def __init__(self, inputs: Inputs, kept=None):
        self.inputs, self.kept = inputs, [*range(len(NAMES))] if kept is None else kept
        rng = np.random.default_rng(7)
        count = len(inputs)
        self._a = torch.as_tensor(0.3 * rng.normal(size=(20, len(NAMES))))[:count][:, self.kept]
        self._b = torch.as_tensor(0.1 * rng.normal(size=(20, len(NAMES))))[:count][:, self.kept]
        self.outputs = tuple(NAMES[k] for k in self.kept)
        self.channels = Channels.parse(self.outputs)
        self.output_sd = torch.full((len(self.kept),), 0.3).double()

    def select(self, outputs):
        return OfChannels(self.inputs, [NAMES.index(name) for name in outputs])

    def predict_mean(self, theta):
        z = self.inputs.simulated.coordinates.scaled(theta)
        return 2 + z @ self._a[: z.shape[1]] + (z @ self._b[: z.shape[1]]).square()

    def linearise(self, theta):
        return self.predict_mean(theta), row_jacobian(self.predict_mean, theta)

    def predict(self, theta):
        d = len(self.kept)
        size = ERROR**2 * (1 + theta[:, :1, None])
        covariance = size * (torch.eye(d) + 0.5).double()
        return Prediction(self.predict_mean(theta), covariance)


def tables_of(inputs, values, sd=0.05, seed=0, missing=()) -> dict[str, pd.DataFrame]:
    """What is measured of hearts of these values (S, K); the s-th without the channels
    `missing[s]`."""
    mean = OfChannels(inputs).predict_mean(torch.as_tensor(np.asarray(values))).numpy()
    rng = np.random.default_rng(seed)
    found = {}
    for s, row in enumerate(mean + 0.05 * rng.normal(size=mean.shape)):
        table = pd.DataFrame({"output": NAMES, "value": row, "sd": sd})
        table.loc[0, "sd"] = np.nan if np.isnan(sd) else table.loc[0, "sd"]
        gone = missing[s] if s < len(missing) else []
        found[f"s{s}"] = table[~table["output"].isin(gone)][::-1]  # in any order
    return found


def values_of(inputs: Inputs, hearts: int, seed=1, **causes) -> np.ndarray:
    """(S, K): stiffness at random, causes as given, others nominal."""
    rng = np.random.default_rng(seed)
    found = np.tile(inputs.nominal, (hearts, 1))
    stiff = [isinstance(each, Stiffness) for each in inputs]
    found[:, stiff] = np.exp(rng.uniform(-0.5, 0.5, size=(hearts, sum(stiff))))
    for name, value in causes.items():
        found[:, inputs.names.index(name)] = value
    return found


MISSING = (["radial_01"], [], ["circumferential_02", "circumferential_03", "radial_02"])


class Dense:
    """The same outputs with all hearts in one covariance matrix."""

    def __init__(self, hearts, observed):
        self.mean, self.linearise = hearts.mean, hearts.linearise
        self._hearts, self._observed = hearts, observed

    def predict(self, x):
        mean, covariance = self._hearts.predict(x)
        return mean, self._observed.dense(covariance)


def both(inputs, sd=0.05, hearts=3, causes=(("c1", 0.5),), known=None):
    """A potential in blocks, and the same as if it were of one heart."""
    values = values_of(inputs, hearts, **dict(causes))
    tables = tables_of(inputs, values, sd, missing=MISSING)
    blocks = potential_of_tables(OfChannels(inputs), inputs, tables, 1.0, known)
    emulated = Dense(blocks.emulated, blocks.observed)
    departure = blocks.observed.dense(blocks.departure[None])[0]
    return blocks, Potential(emulated, blocks.inputs, blocks.y, blocks.noise, departure)


@pytest.mark.parametrize("tails", [False, True])
@pytest.mark.parametrize("sd", [0.05, np.nan])
def test_blocks_are_the_dense_covariance(sd, tails):
    blocks, dense = both(inputs_of(tails=tails), sd)
    rng = np.random.default_rng(2)
    x = blocks.low + torch.as_tensor(rng.uniform(0.3, 0.7, (4, len(blocks.low)))) * blocks.width
    amplitude = torch.tensor([0.0, 1.0, 2.0, 4.0]).double()
    count = len(blocks.inputs)
    for rows in (slice(None), slice(1)):  # one covariance for each row, or for all
        errors = [p.settle(x[rows], amplitude[rows]) for p in (blocks, dense)]
        found, expected = (
            p.quadratic(*p.linearise(x), x, error)
            for p, error in zip((blocks, dense), errors, strict=True)
        )
        torch.testing.assert_close(found.value, expected.value)
        torch.testing.assert_close(found.gradient, expected.gradient)
        torch.testing.assert_close(found.curvature, expected.curvature)
    at = x.clone().requires_grad_()
    value = blocks.log_density(blocks.emulated.mean(at[:, :count]), at, errors[0])
    torch.testing.assert_close(torch.autograd.grad(value.sum(), at)[0], found.gradient)


@pytest.mark.parametrize(("sd", "tails"), [(0.05, True), (np.nan, False)])
def test_average_is_that_of_the_dense_covariance(sd, tails):
    inputs = inputs_of(measured=tails, suspected=1, tails=tails)
    potentials = both(inputs, sd, hearts=2, causes=(("c0", 0.5),))
    # A seed with which one proposal does: the clusters of a mixture carry round-off further.
    found, expected = (average(p, 1, 1, draws=400) for p in potentials)
    pd.testing.assert_frame_equal(found.table(), expected.table(), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.probability, expected.probability, atol=1e-6)
    shares = [sources_of_variance(each) for each in (found, expected)]
    pd.testing.assert_frame_equal(*shares, rtol=1e-5, atol=1e-7)


def test_what_is_observed():
    blocks, _ = both(inputs_of())
    observed = blocks.observed
    assert len(observed.names) == len(observed.channels) == len(blocks.y) == 27 - 4
    assert observed.hearts == ("s0", "s1", "s2") and np.bincount(observed.heart).tolist() == [
        8,
        9,
        6,
    ]
    assert observed.names[0] == "s0: volume_ml" and "s0: radial_01" not in observed.names
    for name, channel, heart in zip(observed.names, observed.channels, observed.heart, strict=True):
        assert name == f"{observed.hearts[heart]}: {channel.name}"
    torch.testing.assert_close(observed.join(observed.split(blocks.y)), blocks.y)
    names = blocks.inputs.names
    assert names[:2] == ("s0: C_a_septal", "s0: thickness") and names[-2:] == ("c0", "c1")
    assert len(names) == 3 * 5 + 2


def fitted(potential):
    free, zero = potential.free()[None], torch.zeros(1).double()
    x = potential.nominal[None]
    return fit(potential, free, zero, x, potential.settle(x, zero), 100, 1e-10)


def test_hearts_without_causes_are_independent():
    inputs = inputs_of(suspected=0)
    tables = tables_of(inputs, values_of(inputs, 3), missing=MISSING)
    together = fitted(potential_of_tables(OfChannels(inputs), inputs, tables, 1.0))
    apart = [
        fitted(potential_of_tables(OfChannels(inputs), inputs, {name: table}, 1.0))
        for name, table in tables.items()
    ]
    total = sum(float(each.log_evidence) for each in apart)
    assert float(together.log_evidence) == pytest.approx(total, abs=1e-3)
    means = torch.cat([each.mean for each in apart], 1)
    torch.testing.assert_close(together.mean, means, atol=1e-3, rtol=0)


def test_hearts_tell_more_of_a_cause_that_they_share():
    inputs = inputs_of(measured=False)
    tables = tables_of(inputs, values_of(inputs, 6, c1=0.25))
    one, several = (
        average(potential_of_tables(OfChannels(inputs), inputs, some, 1.0), 1, 0, draws=400)
        for some in ({"s0": tables["s0"]}, tables)
    )
    rows = [found.table().loc["c1"] for found in (one, several)]
    assert rows[0]["probability"] < 0.9 and rows[1]["probability"] > 0.95
    assert rows[1]["free_sd"] < 0.7 * rows[0]["free_sd"]
    assert rows[1]["free_lower95"] < 0.25 < rows[1]["free_upper95"]


def test_noise_of_hearts():
    """One scale for a quantity, where a heart has no sd; a volume is known to half a percent."""
    inputs = inputs_of()
    values = values_of(inputs, 2)
    tables = {
        "a": tables_of(inputs, values)["s0"],
        "b": tables_of(inputs, values, sd=np.nan, missing=([], ["radial_01", "radial_02"]))["s1"],
    }
    potential = potential_of_tables(OfChannels(inputs), inputs, tables, 0.7)
    noise, heart = potential.noise, potential.observed.heart
    assert [*noise.groups] == ["circumferential"] and noise.prior_scale == 0.7
    np.testing.assert_allclose(noise.units[0], [0.0] * 9 + [0.0] + [0.3] * 6)
    volume = np.array([c.quantity == "volume" for c in potential.observed.channels])
    expected = VOLUME_SHARE * abs(float(potential.y[volume & (heart == 1)]))
    np.testing.assert_allclose(noise.sd[volume], [0.05, expected])


# --------------------------------------------------------------------------- known stiffness


def known_of(inputs, values, factors=None) -> pd.DataFrame:
    """The stiffness in units of a reference material whose `factors` are other ones."""
    known = pd.DataFrame(values, columns=inputs.names, index=[f"s{s}" for s in range(len(values))])
    known = known[[name for name in inputs.names if name.startswith("C_")]]
    for factor, number in (factors or {}).items():
        columns = [name for name in known if name.startswith(factor)]
        known[columns] = known[columns] / number
    return known


@pytest.mark.parametrize("hearts", [1, 4])
def test_common_factors_of_known_stiffness(hearts):
    inputs = inputs_of()
    values = values_of(inputs, hearts, c0=0.5)
    tables = tables_of(inputs, values)
    factors = {"C_a": 1.3, "C_b": 0.8}
    known = known_of(inputs, values, factors)[::-1]
    potential = potential_of_tables(OfChannels(inputs), inputs, tables, 1.0, known)
    own = ["thickness"] if hearts == 1 else [f"s{s}: thickness" for s in range(hearts)]
    assert potential.inputs.names == ("log_factor_C_a", "log_factor_C_b", *own, "c0", "c1")
    truth = potential.nominal.clone()
    truth[:2] = torch.log(torch.tensor([1.3, 0.8]))
    truth[-2] = 0.5
    natural = inputs.coordinates.natural(potential.emulated.joint.of_each(truth[None])[0])
    np.testing.assert_allclose(natural, values)
    table = average(potential, 2, 0, draws=600).table()
    if hearts > 1:
        assert table.loc["c0", "probability"] > 0.95
        off = (table["mean"][:2] - truth[:2].numpy()) / table["sd"][:2]
        assert (off.abs() < 3).all() and (table["sd"][:2] < 0.2).all()


def test_range_of_a_common_factor():
    inputs = inputs_of()
    values = np.ones((2, len(inputs)))
    values[1, inputs.names.index("C_a_apical")] = 4.0
    joint = JointInputs.of(inputs, ["s0", "s1"], known_of(inputs, values))
    np.testing.assert_allclose(joint.inputs.upper[:2], np.log([5 / 4, 3.0]))
    np.testing.assert_allclose(joint.inputs.lower[:2], -np.log([3.0, 3.0]))
    values[1, inputs.names.index("C_b_apical")] = 0.105
    with pytest.raises(InputError, match=r"s1: C_b_apical = 0.105.* 0.1, .*leave this heart out"):
        JointInputs.of(inputs, ["s0", "s1"], known_of(inputs, values))


def test_known_stiffness_of_some_subjects(tmp_path):
    inputs = inputs_of()
    known = known_of(inputs, values_of(inputs, 3))
    paths = [tmp_path / f"{name}.csv" for name in known.index]
    for name, path in zip(known.index, paths, strict=True):
        known.loc[[name]].to_csv(path, index_label="subject")
    found = read_known_theta(paths, ["s2", "s0"], [*known])
    pd.testing.assert_frame_equal(found, known.loc[["s2", "s0"]], check_names=False)
    with pytest.raises(InputError, match="no row for s4; add"):
        read_known_theta(paths, ["s0", "s4"], [*known])
    with pytest.raises(InputError, match=r"s0\.csv: no column C_c; add"):
        read_known_theta(paths, ["s0"], ["C_c"])
    known.assign(C_a_septal=["1", "x", "2"]).to_csv(paths[0], index_label="subject")
    with pytest.raises(InputError, match=r"row s1: C_a_septal is x, no finite number"):
        read_known_theta(paths[:1], ["s0", "s1"], [*known])


@pytest.mark.parametrize("hearts", [1, 2])
def test_what_would_tell_rivals_apart_is_said_by_heart(hearts):
    """As the emulator predicts them at each rival's fit, heart by heart; c0 and c1 are rivals."""
    inputs = inputs_of(measured=False)
    tables = tables_of(inputs, values_of(inputs, hearts, c1=0.5))
    emulator = OfChannels(inputs)
    potential = potential_of_tables(emulator, inputs, tables, 1.0)
    averaged = average(potential, 1, 0, draws=200)
    names = averaged.names
    rivals = [names.index("c0"), names.index("c1")]
    emulated = EmulatedInputs(emulator, inputs)
    (pair,) = separating_measurement(averaged, rivals, emulated, [*tables], [0.5])
    assert pair["pair"] == [["c0"], ["c1"]] and len(pair["channels"]) == 3
    gaps = np.abs([found["difference_in_noise_sd"] for found in pair["channels"]])
    assert (np.diff(gaps) <= 0).all()
    largest = pair["channels"][0]
    assert largest["subject"] in tables
    if largest["load_fraction"] == 1:
        x = [averaged.models[n].fit.x[:, : len(potential.inputs)] for n in rivals]
        s = [*tables].index(largest["subject"])
        mean = [emulated.mean(potential.emulated.of_each(each)[:, s])[0] for each in x]
        gap = (mean[0] - mean[1])[NAMES.index(largest["output"])] / largest["noise"]
        assert float(gap) == pytest.approx(largest["difference_in_noise_sd"])
