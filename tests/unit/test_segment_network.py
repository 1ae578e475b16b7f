"""Networks of the wall around a segment: what they see, what they learn, and the process beside."""

import copy
from itertools import chain

import numpy as np
import pytest
import torch

from regional_lv.aha import LEVELS
from regional_lv.emulators import create, load
from regional_lv.emulators.segment_network import SegmentNetworks, groups_of, surroundings
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.scales import Linear, Logarithmic

SEGMENTS = range(1, 18)
COORDINATES = Coordinates(
    (*(f"thickness_{s}" for s in SEGMENTS), "load"),
    (*[Logarithmic()] * 17, Linear()),
    np.array([5.0] * 17 + [0.0]),
    np.array([15.0] * 17 + [1.0]),
    [slice(0, 17), slice(17, 18)],
    softness=tuple(range(17)),
    fields={"thickness": tuple((s - 1,) for s in SEGMENTS)},
)
OUTPUTS = ("volume_ml", *(f"circumferential_{s:02d}" for s in SEGMENTS))
KNOWN = {"parameters": COORDINATES, "outputs": OUTPUTS, "seed": 4}
SMALL = {
    "network_passes": 50,
    "network_width": 32,
    "network_layers": 2,
    "network_members": 1,
    "network_folds": 2,
    "calibration": "intervals",
}


def neighbours():
    """(17, 17): what a segment's stretch has of the thickness of itself and those beside it."""
    found = np.eye(17)
    for ring in LEVELS.values():
        for i, s in enumerate(ring):
            for beside in (ring[i - 1], ring[(i + 1) % len(ring)]):
                found[s - 1, beside - 1] += 0.3 * (len(ring) > 1)
    return torch.as_tensor(found)


def toy(theta):
    """Outputs (..., 18): all segments of a level answer to their surroundings alike."""
    z = COORDINATES.scaled(theta) - torch.as_tensor([2.2] * 17 + [0.0])
    stretch = -0.2 * torch.exp(-z[..., :17] @ neighbours().T + 0.3 * z[..., 17:])
    volume = 100 * torch.exp(0.1 * z[..., 17:] - stretch.mean(-1, keepdim=True))
    return torch.cat([volume, torch.expm1(2 * stretch) / 2], -1)


def simulated(n, seed):
    u = np.random.default_rng(seed).uniform(size=(n, 18))
    low, high = (COORDINATES.scaled(ends) for ends in (COORDINATES.lower, COORDINATES.upper))
    theta = torch.as_tensor(COORDINATES.natural(low + u * (high - low)))
    slopes = torch.func.vmap(torch.func.jacfwd(toy))(theta)
    return theta.numpy(), toy(theta).numpy(), slopes.numpy()


def fitted(**settings):
    return create(
        "joint_gp",
        {"max_observations": 120, "hyperparameter_rows": 20, "iterations": 20} | settings,
    ).fit(*simulated(40, 1), **KNOWN)


@pytest.fixture(scope="module")
def emulator():
    return fitted(**SMALL)


def error(emulator):
    theta, y, _ = simulated(50, 2)
    return np.abs(emulator.predict_mean(torch.as_tensor(theta)).numpy() - y)[:, 1:]


@pytest.mark.parametrize("turns", [{"basal": 1}, {"basal": 3, "mid": 3, "apical": 2}])
def test_a_wall_that_is_turned_looks_the_same_from_the_turned_segment(turns):
    z = np.random.default_rng(0).normal(size=18)
    turned = z.copy()
    for level, by in turns.items():
        at = np.array(LEVELS[level]) - 1
        turned[at] = np.roll(z[at], by)
    ring = LEVELS["basal"]
    other = {"basal": 1} == turns
    for i, segment in enumerate(ring):
        here = surroundings(COORDINATES, segment) @ z
        there = surroundings(COORDINATES, ring[(i + turns["basal"]) % len(ring)]) @ turned
        # The other levels were not turned with it.
        same = np.isclose(here, there)
        assert same.all() if not other else same[: len(ring)].all()
        assert other != same.all()


def test_a_network_sees_values_from_its_segment_on():
    z = np.arange(1.0, 19.0)
    seen = surroundings(COORDINATES, 9) @ z
    assert seen[:12].tolist() == [3, 4, 5, 6, 1, 2, 9, 10, 11, 12, 7, 8]
    # Two thirds of a right angle before, and after, a segment of the four is interpolated.
    assert seen[12:16].sum() == pytest.approx(13 + 14 + 15 + 16)
    assert not set(seen[12:16]) & {13, 14, 15, 16}
    assert seen[16:].tolist() == [17, 18]
    from_apex = surroundings(COORDINATES, 17, np.pi) @ z
    assert from_apex[12:16].tolist() == pytest.approx([15, 16, 13, 14])


def test_what_is_no_field_is_seen_once():
    seen = surroundings(COORDINATES, 9)
    np.testing.assert_array_equal(seen[-1], np.eye(18)[17])
    assert not seen[:-1, 17].any()


def test_levels_share_a_network_and_the_heart_as_a_whole_is_seen_from_all():
    *rings, whole, apex = groups_of(OUTPUTS)
    assert [[s for s, _ in ring.seen_from] for ring in rings] == [*map(list, LEVELS.values())][:3]
    assert (whole.outputs.tolist(), len(whole.seen_from)) == ([[0]], 16)
    assert apex.outputs.tolist() == [[17]]
    assert apex.seen_from == [(17, 0.0), (17, np.pi)]
    everything = [d for one in (*rings, whole, apex) for d in one.outputs.ravel()]
    assert sorted(everything) == list(range(18))


def test_a_level_of_which_segments_are_missing_is_seen_from_the_apex():
    whole, rest = groups_of(OUTPUTS[:6])
    assert whole.outputs.tolist() == [[0]]
    assert (rest.seen_from, rest.outputs.tolist()) == ([(17, 0.0)], [[1, 2, 3, 4, 5]])


@pytest.mark.parametrize("place", [0, 17], ids=["volume", "apex"])
def test_half_a_turn_changes_neither_volume_nor_apex(emulator, place):
    """Exactly for the apex, and for the volume as for the mean over all segments."""
    theta = torch.as_tensor(simulated(3, 5)[0])
    turned = theta.clone()
    for ring in list(LEVELS.values())[:3]:
        at = np.array(ring) - 1
        turned[:, at] = theta[:, np.roll(at, len(ring) // 2)]
    found = [emulator.predict_mean(each)[:, place] for each in (theta, turned)]
    torch.testing.assert_close(*found)


def of_shapes():
    """Coordinates of the radius of every segment and of the levels' ends."""
    ends = ("basal_end", "mid_end", "apical_end")
    low, high = np.array([10.0] * 17 + [0.2, 0.5, 0.8]), np.array([40.0] * 17 + [0.4, 0.7, 0.95])
    return Coordinates(
        (*(f"endo_radius_{s}" for s in SEGMENTS), *ends),
        (*[Logarithmic()] * 17, *[Linear()] * 3),
        low,
        high,
        [slice(0, 17), slice(17, 20)],
        softness=(),
        fields={"endo_radius": tuple((s - 1,) for s in SEGMENTS)},
    )


def test_what_is_in_proportion_to_the_volume_of_discs_needs_no_learning():
    coordinates = of_shapes()
    u = np.random.default_rng(0).uniform(size=(30, 20))
    x = torch.as_tensor(coordinates.lower + u * (coordinates.upper - coordinates.lower))

    def volume(x):
        """Of 17 sectors of discs, each as deep as its level."""
        depth = torch.diff(x[..., 17:], prepend=torch.zeros(*x.shape[:-1], 1), dim=-1)
        depth = torch.cat([depth, 1 - x[..., -1:]], -1)
        level = torch.tensor([0] * 6 + [1] * 6 + [2] * 4 + [3])
        share = torch.tensor([1 / 6] * 12 + [1 / 4] * 4 + [1.0])
        return (x[..., :17].square() * depth[..., level] * share).sum(-1)

    z = coordinates.scaled(x)
    given = [z, (2 * volume(x)).log()[:, None]]
    by_z = torch.func.jacfwd(lambda z: (2 * volume(coordinates.natural(z))).log())
    given.append(torch.func.vmap(by_z)(z)[:, None])
    networks = SegmentNetworks(coordinates, ("volume_ml",), 8, 2, 1).fit(*given, passes=1, seed=0)
    for found, expected in zip(networks.with_slopes(z), given[1:], strict=True):
        torch.testing.assert_close(found, expected, rtol=0, atol=0.02)
    # Nothing is left for the network to say.
    last = networks.networks[0][0].last
    torch.nn.init.zeros_(last.weight), torch.nn.init.zeros_(last.bias)
    torch.nn.init.zeros_(networks.networks[0][0].linear.weight)
    torch.testing.assert_close(networks(z), given[1], rtol=1e-6, atol=1e-8)


def test_a_training_of_ten_steps():
    """As many as a warm-up of a tenth has one of."""
    given = (torch.as_tensor(each) for each in simulated(10, 6))
    networks = SegmentNetworks(COORDINATES, OUTPUTS, 8, 2, 1).fit(*given, passes=2, seed=0)
    assert torch.isfinite(networks(torch.as_tensor(simulated(3, 7)[0]))).all()


def test_networks_learn_from_segments_what_a_process_cannot(emulator):
    plain = error(fitted())
    assert np.median(error(emulator)) < 0.6 * np.median(plain)


def test_slopes_are_those_of_the_mean(emulator):
    theta = torch.as_tensor(simulated(3, 5)[0])
    double = copy.deepcopy(emulator)
    for network in chain(*double.trend.networks):
        network.double()
    _, slopes = double.linearise(theta)
    numeric = torch.func.vmap(torch.func.jacfwd(lambda at: double.predict_mean(at[None])[0]))
    torch.testing.assert_close(slopes, numeric(theta), rtol=1e-8, atol=1e-10)
    torch.testing.assert_close(double.jacobian(theta)[0], slopes)
    # Networks count in single precision.
    torch.testing.assert_close(emulator.linearise(theta)[1], slopes, rtol=1e-4, atol=1e-5)


def test_the_process_adds_nothing_to_the_networks(emulator):
    theta = torch.as_tensor(simulated(3, 5)[0])
    assert not emulator.processes[0].predict_mean(theta).any()
    assert not emulator.processes[0].linearise(theta)[1].any()


def test_intervals_hold_on_other_walls(emulator):
    theta, y, _ = simulated(50, 2)
    found = emulator.predict(torch.as_tensor(theta))
    held = np.abs(found.mean.numpy() - y) < 1.96 * found.sd.numpy()
    assert 0.9 < held.mean() < 1.0


def test_is_kept_and_selected(emulator, tmp_path):
    theta = torch.as_tensor(simulated(3, 5)[0])
    emulator.save(tmp_path / "emulator.pt")
    some = ("circumferential_09", "volume_ml", "circumferential_17")
    at = [OUTPUTS.index(name) for name in some]
    for each in (load(tmp_path / "emulator.pt"), emulator):
        torch.testing.assert_close(each.predict(theta).mean, emulator.predict(theta).mean)
        chosen = each.select(some).select(some[:2])
        mean, slopes = emulator.linearise(theta)
        torch.testing.assert_close(chosen.linearise(theta)[0], mean[:, at[:2]])
        torch.testing.assert_close(chosen.linearise(theta)[1], slopes[:, at[:2]])


def test_further_simulations_join(emulator):
    theta, y, slopes = simulated(4, 6)
    given = emulator.condition(theta, y, slopes)
    there = torch.as_tensor(theta)
    before, after = (np.abs(each.predict_mean(there).numpy() - y) for each in (emulator, given))
    assert after[:, 1:].max() < 0.05 * before[:, 1:].max()


def small(seed, members):
    """Of some simulations, and the scaled coordinates of these."""
    theta, *given = map(torch.as_tensor, simulated(30, 1))
    z = COORDINATES.scaled(theta)
    networks = SegmentNetworks(COORDINATES, OUTPUTS, 8, 2, members)
    return networks.fit(z, *given, passes=2, seed=seed), z


def test_the_same_seed_gives_the_same_networks():
    found = [networks(z) for networks, z in (small(seed, 1) for seed in (1, 1, 2))]
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


def test_the_mean_of_several_networks_counts():
    both, z = small(1, 2)
    together, alone = [both(z), *both.with_slopes(z)], []
    for member in range(2):
        one, _ = small(1, 2)
        one.networks = [[networks[member]] for networks in one.networks]
        alone.append([one(z), *one.with_slopes(z)])
    assert not torch.equal(alone[0][0], alone[1][0])
    for found, *each in zip(together, *alone, strict=True):
        torch.testing.assert_close(found, sum(each) / 2)
