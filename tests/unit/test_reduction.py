"""Principal components of the strains: what is kept, what is thrown away, what comes back."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.emulators.reduction import Reduction, fit_reduction
from regional_lv.errors import InputError

CHANNELS = Channels.of()


@pytest.fixture
def outputs() -> np.ndarray:
    """400 rows of 52 outputs that four hidden numbers make, and a little of a fifth."""
    rng = np.random.default_rng(1)
    hidden = rng.normal(size=(400, 5)) * [1.0, 1.0, 0.5, 0.5, 0.02]
    y = hidden @ rng.normal(size=(5, 52)) * 0.1
    y[:, 0] = 150 + 20 * y[:, 0]
    return y


def test_keeps_the_fewest_components_that_explain_enough(outputs):
    reduction = Reduction.fit(outputs, 0.999, CHANNELS)
    table = reduction.explained()
    assert reduction.components == 4
    assert table["cumulative"].iloc[3] >= 0.999 > table["cumulative"].iloc[2]
    assert table["kept"].tolist() == [True] * 4 + [False] * (len(table) - 4)
    assert table["explained"].sum() == pytest.approx(1)


def test_components_are_eigenvectors_whose_largest_entry_is_positive(outputs):
    reduction = Reduction.fit(outputs, 0.999, CHANNELS)
    correlation = np.corrcoef(outputs[:, 1:], rowvar=False)
    loadings = reduction.loadings
    np.testing.assert_allclose(correlation @ loadings, loadings * reduction.variances, atol=1e-10)
    np.testing.assert_allclose(loadings.T @ loadings, np.eye(51), atol=1e-12)
    assert (np.diff(reduction.variances) <= 0).all()
    assert (loadings[np.abs(loadings).argmax(axis=0), range(51)] > 0).all()


def test_fewer_simulations_than_outputs(outputs):
    y = outputs[:12]
    reduction = Reduction.fit(y, 1.0, CHANNELS)
    assert len(reduction.explained()) == 12 and reduction.components <= 12
    np.testing.assert_allclose(reduction.inverse(reduction.transform(y)), y, atol=1e-10)


def test_all_components_reproduce_everything(outputs):
    reduction = Reduction.fit(outputs, 1.0, CHANNELS)
    np.testing.assert_allclose(reduction.inverse(reduction.transform(outputs)), outputs, atol=1e-10)
    np.testing.assert_allclose(reduction.truncation_covariance(), 0, atol=1e-12)


def test_truncation_covariance_is_that_of_the_residuals(outputs):
    reduction = Reduction.fit(outputs, 0.99, CHANNELS)
    residual = outputs - reduction.inverse(reduction.transform(outputs))
    expected = np.cov(residual, rowvar=False)
    np.testing.assert_allclose(reduction.truncation_covariance(), expected, atol=1e-10)
    assert not reduction.truncation_covariance()[0].any()  # the volume is not reduced


def test_inverse_matrix_is_the_linear_part_of_the_inverse(outputs):
    reduction = Reduction.fit(outputs, 0.99, CHANNELS)
    reduced = reduction.transform(outputs[:3])
    expected = reduced @ reduction.inverse_matrix().T + reduction.mean
    np.testing.assert_allclose(reduction.inverse(reduced), expected)


def test_file_brings_it_back(outputs, tmp_path):
    table = pd.DataFrame(outputs, columns=list(CHANNELS.names))
    table.to_parquet(tmp_path / "train.parquet")
    files = tmp_path / "reduction.npz", tmp_path / "explained.csv"
    fit_reduction(tmp_path / "train.parquet", CHANNELS, 0.99, *files)
    loaded, fitted = Reduction.load(files[0]), Reduction.fit(outputs, 0.99, CHANNELS)
    np.testing.assert_allclose(loaded.transform(outputs), fitted.transform(outputs), atol=1e-9)
    assert loaded.components == fitted.components
    assert len(pd.read_csv(files[1])) == 51


def test_refuses_rows_that_are_not_finite(outputs):
    outputs[3, 7] = np.nan
    with pytest.raises(InputError, match="not finite"):
        Reduction.fit(outputs, 0.99, CHANNELS)


@pytest.mark.parametrize(
    "names",
    [
        # Volumes at two loads, not in front, and torsion among the strains.
        ("radial_01", "volume_ml", "torsion_basal-apical", "radial_02", "volume_ml@0.5"),
        ("circumferential_01", "circumferential_02", "radial_01@0.5", "shortening"),
        ("volume_ml", "volume_ml@0.5"),
        ("volume_ml", "radial_07"),
    ],
)
def test_volumes_stay_apart_wherever_they_stand(names, outputs, tmp_path):
    channels = Channels.parse(names)
    is_volume = np.array([name.startswith("volume") for name in names])
    y = outputs[:, : len(names)] * np.where(is_volume, 100.0, 0.01)
    for share in (1.0, 0.7):
        reduction = Reduction.fit(y, share, channels)
        volumes = int(is_volume.sum())
        reduced = reduction.transform(y)
        assert reduced.shape == (400, reduction.components + volumes)
        np.testing.assert_allclose(
            reduced[:, reduction.components :], ((y - reduction.mean) / reduction.sd)[:, is_volume]
        )
        again = reduction.inverse(reduced)
        np.testing.assert_allclose(again[:, is_volume], y[:, is_volume])
        expected = np.cov(y - again, rowvar=False)
        np.testing.assert_allclose(reduction.truncation_covariance(), expected, atol=1e-9)
        assert len(reduction.explained()) == len(names) - volumes
        reduction.save(tmp_path / "r.npz")
        np.testing.assert_array_equal(Reduction.load(tmp_path / "r.npz").transform(y), reduced)
    assert reduction.components < len(names) - volumes or len(names) - volumes <= 1
