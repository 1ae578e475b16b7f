"""The convergence check: independent draws pass, and every reason to fail is named."""

import numpy as np
import pytest

from regional_lv.paper.sampler.diagnostics import check_convergence


@pytest.fixture
def chains() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(2, 600, 3))


def checked(chains, diverging=False, pareto_k=np.nan, weighted_ess=1200.0):
    where = np.zeros((2, 600), bool)
    where[0, 5] = diverging
    return check_convergence(chains, ["a", "b", "c"], where, 1.01, 400, pareto_k, weighted_ess)


def test_independent_draws_pass(chains):
    table, verdict = checked(chains)
    assert verdict == "passed" and table["passed"].all()
    assert table["parameter"].tolist() == ["a", "b", "c"]
    assert checked(chains, pareto_k=0.6)[1] == "passed"


def test_every_reason_to_fail_is_named(chains):
    shifted = chains.copy()
    shifted[1, :, 1] += 1.0
    table, verdict = checked(shifted, diverging=True)
    assert verdict.startswith("failed: R-hat") and "ESS" in verdict and "1 divergences" in verdict
    assert not table["passed"].any()
    for weights, reason in (
        ({"pareto_k": 0.8}, "failed: Pareto k 0.80 > 0.7"),
        ({"weighted_ess": 300.0}, "failed: ESS of the weights 300 < 400"),
    ):
        table, verdict = checked(chains, **weights)
        assert verdict == reason and not table["passed"].any()


def test_what_is_no_number_passes_nothing(chains):
    table, verdict = checked(chains, weighted_ess=np.nan)
    assert verdict == "failed: ESS of the weights nan < 400" and not table["passed"].any()
    still = chains.copy()
    still[:, :, 1] = 2.0
    table, verdict = checked(still)
    assert verdict == "failed: b never moved"
    assert table["passed"].tolist() == [True, False, True]
