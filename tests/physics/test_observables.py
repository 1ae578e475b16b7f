"""Observation operators: against theory, against each other, and motions known exactly."""

import numpy as np
import pytest
import torch
from scipy.linalg import fractional_matrix_power, logm

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.geometry.mesh import read_mesh
from regional_lv.mechanics.observables.motion import DIRECTIONS, PointMotion
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.mechanics.observables.strain_measure import StrainMeasure
from regional_lv.quantities import QUANTITIES
from regional_lv.simulation.strain_field import cell_means, strain_field
from regional_lv.testing import QuantityContract

CHANNELS = Channels.of()


@pytest.fixture(scope="module")
def mesh(small_mesh):
    return read_mesh(small_mesh)


@pytest.fixture(scope="module")
def moved(simulator, solved):
    """Displacement (n, 3) of the mesh's nodes in a solved ventricle."""
    return simulator.displacement(solved.w)


@pytest.fixture
def observe(mesh, moved, physics):
    """Values of the default channels of the solved ventricle, observed otherwise."""

    def observe(**changed):
        return Observer(mesh, physics["observables"] | changed).values(CHANNELS, moved, 1.0)

    return observe


class TestRegistered(QuantityContract):
    @pytest.fixture(scope="class", params=QUANTITIES)
    @classmethod
    def kind(cls, request):
        return QUANTITIES[request.param]

    @pytest.fixture(scope="class")
    @classmethod
    def mesh(cls, small_mesh):
        return read_mesh(small_mesh)


def symmetric(count, seed=0):
    """Symmetric positive definite tensors (count, 3, 3), far from the identity."""
    root = np.eye(3) + 0.3 * np.random.default_rng(seed).normal(size=(count, 3, 3))
    return torch.as_tensor(root.swapaxes(1, 2) @ root)


AXES = torch.eye(3, dtype=torch.float64)[:, None, :].expand(3, 20, 3)


@pytest.mark.parametrize("exponent", [2.0, 1.0, 0.5, 0.0, -2.0, 3.7])
def test_tensor_strain_is_the_matrix_function(exponent):
    """Against matrix functions of another library."""
    C = symmetric(20)
    found = StrainMeasure(exponent).along(C, AXES)
    for at, tensor in enumerate(C.numpy()):
        if exponent:
            exact = (fractional_matrix_power(tensor, exponent / 2) - np.eye(3)) / exponent
        else:
            exact = logm(tensor) / 2
        np.testing.assert_allclose(found[:, at], np.diag(exact), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 0.0, -2.0])
def test_derivatives_are_exact_where_eigenvalues_coincide(exponent):
    """At the identity and at a tensor with two equal eigenvalues, where formulas divide by zero."""
    twice = torch.diag(torch.tensor([1.4, 1.4, 0.7], dtype=torch.float64))
    for C in (torch.eye(3, dtype=torch.float64), twice, symmetric(1)[0]):
        direction = torch.as_tensor(np.random.default_rng(1).normal(size=(3, 3)))
        direction = direction + direction.T
        measure, axes = StrainMeasure(exponent), AXES[:, :1]
        free = C.clone()[None].requires_grad_(True)
        for k in range(3):
            value = measure.along(free, axes)[k, 0]
            exact = (torch.autograd.grad(value, free)[0][0] * direction).sum()
            h = 1e-5
            forth, back = (
                measure.along((C + s * h * direction)[None], axes)[k, 0] for s in (1, -1)
            )
            assert exact.item() == pytest.approx(((forth - back) / (2 * h)).item(), abs=1e-8)


@pytest.mark.parametrize("exponent", [2.0, 1.0, 0.0, -2.0])
def test_line_and_tensor_agree_along_principal_axes(exponent):
    """A stretch of 1.2 along an axis: (1.2^n - 1) / n, and nothing to choose between the two."""
    C = torch.diag(torch.tensor([1.44, 1.0, 1 / 1.44], dtype=torch.float64)).expand(20, 3, 3)
    tensor, line = (StrainMeasure(exponent, share).along(C, AXES) for share in (0.0, 1.0))
    stretch = np.log(1.2) if exponent == 0 else (1.2**exponent - 1) / exponent
    np.testing.assert_allclose(tensor[0], stretch, rtol=1e-12)
    np.testing.assert_allclose(tensor, line, rtol=0, atol=1e-13)


def test_the_smaller_the_exponent_the_smaller_the_strain(observe):
    """(l^n - 1) / n grows with n for every stretch, and so do its means."""
    found = np.stack([observe(strain_exponent=n, line_share=1.0) for n in (-2.0, 0.0, 1.0, 2.0)])
    assert (np.diff(found[:, 1:], axis=0) > 0).all()
    np.testing.assert_array_equal(found[:, 0], found[0, 0])


def test_line_strain_of_green_is_green(observe):
    np.testing.assert_allclose(observe(line_share=1.0), observe(), rtol=1e-13)


def test_nominal_strain_is_bounded_by_greens(observe):
    """The length of V^-1 d is at least its component along d, and a mean of roots is at most the
    root of the mean: (1 + e)^2 <= 1 + 2 E. By Hadamard and Hoelder, the product of 1 + e over three
    directions is at least one, as far as this coarse wall keeps its volume."""
    green, nominal = observe(), observe(strain_exponent=1.0)
    line = observe(strain_exponent=1.0, line_share=1.0)
    gap = np.sqrt(1 + 2 * green[1:]) - 1 - nominal[1:]
    assert gap.min() > 0 and np.median(gap) < 0.02
    assert (line - nominal)[1:].min() > 0
    assert np.abs(green - nominal)[1:].max() > 0.05
    volume = np.prod(1 + nominal[1:].reshape(3, 17), axis=0)
    assert volume.min() > 0.99 and np.median(volume) < 1.03


def test_segment_means_are_those_of_the_strain_field(simulator, moved, observe):
    field = strain_field(simulator.observer, moved, 1.0)
    weighted = field[list(DIRECTIONS)].mul(field["volume_mm3"], axis=0)
    volume = field.groupby("segment")["volume_mm3"].sum()
    assert volume.index.tolist() == [*range(1, 18)]
    means = weighted.groupby(field["segment"]).sum().div(volume, axis=0)
    np.testing.assert_allclose(means.to_numpy(), observe()[1:].reshape(3, 17).T, atol=1e-12)


@pytest.mark.parametrize(("dilation", "line"), [(None, 1 / 1.1), (1.0, 1.1**2), (1.21, 1.0)])
def test_a_uniform_stretch_has_one_strain_in_every_cell(mesh, simulator, dilation, line):
    """x -> 1.1 x: looking back, lines along the wall are shorter by 1.1. Those across it are so,
    too, or as long as the volume that the wall allows makes them."""
    means = cell_means(strain_field(simulator.observer, 0.1 * mesh.points, dilation))
    assert means.shape == (len(mesh.cells), 3)
    along, across = (1.1**-2 - 1) / 2, (line**2 - 1) / 2
    assert list(means.columns) == ["circumferential", "radial", "longitudinal"]
    expected = np.broadcast_to([along, across, along], means.shape)
    np.testing.assert_allclose(means.to_numpy(), expected, rtol=1e-9, atol=1e-12)


def test_looking_back_keeps_the_volume_and_the_lines_along_the_wall():
    """Of any F: det is one over the dilation, and what lies along the wall is mapped by F^-1."""
    rng = np.random.default_rng(7)
    F = torch.as_tensor(np.eye(3) + 0.3 * rng.normal(size=(50, 3, 3)))
    gradient = torch.as_tensor(rng.normal(size=(50, 3)))
    dilation = torch.as_tensor(rng.uniform(0.8, 1.2, 50))
    none = torch.zeros(50, 3).double()
    for kept in (1.0, dilation, torch.linalg.det(F)):
        motion = PointMotion(none, none, F, kept, gradient, StrainMeasure())
        wanted = torch.broadcast_to(1 / torch.as_tensor(kept).double(), (50,))
        assert torch.allclose(torch.linalg.det(motion.back), wanted, rtol=1e-9)
        inverse = torch.linalg.inv(F)
        circumferential, normal, longitudinal = motion.directions
        for line in (circumferential, longitudinal):
            assert torch.allclose(motion.back @ line[..., None], inverse @ line[..., None])
        # The normal of the loaded wall is that of the surfaces of equal depth.
        carried = torch.einsum("mji,mj->mi", inverse, gradient)
        carried = carried * torch.linalg.det(F).sign()[:, None]
        assert torch.allclose(normal, carried / carried.norm(dim=1, keepdim=True))


# ------------------------------------------------------------------------------------- layers


def test_layers_make_up_the_wall(mesh, observe, moved, physics):
    """Means over two layers, weighted with their volumes, are the wall's mean, at any border."""
    for border in (0.2, 0.5, 0.77):
        inner, outer = observe(layer=[0.0, border]), observe(layer=[border, 1.0])
        wall = Observer(mesh, physics["observables"]).wall
        weight = [
            np.bincount(
                np.repeat(wall.segment, wall.points_per_cell),
                np.asarray(_weights(wall, layer)),
            )
            for layer in ((0.0, border), (border, 1.0))
        ]
        both = (np.tile(weight[0], 3) * inner[1:] + np.tile(weight[1], 3) * outer[1:]) / np.tile(
            sum(weight), 3
        )
        np.testing.assert_allclose(both, observe()[1:], rtol=0, atol=1e-12)


def _weights(wall, layer):
    from regional_lv.mechanics.observables.layer import window_weights
    from regional_lv.mechanics.observables.wall import POINTS_PER_EDGE

    depth = wall.mesh.transmural[wall.mesh.cells[:, :8]]
    return wall.volume * window_weights(depth, *layer, POINTS_PER_EDGE).ravel()


def test_strain_falls_from_the_inner_to_the_outer_surface(observe):
    layers = [[0.0, 0.0], [0.0, 0.3], [0.0, 1.0], [0.7, 1.0], [1.0, 1.0]]
    means = [observe(layer=layer)[1:18].mean() for layer in layers]
    assert means == sorted(means)


def test_a_layer_that_shrinks_to_the_surface_becomes_it(observe):
    """Averages change smoothly with the window, down to the surface itself."""
    surface = observe(layer=[0.0, 0.0])
    gaps = [np.abs(observe(layer=[0.0, h]) - surface).max() for h in (0.04, 0.02, 0.01)]
    assert gaps[0] / gaps[1] == pytest.approx(2, rel=0.1)
    assert gaps[1] / gaps[2] == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize("layer", [[0.5, 0.2], [-0.1, 1.0], [0.0, 1.2]])
def test_impossible_layers_are_refused(mesh, physics, layer):
    with pytest.raises(InputError, match=r"observables.layer"):
        Observer(mesh, physics["observables"] | {"layer": layer})


def test_scale_multiplies_what_it_names(observe):
    plain, scaled = observe(), observe(scale={"radial": 0.7})
    radial = CHANNELS.of_quantity("radial")
    np.testing.assert_array_equal(scaled, np.where(radial, 0.7 * plain, plain))


# ------------------------------------------------------------------------------- derivatives


@pytest.mark.parametrize("dilation", [None, 1.0])
@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"strain_exponent": 0.0, "line_share": 0.4},
        {"strain_exponent": -2.0, "layer": [0.0, 0.3], "segment_rotation_deg": 7.0},
        {"scale": {"radial": 0.7, "torsion": 1.3}},
    ],
    ids=["default", "mixed", "layer", "scale"],
)
def test_derivatives_are_those_of_the_values(mesh, moved, physics, changed, dilation):
    """All quantities along random motions of the nodes, against central differences."""
    channels = list(Channels.of((*CHANNELS.quantities, "torsion", "shortening")))
    observer = Observer(mesh, physics["observables"] | changed)
    directions = np.random.default_rng(4).normal(size=(3, *moved.shape))
    _, derivatives = observer.observe(channels, moved, dilation, moves=directions)
    h = 1e-6
    for direction, exact in zip(directions, derivatives, strict=True):
        forth, back = (
            observer.values(channels, moved + s * h * direction, dilation) for s in (1, -1)
        )
        np.testing.assert_allclose(exact, (forth - back) / (2 * h), rtol=1e-5, atol=1e-6)


def test_a_compressible_wall_is_seen_with_its_dilation(mesh, moved, physics):
    """Twice the volume everywhere: lines along the wall stay, 2 E + 1 across it is a quarter."""
    observer = Observer(mesh, physics["observables"])
    kept = observer.values(CHANNELS, moved, 1.0)
    grown = observer.values(CHANNELS, moved, np.full((len(mesh.cells), 8), 2.0))
    radial = np.array([channel.quantity == "radial" for channel in CHANNELS])
    np.testing.assert_allclose(1 + 2 * grown[radial], (1 + 2 * kept[radial]) / 4, rtol=1e-12)
    np.testing.assert_allclose(grown[~radial], kept[~radial], rtol=1e-12)


def test_segments_turn_counter_clockwise_seen_from_the_base(simulator):
    """The middle of each but the apex is as much further; the z axis points to the base."""
    wall = simulator.observer.wall
    phi = np.arctan2(wall.place[:, 1], wall.place[:, 0])
    before, after = (
        np.arctan2(shares @ np.sin(phi), shares @ np.cos(phi))[:16]
        for shares in (wall.shares((0.0, 1.0), degrees) for degrees in (0.0, 7.0))
    )
    turned = np.rad2deg(np.angle(np.exp(1j * (after - before))))
    np.testing.assert_allclose(turned, 7.0, atol=1.5)


@pytest.mark.parametrize("rotation", [0.0, 7.0])
def test_what_is_brought_to_the_nodes_gives_the_same_averages(mesh, simulator, rotation):
    """Of a random field: with its values and gradients at the points, or with its nodal values."""
    wall, rng = simulator.observer.wall, np.random.default_rng(2)
    shares = wall.shares((0.2, 0.7), rotation)
    nodal = rng.normal(size=mesh.points.shape)
    of_values = rng.normal(size=(len(wall.volume), 3))
    of_gradients = rng.normal(size=(len(wall.volume), 3, 3))
    density = (of_values * wall.values(nodal)).sum(axis=1)
    density += np.einsum("mcx,mxc->m", of_gradients, wall.gradients(nodal))
    on_nodes = wall.on_nodes(shares, of_values, of_gradients)
    np.testing.assert_allclose(np.einsum("snc,nc->s", on_nodes, nodal), shares @ density)
    corners = rng.normal(size=(len(mesh.cells), 8))
    linear = wall.corner_values(corners[..., None])[:, 0] * of_values[:, 0]
    on_corners = wall.on_corners(shares, of_values[:, 0])
    np.testing.assert_allclose(np.einsum("scq,cq->s", on_corners, corners), shares @ linear)
