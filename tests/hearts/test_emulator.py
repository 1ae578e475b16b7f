"""The emulator of any heart in the coordinates of one, and its file."""

import gzip

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.aha import level_of
from regional_lv.channels import Channels
from regional_lv.emulators.gaussian import Z95
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.errors import InputError
from regional_lv.hearts.by_surfaces import BY_SURFACES, FACTORS, OF_SHAPE, SHARES, BySurfaces
from regional_lv.hearts.card import document
from regional_lv.hearts.emulator import HeartEmulator, InputMap
from regional_lv.hearts.file import read
from regional_lv.hearts.sectors import Mixing
from regional_lv.inputs.space import Inputs, sections_of
from tests.hearts.conftest import outputs_of

ROLES = {
    "segment_thickness": {"role": "measured", "sd_mm": 1.0},
    "length": {"role": "measured", "sd_mm": 2.0},
    "septal_load": "suspected",
    "basal_motion": "suspected",
    "strain_measure": "suspected",
}

CAUSES = {"septal_load", "basal_motion", "helix_endo", "strain_measure"}


@pytest.fixture
def inputs(heart):
    return Inputs.from_config(sections_of(heart(inputs=ROLES))).simulated


@pytest.fixture
def emulator(any_heart, inputs):
    return HeartEmulator(any_heart.emulator, any_heart.known, inputs)


def near(inputs, n, seed=0):
    """Values (n, k) beside the nominal ones."""
    rng = np.random.default_rng(seed)
    low, high = (inputs.coordinates.scaled(ends) for ends in (inputs.lower, inputs.upper))
    middle = inputs.coordinates.scaled(inputs.nominal)
    z = middle + 0.2 * (high - low) * rng.uniform(-1, 1, size=(n, len(inputs)))
    return torch.as_tensor(inputs.coordinates.natural(np.clip(z, low, high)))


def test_stated_errors_hold_other_simulations_with_few_causes_on(made, any_heart):
    test = pd.read_parquet(made / "test.parquet")
    known = any_heart.known
    off = [test[n] == known.nominal[known.names.index(n)] for n in known.names if n in CAUSES]
    few = test[sum(~each for each in off) <= 2]
    assert 5 < len(few) < len(test)
    before, after = JointGP.load(made / "emulator.pt"), any_heart.emulator
    theta, y = few[list(known.names)].to_numpy(float), few[list(after.outputs)].to_numpy(float)
    errors = after.errors_of(theta, y).abs()
    assert (errors < Z95).double().mean() == pytest.approx(0.95, abs=0.005)
    factor = any_heart.card["rescaled"]["factor"]
    x = torch.as_tensor(theta)
    assert after.predict(x).sd == pytest.approx(factor * before.predict(x).sd, rel=1e-4)
    assert after.predict_mean(x) == pytest.approx(before.predict_mean(x), rel=1e-4)


def test_values_go_with_size_and_pressure(any_heart, inputs):
    x = near(inputs, 3)
    there = InputMap(any_heart.known, inputs)(x)
    size, load = x[:, inputs.names.index("length")] / 74.4, 12 / 8
    powers = {
        "C_a_septal": 1 / load,
        "C_b_free": 1.0,
        "wall_thickness_5": 1 / size,
        "septal_load": 1 / load,
        "basal_motion": load / size,
        "strain_measure": 1.0,
    }
    for name, power in powers.items():
        found = there[:, any_heart.known.names.index(name)]
        torch.testing.assert_close(found, x[:, inputs.names.index(name)] * power)
    for name, value in (("endo_radius_9", 1.2 * 17.36), ("apex", 1.2 * 6.8)):
        found = there[:, any_heart.known.names.index(name)]
        torch.testing.assert_close(found, value / size)


def test_derivatives(emulator, inputs):
    x = near(inputs, 4)
    mean, slopes = emulator.linearise(x)
    torch.testing.assert_close(mean, emulator.predict_mean(x))
    torch.testing.assert_close(mean, emulator.predict(x).mean)
    for k in range(len(inputs)):
        step = torch.zeros(len(inputs)).double()
        step[k] = 1e-5 * (inputs.upper[k] - inputs.lower[k])
        ahead, behind = (emulator.predict_mean(x + s * step) for s in (1, -1))
        change = (ahead - behind) / (2 * step[k])
        torch.testing.assert_close(
            slopes[..., k], change, rtol=1e-3, atol=1e-6 * float(slopes[..., k].abs().max())
        )


def test_outputs_and_errors_are_in_the_units_of_the_heart(any_heart, emulator, inputs):
    x = near(inputs, 3)
    there = InputMap(any_heart.known, inputs)(x)
    found, known = emulator.predict(x), any_heart.emulator.predict(there)
    volume = torch.as_tensor(Channels.parse(emulator.outputs).of_quantity("volume"))
    cube = (x[:, inputs.names.index("length")] / 74.4) ** 3
    torch.testing.assert_close(found.mean[:, volume], known.mean[:, volume] * cube[:, None])
    torch.testing.assert_close(found.sd[:, volume], known.sd[:, volume] * cube[:, None])
    torch.testing.assert_close(found.sd[:, ~volume], known.sd[:, ~volume])
    y = found.mean + 2 * found.sd
    torch.testing.assert_close(emulator.errors_of(x, y), torch.full_like(y, 2.0))
    few = emulator.select(emulator.outputs[3:5])
    torch.testing.assert_close(few.predict_mean(x), found.mean[:, 3:5])


@pytest.mark.parametrize("described", [False, True], ids=["table", "surfaces"])
def test_its_own_simulations_make_it_local(any_heart, inputs, described):
    """Of a heart that is simulated as well: values are met, errors beside them get small, and those
    that are stated are about this heart, of which a table leaves nothing open any more."""
    emulator = HeartEmulator(any_heart.emulator, any_heart.known, inputs, described)
    there = InputMap(any_heart.known, inputs)
    truth = outputs_of(any_heart.known, any_heart.emulator.channels)
    volume = torch.as_tensor(any_heart.emulator.channels.of_quantity("volume")).double()

    def simulated(x):
        size = x[:, inputs.names.index("length"), None] / 74.4
        return truth(there(x)) * size ** (3 * volume)

    def derivatives(x):
        sides = []
        for step in 1e-6 * torch.diag(torch.as_tensor(inputs.upper - inputs.lower)):
            change = simulated(x + step) - simulated(x - step)
            sides.append(change / (2 * step.abs().max()))
        return torch.stack(sides, -1)

    x, other = near(inputs, 12, seed=1), near(inputs, 6, seed=2)
    given = emulator.condition(x, simulated(x), derivatives(x))
    before, after, own = (
        ((each.predict_mean(at) - simulated(at)) / emulator.output_sd).square().mean().sqrt()
        for each, at in ((emulator, other), (given, other), (given, x))
    )
    assert own < 0.3 * before
    assert after < 0.6 * before
    assert given.predict(other).sd.mean() < emulator.predict(other).sd.mean()
    assert 0.3 < given.errors_of(other, simulated(other)).square().mean().sqrt() < 1.5
    mean, slopes = given.linearise(other)
    torch.testing.assert_close(mean, given.predict(other).mean)
    assert (slopes - derivatives(other)).square().mean() < (
        (emulator.linearise(other)[1] - derivatives(other)).square().mean()
    )
    few = given.select(given.outputs[3:5])
    torch.testing.assert_close(few.predict(other).mean, mean[:, 3:5])
    more = given.condition(other, simulated(other), derivatives(other))
    assert (more.predict_mean(other) - simulated(other)).abs().mean() < 0.3 * (
        (mean - simulated(other)).abs().mean()
    )


def test_simulations_tell_what_other_sectors_leave_open(any_heart, heart):
    def elsewhere(table):
        table.loc[6, "angle_to_deg"] += 8.0
        table.loc[11, "angle_from_deg"] += 8.0

    inputs = Inputs.from_config(sections_of(heart(elsewhere, inputs=ROLES))).simulated
    emulator = HeartEmulator(any_heart.emulator, any_heart.known, inputs)

    def simulated(x):
        """A hundredth larger, times the first factor of the stiffness."""
        y, slopes = emulator.linearise(x)
        larger = 1 + 0.01 * x[:, :1]
        slopes = slopes * larger[..., None]
        slopes[..., 0] += 0.01 * y
        return y * larger, slopes

    x, other = near(inputs, 12, seed=1), near(inputs, 6, seed=2)
    given = emulator.condition(x, *simulated(x))
    y, before = simulated(other)[0], emulator.predict_mean(other)
    assert ((given.predict_mean(other) - y) / (before - y)).abs().median() < 0.1
    assert (given.predict(other).sd < emulator.predict(other).sd).double().mean() > 0.95


def test_the_file_holds_the_emulator(made, any_heart, file):
    before = JointGP.load(made / "emulator.pt")
    theta = before.learnt_from[:30]
    change = (before.predict_mean(theta) - any_heart.emulator.predict_mean(theta)).abs()
    assert float((change / before.output_sd).max()) < 1e-3
    stated = before.rescaled(any_heart.card["rescaled"]["factor"])
    torch.testing.assert_close(
        stated.predict(theta).sd, any_heart.emulator.predict(theta).sd, rtol=1e-2, atol=0
    )
    assert file.stat().st_size < 0.5 * (made / "emulator.pt").stat().st_size
    page = document(any_heart)
    assert any_heart.checksum in page and "| `apex` |" in page
    for kind in ("infarct", "dilated", "hypertrophied", "plain", "all"):
        assert f"| volume | {kind} |" in page


@pytest.mark.parametrize("damage", [lambda raw: b"nothing", lambda raw: raw[: len(raw) // 2]])
def test_a_damaged_file(file, tmp_path, damage):
    path = tmp_path / "damaged.pt.gz"
    path.write_bytes(damage(file.read_bytes()))
    with pytest.raises(InputError, match="make heart-emulator"):
        read(path)
    path.write_bytes(gzip.compress(b"nothing"))
    with pytest.raises(InputError, match="make heart-emulator"):
        read(path)


@pytest.fixture
def by_surfaces(any_heart):
    """Of volumes that differ from the table's by up to a tenth."""
    volumes = np.linspace(-0.1, 0.1, 17 * 8).reshape(17, 8)
    channels = any_heart.emulator.channels
    return channels, volumes, BySurfaces.of(channels, any_heart.known, volumes)


def test_what_surfaces_change_is_subtracted(any_heart, by_surfaces):
    channels, volumes, change = by_surfaces
    table = pd.read_csv(BY_SURFACES, keep_default_na=False).set_index(["quantity", "level", "by"])
    there = torch.full((1, len(any_heart.known.names)), 0.8).double()
    y = torch.linspace(0.1, 0.4, len(channels)).double()[None]
    y[0, 0] = 100.0
    by_table = y[0].numpy()
    # The basal inferoseptal segment: nothing is above it, 9 is below, 2 and 4 are beside it.
    d = channels.names.index("radial_03")
    rows = table.loc["radial", "basal"]
    halves, within = volumes[:, :4], volumes[:, 4:]
    above, around = np.zeros(4), (halves[3] - halves[1]) / 2
    shape = [halves[2], within[2], halves[:6].mean(axis=0), halves[8], above, around, above]
    slopes = rows[list(OF_SHAPE)] @ np.concatenate(shape)
    # All factors are alike: means over zones are, too, and no neighbour differs from another one.
    places = ("own", "mean", "beside")
    logs = {"one": 1.0} | {f"{factor}_{at}": np.log(0.8) for factor in FACTORS for at in places}
    expected = sum(slopes[by] * log for by, log in logs.items())
    assert change(y, there)[0, d] == pytest.approx(by_table[d] * (1 - expected))
    same = BySurfaces.of(channels, any_heart.known, np.zeros((17, 8)))
    np.testing.assert_allclose(same(y, there)[0], by_table)
    mixing = Mixing.of(channels, None, change)
    sd = mixing.covariance(y, torch.zeros(1, 52, 52).double(), there)[0].diagonal().sqrt()
    for channel, size, of_channel in zip(channels, by_table, sd, strict=True):
        level = level_of(channel.segment) if channel.segment else ""
        stated = table.loc[(channel.quantity, level, "one"), "sd"]
        assert of_channel == pytest.approx(stated * (size if channel.quantity in SHARES else 1))
    some = ["volume_ml", "radial_03"]
    at = [channels.names.index(name) for name in some]
    np.testing.assert_allclose(mixing.select(some)(y, there), mixing(y, there)[:, at])


def test_derivatives_of_what_surfaces_change(by_surfaces, any_heart):
    channels, _, change = by_surfaces
    generator = torch.Generator().manual_seed(1)
    size = len(any_heart.known.names)
    there = 0.5 + torch.rand(3, size, generator=generator).double()
    slopes = torch.randn(3, len(channels), size, generator=generator).double()

    def outputs(at):
        moved = 0.2 + (slopes @ (at - there)[..., None])[..., 0]
        return change(moved, at).sum(dim=0)

    expected = torch.autograd.functional.jacobian(outputs, there).transpose(0, 1)
    found = change.slopes(torch.full((3, len(channels)), 0.2).double(), slopes, there)
    torch.testing.assert_close(found, expected)
