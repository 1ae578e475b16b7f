"""The search over sets of causes of a heart in closed form."""

import numpy as np
import pytest
import torch

from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import fit_from_nothing
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import observe
from regional_lv.criticism.search import Search
from tests.criticism.toy import PARAMETERS, THETA, D, Extension, Hypothesis, ToyEmulator, measured

CAUSES, IMITATORS = 5, 10


def search(seed: int, largest: int):
    """Search in a heart with five effects among ten causes that each imitate three of them."""
    rng = np.random.default_rng(seed)
    unit = np.r_[1.0, np.full(D - 1, 0.01)]
    shapes = rng.standard_normal((CAUSES, D))
    imitations = shapes[:3].sum(0) + np.sqrt(3) * 0.3 * rng.standard_normal((IMITATORS, D))
    extensions = [
        Extension(Hypothesis(f"cause_{at}", 0.0, -10.0, 10.0), torch.as_tensor(unit * shape))
        for at, shape in enumerate([*shapes, *imitations])
    ]
    table = measured(ToyEmulator(), seed=seed)
    for extension in extensions[:CAUSES]:
        table["value"] += extension.mean(None, THETA, torch.tensor(5.0).double()).numpy()
    observations = observe({"heart": table}, ToyEmulator(), 1.0)
    layout = Layout.inferred(observations.subjects, PARAMETERS)
    base = Model(observations, ExtendedEmulator(ToyEmulator(), []), layout)
    best = fit_from_nothing(base, seed)
    model = Model(observations, ExtendedEmulator(ToyEmulator(), extensions), layout)
    model.error = base.error
    causes = {e.hypothesis.name: [at] for at, e in enumerate(extensions)}
    return Search(model, best, causes, largest).run()


@pytest.mark.parametrize(
    "seed",
    [0, *(pytest.param(k, marks=pytest.mark.test_all("the same at random again")) for k in (1, 2))],
)
def test_causes_that_imitate_several_give_way_to_them_in_larger_sets(seed):
    found = search(seed, largest=7)
    assert found[0].members == tuple(range(CAUSES))


def test_no_leading_set_fits_worse_than_one_that_it_holds():
    found = {c.members: c.objective for c in search(0, largest=4)}
    best = max(found.values())
    leading = [members for members, objective in found.items() if objective > best - 100]
    pairs = [
        (members, smaller)
        for members in leading
        for at in range(len(members))
        if (smaller := members[:at] + members[at + 1 :]) in found
    ]
    assert pairs
    assert all(found[members] >= found[smaller] - 1e-6 for members, smaller in pairs)
