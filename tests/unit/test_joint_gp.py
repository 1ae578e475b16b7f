"""One emulator of all inputs: its coordinates, design, scale of outputs, and what it learns."""

import copy
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.emulators import create, exact_gp, load
from regional_lv.emulators.finer import corrected, train_finer
from regional_lv.emulators.kernels import BlockRQKernel
from regional_lv.emulators.observed_derivatives import (
    ObservedDerivatives,
    Weighted,
    covariance,
    crossed,
)
from regional_lv.emulators.output_scale import OutputScale
from regional_lv.emulators.shared_kernel import condition
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.scales import Linear, Logarithmic, Saturating
from regional_lv.mechanics.derivative_kernel import joint_covariance

OUTPUTS = ("volume_ml", "circumferential_01", "radial_01", "torsion_basal-apical")
COORDINATES = Coordinates(
    ("C_a_whole", "C_b_whole", "angle", "spring", "strain_measure"),
    (Logarithmic(), Logarithmic(), Linear(), Saturating(0.3), Linear()),
    np.array([0.2, 0.2, -30.0, 0.0, -2.0]),
    np.array([5.0, 5.0, 30.0, 0.2, 2.0]),
    [slice(0, 2), slice(2, 4), slice(4, 5)],
    softness=(0, 1),
    exponent=4,
)


def points(n, seed):
    """Values (n, 5)."""
    u = np.random.default_rng(seed).uniform(size=(n, 5))
    low, high = (COORDINATES.scaled(ends) for ends in (COORDINATES.lower, COORDINATES.upper))
    return COORDINATES.natural(low + u * (high - low))


def toy(theta, finer=0.0):
    """Outputs (..., 4) of a heart: softer ones stretch more, springs less; a `finer` mesh lets all
    stretch more."""
    z = COORDINATES.scaled(theta)
    soft = torch.exp(-0.3 * z[..., 0] - 0.1 * z[..., 1])
    log_stretch = 0.2 * soft * (1 - z[..., 3]) + 0.002 * z[..., 2]
    log_stretch = log_stretch + finer * (0.02 * soft + 0.01)
    n = theta[..., 4]
    strain = torch.expm1(-n * log_stretch) / n
    radial = torch.expm1(n * 1.5 * log_stretch) / n
    torsion = 0.1 * z[..., 2] + finer * 0.1 * soft
    return torch.stack([100 * torch.exp(log_stretch), strain, radial, torsion], -1)


def slopes(theta, finer=0.0):
    def of(at):
        return toy(at, finer)

    return torch.func.vmap(torch.func.jacfwd(of))(torch.as_tensor(theta)).numpy()


def simulated(theta, finer=0.0):
    """Outputs (n, 4) and sensitivities (n, 4, 5)."""
    return toy(torch.as_tensor(theta), finer).numpy(), slopes(theta, finer)


STUDY = COORDINATES, Channels.parse(OUTPUTS), 5
KNOWN = {"parameters": COORDINATES, "outputs": OUTPUTS, "seed": 3}


def fitted(n, **settings):
    theta = points(n, 1)
    return create("joint_gp", settings).fit(theta, *simulated(theta), **KNOWN)


@pytest.fixture(scope="module")
def emulator():
    return fitted(60, max_observations=240, hyperparameter_rows=40)


@pytest.fixture(scope="module")
def rough():
    """One that knows little, and computes its variance from a part of that."""
    return fitted(12, max_observations=30, variance_observations=24)


@pytest.fixture(scope="module")
def near():
    """Values (6, 5) of draws that lie close together."""
    middle, rng = COORDINATES.scaled(points(1, 21)), np.random.default_rng(22)
    width = COORDINATES.scaled(COORDINATES.upper) - COORDINATES.scaled(COORDINATES.lower)
    return COORDINATES.natural(middle + 0.02 * width * rng.normal(size=(6, 5)))


# -------------------------------------------------------------------------------- coordinates


def test_coordinates_there_and_back():
    theta = points(5, 2)
    z = COORDINATES.scaled(theta)
    np.testing.assert_allclose(COORDINATES.natural(z), theta, rtol=1e-12)
    as_tensors = COORDINATES.scaled(torch.as_tensor(theta))
    np.testing.assert_allclose(as_tensors.numpy(), z, rtol=1e-15)
    step = 1e-6
    numeric = (COORDINATES.natural(z + step) - COORDINATES.natural(z - step)) / (2 * step)
    np.testing.assert_allclose(COORDINATES.slope(theta), numeric, rtol=1e-6)


def test_coordinates_are_kept():
    again = Coordinates.from_spec(COORDINATES.spec())
    assert again.spec() == COORDINATES.spec()
    assert again.scales == COORDINATES.scales


# -------------------------------------------------------------------------- observed derivatives


def test_derivatives_are_chosen_by_their_weight():
    weight = torch.tensor([1.0, 1.0, 0.01, 1.0, 0.2]).double()
    seen = ObservedDerivatives.some(400, 5, 800, seed=1, weight=weight)
    counts = torch.bincount(seen.along, minlength=5)
    assert counts[2] < 0.1 * counts[0] and counts[2] < counts[4] < 0.7 * counts[0]


@pytest.mark.parametrize("most", [0, 7, 15, 30])
def test_as_many_derivatives_as_fit(most):
    seen = ObservedDerivatives.some(6, 5, most, seed=1)
    assert len(seen.at) == most
    pairs = set(zip(seen.at.tolist(), seen.along.tolist(), strict=True))
    counts = np.bincount(seen.at, minlength=6)
    assert len(pairs) == most and np.ptp(counts) <= 1


@pytest.mark.parametrize("most", [12, 30])
def test_covariances_of_what_is_seen(most):
    """Rows and columns of the covariance of everything, in length scales."""
    rng = np.random.default_rng(5)
    x, y = (torch.as_tensor(rng.normal(size=(n, 5))) for n in (6, 4))
    kernel = BlockRQKernel(COORDINATES.blocks).double()
    kernel.initialize(lengthscale=torch.as_tensor(rng.uniform(0.5, 2, (1, 5))), alpha=0.7)
    seen, scales = ObservedDerivatives.some(6, 5, most, seed=2), kernel.lengthscale[0].detach()
    with torch.no_grad():
        found = covariance(kernel, x, seen)
        beside = crossed(kernel, y, x, seen)
        whole, other = (
            torch.as_tensor(
                joint_covariance(at.numpy(), x.numpy(), scales.numpy(), 0.7, kernel.blocks)
            )[:rows]
            for at, rows in ((x, None), (y, 4))
        )
        rows = torch.cat([torch.arange(6), 6 * (1 + seen.along) + seen.at])
        size = torch.cat([torch.ones(6), scales[seen.along]])
        torch.testing.assert_close(found, whole[rows][:, rows] * size * size[:, None])
        torch.testing.assert_close(beside, other[:, rows] * size)
        weights = torch.as_tensor(rng.normal(size=(6 + most, 3)))
        weighted = Weighted(kernel, x, seen, weights)
        mean, by_x = weighted.with_slopes(y)
        torch.testing.assert_close(mean, beside @ weights)
        torch.testing.assert_close(weighted.mean(y), mean)
        for k in range(5):
            step = 1e-6 * torch.eye(5).double()[k]
            sides = [crossed(kernel, y + s * step, x, seen) @ weights for s in (1, -1)]
            torch.testing.assert_close(
                by_x[..., k], (sides[0] - sides[1]) / 2e-6, rtol=1e-6, atol=1e-8
            )


@pytest.mark.parametrize("fixed", [[4], [0, 3], [0, 1, 2], []])
def test_what_is_fixed_costs_nothing_and_changes_nothing(emulator, fixed):
    theta = torch.as_tensor(points(7, 31))
    mask = torch.zeros(5, dtype=torch.bool)
    mask[fixed] = True
    theta[:, mask] = theta[0, mask]
    mean, slopes = emulator.linearise(theta)
    of_few = emulator.at_fixed(theta[0], mask)
    torch.testing.assert_close(of_few.predict_mean(theta), mean)
    found, by_theta = of_few.linearise(theta)
    torch.testing.assert_close(found, mean)
    torch.testing.assert_close(by_theta[..., ~mask], slopes[..., ~mask])
    torch.testing.assert_close(of_few.select(OUTPUTS[1:2]).predict_mean(theta), mean[:, 1:2])


# -------------------------------------------------------------------------- scale of the outputs


@pytest.mark.parametrize("exponent", [-2.0, 1e-9, 0.0, 2.0])
def test_scale_of_outputs(exponent):
    scale = OutputScale.of(OUTPUTS, COORDINATES)
    theta = torch.as_tensor(points(1, 3))[0]
    theta[4] = exponent
    v = torch.tensor([4.6, -0.2, 0.4, 3.0]).double()
    y = scale.outputs(v, theta)
    log_stretch = torch.log1p(exponent * y[1:3]) / exponent if exponent else y[1:3]
    torch.testing.assert_close(log_stretch, v[1:3], rtol=1e-6, atol=1e-9)
    assert y[0] == pytest.approx(np.exp(4.6)) and y[3] == 3.0
    torch.testing.assert_close(scale.of_outputs(y, theta), v)
    by_v = torch.autograd.functional.jacobian(lambda w: scale.outputs(w, theta), v).diagonal()
    torch.testing.assert_close(scale.slopes(v, theta)[0], by_v)
    step = 1e-4 * torch.eye(5).double()[4]
    sides = [scale.outputs(v, theta + s * step) for s in (1, -1)]
    torch.testing.assert_close(
        scale.slopes(v, theta)[1], (sides[0] - sides[1]) / 2e-4, rtol=1e-5, atol=1e-8
    )


def test_a_strain_that_cannot_be():
    theta = points(12, 4)
    y = toy(torch.as_tensor(theta)).numpy()
    theta[:, 4], y[3, 1] = 2.0 - 1e-3 * np.arange(12), -0.7
    with pytest.raises(InputError, match="circumferential_01 has values"):
        create("joint_gp").fit(theta, y, slopes(theta), parameters=COORDINATES, outputs=OUTPUTS)


# ---------------------------------------------------------------------------------- the emulator


def test_it_predicts(emulator):
    theta = torch.as_tensor(points(100, 6))
    with torch.no_grad():
        found = emulator.predict(theta)
    error = found.mean - toy(theta)
    assert (error.square().mean(0).sqrt() < 0.02 * emulator.output_sd).all()
    assert 0.85 < (error.abs() < 1.96 * found.sd).double().mean() <= 1


def test_its_derivatives(emulator):
    theta = torch.as_tensor(points(3, 7))
    mean, by_theta = emulator.linearise(theta)
    torch.testing.assert_close(mean, emulator.predict(theta).mean)
    for k, size in enumerate(theta.std(0)):
        step = 1e-4 * size * torch.eye(5).double()[k]
        with torch.no_grad():
            sides = [emulator.predict_mean(theta + s * step) for s in (1, -1)]
        numeric = (sides[0] - sides[1]) / (2e-4 * size)
        torch.testing.assert_close(by_theta[..., k], numeric, rtol=1e-4, atol=1e-5)


def test_the_stated_error_of_a_part_of_the_observations():
    """As wide as that of all of them where it matters: calibrated by the same errors left out."""
    at = torch.as_tensor(points(100, 9))
    whole, part = (
        fitted(60, hyperparameter_rows=40, variance_observations=most) for most in (None, 200)
    )
    with torch.no_grad():
        exact, found = whole.predict(at), part.predict(at)
    torch.testing.assert_close(found.mean, exact.mean)
    ratio = found.sd / exact.sd
    assert 0.5 < ratio.median() < 2 and (ratio != 1).all()
    error = (found.mean - toy(at)).abs()
    covered = [(error < 1.96 * each.sd).double().mean() for each in (exact, found)]
    assert covered[1] > covered[0] - 0.05


@pytest.mark.parametrize("calibration", ["student", "intervals"])
def test_without_stiffness_among_the_inputs(calibration):
    fixed = replace(COORDINATES, softness=())
    theta = points(40, 1)
    settings = {"max_observations": 120, "iterations": 10, "calibration": calibration}
    known = KNOWN | {"parameters": fixed}
    found = create("joint_gp", settings).fit(theta, *simulated(theta), **known)
    there = points(40, 2)
    errors = found.errors_of(there, simulated(there)[0]).abs()
    assert 0.7 < (errors < 2).double().mean()


def test_it_is_kept_and_selected(emulator, tmp_path):
    emulator.save(tmp_path / "joint.pt")
    again = load(tmp_path / "joint.pt")
    theta = torch.as_tensor(points(4, 8))
    one, other = emulator.predict(theta), again.predict(theta)
    torch.testing.assert_close(one.mean, other.mean)
    torch.testing.assert_close(one.covariance, other.covariance)
    some = again.select(("radial_01", "volume_ml")).predict(theta)
    torch.testing.assert_close(some.mean, one.mean[:, [2, 0]])
    torch.testing.assert_close(some.covariance, one.covariance[:, [2, 0]][..., [2, 0]])


def test_loading_factorises_what_the_variance_needs_alone(rough, tmp_path, monkeypatch):
    rough.save(tmp_path / "joint.pt")
    factorised, cholesky = [], exact_gp.cholesky
    monkeypatch.setattr(
        exact_gp, "cholesky", lambda m, *rest: factorised.append(len(m)) or cholesky(m, *rest)
    )
    again, theta = load(tmp_path / "joint.pt"), torch.as_tensor(points(4, 8))
    torch.testing.assert_close(again.predict_mean(theta), rough.predict_mean(theta))
    assert not factorised
    torch.testing.assert_close(again.predict(theta).sd, rough.predict(theta).sd)
    assert factorised == [24]


# ---------------------------------------------------------------------- further simulations


def process_of(like, theta, seen):
    """The process of `like`, of these values and derivatives, factorised at once."""
    made, here = copy.copy(like), torch.as_tensor(theta)
    made._clear_cached()
    made.inputs, made.nugget = made.standardise(here), 1e-5
    made.seen = made.variance_seen = seen
    y, by_theta = (torch.as_tensor(each) for each in simulated(theta))
    y = (y - made.output_mean) / made.output_sd
    targets = made._observed(y, made._standardise_slopes(by_theta, here), seen)
    made.mean, made.weights = condition(made._known.cholesky, targets, made._known.constant)
    return made


def test_conditioning_is_the_process_of_all_observations(emulator):
    like, theta, at = emulator.processes[0], points(26, 11), torch.as_tensor(points(30, 12))
    first, second = (
        ObservedDerivatives.some(20, 5, 60, seed=5),
        ObservedDerivatives.of_all(torch.arange(20, 26), torch.arange(5)),
    )
    whole = process_of(like, theta, first.joined(second))
    found = process_of(like, theta[:20], first)
    for part in (slice(20, 23), slice(23, 26)):
        found = found.condition(theta[part], *simulated(theta[part]))
    with torch.no_grad():
        one, other = whole.predict(at), found.predict(at)
    torch.testing.assert_close(other.mean, one.mean, rtol=1e-8, atol=1e-8)
    torch.testing.assert_close(other.variance, one.variance, rtol=1e-6, atol=1e-12)
    for exact, mine in zip(whole.linearise(at), found.linearise(at), strict=True):
        torch.testing.assert_close(mine, exact, rtol=1e-7, atol=1e-8)


def test_further_simulations_are_reproduced(rough, near):
    y, by_theta = simulated(near)
    given = rough.condition(near, y, by_theta)
    here, far = torch.as_tensor(near), torch.as_tensor(points(200, 13))
    before, after = rough.errors_of(here, y), given.errors_of(here, y)
    assert before.shape == (6, 4) and after.square().mean() < 4
    with torch.no_grad():
        prior, found = rough.predict(here), given.predict(here)
    torch.testing.assert_close(before, (torch.as_tensor(y) - prior.mean) / prior.sd)
    rms = [(p.mean - torch.as_tensor(y)).square().mean(0).sqrt() for p in (prior, found)]
    assert (rms[1] < 0.3 * rms[0]).all() and (found.sd < 0.2 * prior.sd).all()
    _, found_slopes = given.linearise(here)
    off = [(s - torch.as_tensor(by_theta)).norm() for s in (rough.linearise(here)[1], found_slopes)]
    assert off[1] < 0.05 * off[0]
    with torch.no_grad():
        prior, found = rough.predict(far), given.predict(far)
    ratio = (found.sd / prior.sd)[:, 0]
    assert (ratio < 1 + 1e-9).all()
    gap = torch.cdist(given.standardise(far), given.standardise(here)).amin(1)
    close, away = ratio[gap < gap.quantile(0.2)], ratio[gap > gap.quantile(0.8)]
    assert away.median() > 1.5 * close.median()
    # Other draws are predicted better, and what is far from them hardly worse.
    middle = COORDINATES.natural(COORDINATES.scaled(near).mean(0, keepdims=True))
    for theta, most in ((torch.as_tensor(middle), 0.3), (far, 1.2)):
        with torch.no_grad():
            means = [each.predict_mean(theta) for each in (rough, given)]
        errors = [(mean - toy(theta)).square().mean(0).sqrt() for mean in means]
        assert (errors[1] < most * errors[0]).all()


def test_the_same_simulations_again_change_nothing(rough, near):
    given = rough.condition(near, *simulated(near))
    again, here = given.condition(near, *simulated(near)), torch.as_tensor(near)
    with torch.no_grad():
        one, other = given.predict(here), again.predict(here)
    assert ((one.mean - other.mean).abs() < 3 * one.sd).all()
    nothing = rough.condition(*(part[:0] for part in (near, *simulated(near))))
    torch.testing.assert_close(nothing.predict(here).mean, rough.predict(here).mean)


def test_conditioned_emulators_are_selected_and_kept(rough, near, tmp_path):
    (y, by_theta), some = simulated(near), ("radial_01", "volume_ml")
    given, at = rough.condition(near, y, by_theta), torch.as_tensor(points(9, 14))
    part = rough.select(some).condition(near, y[:, [2, 0]], by_theta[:, [2, 0]])
    given.save(tmp_path / "given.pt")
    again = load(tmp_path / "given.pt")
    for same in (part, again.select(some)):
        one, other = given.select(some).predict(at), same.predict(at)
        torch.testing.assert_close(other.mean, one.mean)
        torch.testing.assert_close(other.covariance, one.covariance)
        assert len(same.inputs) == 18


def test_simulations_that_cannot_be_joined(rough, near):
    y, by_theta = simulated(near)
    with pytest.raises(InputError, match="there are none"):
        rough.condition(near, y, None)
    with pytest.raises(InputError, match=r"shape \(6, 4, 4\); expected \(6, 4, 5\)"):
        rough.condition(near, y, by_theta[..., :4])
    by_theta[2, 1, 0] = np.nan
    with pytest.raises(InputError, match="sensitivities of row 2"):
        rough.condition(near, y, by_theta)
    y[3, 0] = np.nan
    with pytest.raises(InputError, match=r"row 3 .* not finite"):
        rough.condition(near, y, by_theta)
    y, by_theta = simulated(near)
    y[4, 0] = -100.0
    with pytest.raises(InputError, match=r"volume_ml has values .*row 4: -100"):
        rough.condition(near, y, by_theta)


# ------------------------------------------------------------------------------ a finer mesh


def table(path, theta, samples, finer, failed=()):
    y, by_theta = simulated(theta, finer)
    rows = pd.DataFrame(np.hstack([theta, y]), columns=[*COORDINATES.names, *OUTPUTS])
    rows["sample"], rows["status"] = samples, "converged"
    rows["sensitivity"] = [each.ravel().tolist() for each in by_theta]
    for row in failed:
        rows.at[row, "sensitivity"], rows.at[row, "status"] = [], "failed"
    rows.to_parquet(path)
    return [path]


@pytest.fixture(scope="module")
def both_meshes(emulator, tmp_path_factory):
    """An emulator that was corrected by 15 of 16 simulations, and what its training reports."""
    folder, theta = tmp_path_factory.mktemp("finer"), points(16, 15)
    emulator.save(folder / "emulator.pt")
    order = np.random.default_rng(16).permutation(16)
    coarse = table(folder / "coarse.parquet", theta, np.arange(16), 0.0)
    finer = table(folder / "finer.parquet", theta[order], order, 1.0, failed=[3])
    files = folder / "corrected.pt", folder / "report.json"
    train_finer(folder / "emulator.pt", coarse, finer, *STUDY, *files)
    return load(files[0]), json.loads(files[1].read_text())


def test_a_finer_mesh_is_learnt(emulator, both_meshes):
    found, report = both_meshes
    theta = torch.as_tensor(points(200, 17))
    with torch.no_grad():
        study, finer = emulator.predict(theta), found.predict(theta)
    exact = toy(theta, 1.0)
    errors = [(each.mean - exact).square().mean(0).sqrt() for each in (study, finer)]
    assert (errors[1] < 0.1 * errors[0]).all()
    truths = (study, toy(theta)), (finer, exact)
    covered = [((p.mean - y).abs() < 1.96 * p.sd).double().mean() for p, y in truths]
    assert covered[1] > covered[0] - 0.05
    exact_slopes = torch.as_tensor(slopes(theta, 1.0))
    off = [(each.linearise(theta)[1] - exact_slopes).norm() for each in (emulator, found)]
    assert off[1] < 0.2 * off[0]
    torch.testing.assert_close(found.linearise(theta)[0], finer.mean)
    assert report["simulations"] == 15
    volume = report["volume"]
    assert volume["left_out_error"] < 0.1 * volume["sd"] < 0.1 * volume["mean"]


def test_simulations_of_the_study_mesh_join(rough, near):
    """What a finer mesh changes stays as it was."""
    theta = points(16, 15)
    study, finer = (simulated(theta, f) for f in (0.0, 1.0))
    both = corrected(rough, theta, study, finer, seed=6)
    given = both.condition(near, *simulated(near))
    alone, at = rough.condition(near, *simulated(near)), torch.as_tensor(points(9, 14))
    torch.testing.assert_close(given.of_study_mesh.predict_mean(at), alone.predict_mean(at))
    before, after = (each.processes[1].predict_mean(at) for each in (both, given))
    torch.testing.assert_close(before, after)
    assert (given.errors_of(near, toy(torch.as_tensor(near), 1.0)).abs() < 5).all()


def test_meshes_that_cannot_be_compared(emulator, both_meshes, tmp_path):
    theta, files = points(16, 15), (tmp_path / "corrected.pt", tmp_path / "report.json")
    emulator.save(tmp_path / "emulator.pt")
    coarse = table(tmp_path / "coarse.parquet", theta, np.arange(16), 0.0)
    few = table(tmp_path / "few.parquet", theta, np.arange(16), 1.0, failed=range(10))
    with pytest.raises(InputError, match=r"few.parquet: 6 simulations converged on both"):
        train_finer(tmp_path / "emulator.pt", coarse, few, *STUDY, *files)
    other = table(tmp_path / "other.parquet", points(16, 18), np.arange(16), 1.0)
    with pytest.raises(InputError, match=r"other.parquet: sample 0 has other inputs"):
        train_finer(tmp_path / "emulator.pt", coarse, other, *STUDY, *files)
    both_meshes[0].save(tmp_path / "twice.pt")
    with pytest.raises(InputError, match=r"twice.pt: not an emulator .* mesh alone"):
        train_finer(tmp_path / "twice.pt", coarse, other, *STUDY, *files)
