"""The metrics and figures of the studies of learning against direct computations."""

import numpy as np
import pytest

from workbench.motion.models.walking import CHANNEL_NAMES, walking_cycles
from workbench.motion.synthetic.gait import builtin_motions
from workbench.studies.gap_errors import ImputeGaps
from workbench.studies.learning import LearnWalk
from workbench.studies.walk_cycles import AlignCycles, PeriodSnr, fold


def rng():
    return np.random.default_rng(0)


def by_name(result):
    return {figure.name: figure for figure in result.figures}


@pytest.fixture(scope="module")
def learned():
    return LearnWalk(scaling="none").run(rng())


@pytest.fixture(scope="module")
def cycles():
    return walking_cycles(builtin_motions()).curves


def test_explained_variance_is_that_of_the_eigenvalues(learned, cycles):
    scaled = cycles / np.where(np.arange(cycles.shape[2]) == 0, 30.0, 1.0)  # speed in metres per frame at 30 Hz
    rows = scaled.reshape(len(cycles), -1)
    eigenvalues = np.linalg.eigvalsh(np.cov(rows, rowvar=False))[::-1]
    fraction = np.cumsum(eigenvalues) / eigenvalues.sum()
    explained = by_name(learned)["model/explained variance"].curves["explained"]
    assert explained == pytest.approx(fraction[: len(explained)], abs=1e-9)
    d = int(learned.metrics["n_components"])
    assert fraction[d - 2] <= 0.95 < fraction[d - 1]
    assert learned.metrics["explained_variance"] == pytest.approx(fraction[d - 1], abs=1e-9)
    assert learned.metrics["explained_variance_5"] == pytest.approx(fraction[4], abs=1e-9)
    assert learned.metrics["n_cycles"] == len(cycles)


def test_an_eigencurve_deviates_from_the_mean_by_two_standard_deviations(learned, cycles):
    """The first component's curves differ from the mean by twice the standard deviation of the cycles along it."""
    scaled = (cycles / np.where(np.arange(cycles.shape[2]) == 0, 30.0, 1.0)).reshape(len(cycles), -1)
    values, vectors = np.linalg.eigh(np.cov(scaled, rowvar=False))
    first = 2.0 * np.sqrt(values[-1]) * vectors[:, -1].reshape(cycles.shape[1:])
    for name in ("left_hip_flexion", "right_elbow_flexion"):
        figure = by_name(learned)[f"eigencurves/{name.replace('_', ' ')}"]
        deviation = np.radians(figure.curves["+2λ1"] - figure.curves["mean"])[:-1]
        expected = first[:, CHANNEL_NAMES.index(name)]
        assert np.abs(deviation) == pytest.approx(np.abs(expected), abs=1e-9)  # an eigenvector's sign is free
        mirrored = np.radians(figure.faint["−2λ1"] - figure.curves["mean"])[:-1]
        assert mirrored == pytest.approx(-deviation, abs=1e-12)


def test_folding_returns_the_mean_of_each_bin():
    times = np.array([0.0, 1.001, 2.5, -0.5, 0.999])
    folded = fold(np.array([[1.0], [3.0], [10.0], [20.0], [7.0]]), times)
    assert folded[[0, 32, 63], 0].tolist() == [2.0, 15.0, 7.0]
    assert np.isnan(folded).sum() == 61


def test_alignment_error_never_increases_and_the_walks_converge():
    result = AlignCycles().run(rng())
    figures = by_name(result)
    deviations = figures["alignment/error"].curves["all walks"]
    assert (np.diff(deviations) <= 0.0).all()
    assert result.metrics["n_passes"] == len(deviations) - 1
    spread = {
        when: np.nanstd(list(figures[f"alignment/left knee flexion {when}"].faint.values()), axis=0).mean()
        for when in ("before", "after")
    }
    assert spread["after"] < 0.5 * spread["before"]  # the built-in walkers differ by their start and a few degrees


def test_periods_are_those_of_the_walkers_and_noise_has_no_peak():
    result = PeriodSnr().run(rng())
    figures = by_name(result)
    first = result.figures[0]
    best = first.x[np.nanargmax(first.curves["accumulated"])]
    assert best == pytest.approx(first.marks["hip events"], abs=1.0)  # candidates are whole frames
    noise = figures["period/all walks (thin) and white noise"].curves
    ratios = [10.0 ** (np.nanmax(curve) - np.nanmedian(curve)) for curve in noise.values()]
    assert result.metrics["white_noise_peak_ratio"] == pytest.approx(max(ratios))
    assert max(ratios) < 1.5  # a flat curve
    assert result.metrics["period_error_max_pct"] < 2.0
    assert result.metrics["period_error_max_pct_30"] < 5.0
    assert result.metrics["n_clips"] == 12
    deviation = figures["period/deviation from hip events"].curves["all samples"]
    assert deviation.max() == pytest.approx(result.metrics["period_error_max_pct"])


@pytest.fixture(scope="module")
def imputed():
    return ImputeGaps(fractions=(0.2,)).run(rng())


def test_imputation_methods_are_ranked_by_their_errors(imputed):
    metrics, figure = imputed.metrics, imputed.figures[0]
    assert {label: curve[0] for label, curve in figure.curves.items()} == {
        "ours": metrics["rmse_deg_20"],
        "linear": metrics["rmse_deg_20_linear"],
        "periodic spline": metrics["rmse_deg_20_periodic"],
        "paper's FPCA": metrics["rmse_deg_20_paper"],
    }
    for suffix in ("", "_markers"):
        assert metrics[f"rmse_deg_20{suffix}"] < metrics[f"rmse_deg_20_paper{suffix}"]
        assert metrics[f"rmse_deg_20_periodic{suffix}"] < metrics[f"rmse_deg_20_linear{suffix}"]


def test_component_numbers_of_subsampled_people_and_cycles_are_counted():
    result = LearnWalk(n_draws=30).run(rng())
    bars = by_name(result)["model/components of draws"]
    assert bars.heights.sum() == 30
    inside = bars.heights[(bars.x >= 3) & (bars.x <= 7)].sum() / 30
    assert result.metrics["drawn_components_3_to_7"] == pytest.approx(inside)


@pytest.mark.slow
def test_published_variants_change_the_metrics():
    assert LearnWalk(torso_speed="norm").run(rng()).metrics != LearnWalk().run(rng()).metrics
    assert PeriodSnr(summed=True).run(rng()).metrics != PeriodSnr().run(rng()).metrics
    assert AlignCycles(summed=True).run(rng()).metrics["n_sequences"] == 12
