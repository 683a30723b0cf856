"""Studies of the database: held-out probes, and distances and histograms against direct computations."""

import numpy as np
import pytest
from scipy.stats import norm

from workbench.core.study import Bars
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_search import exact_log_prob
from workbench.priors.implicit_tree import log_proposal, sign_tree, total_variation
from workbench.priors.smooth import Smooth
from workbench.studies.database import CoefficientHistograms, Temperature, held_out_probes
from workbench.studies.gap_errors import ImputeGaps
from workbench.studies.tree_balance import TreeBalance
from workbench.utils.errors import InputError


@pytest.fixture(scope="module")
def motions():
    return [motion.resampled(30.0) for motion in builtin_motions(n_subjects=8)]


@pytest.fixture(scope="module")
def prior(motions):
    return Implicit(learn_windows(motions), beta=0.2)


def rng():
    return np.random.default_rng(3)


@pytest.fixture(scope="module")
def temperature(prior):
    study = Temperature(prior, clip=prior.windows.clips[2], frame=25, betas=(0.01, 1.0), n_draws=4, n_probes=6)
    return study.run(rng())


@pytest.fixture(scope="module")
def histograms(prior):
    return CoefficientHistograms(prior, clip=prior.windows.clips[2], frame=25, components=(1, 3)).run(rng())


def test_the_probe_is_the_window_that_ends_at_the_frame(prior, motions):
    name = prior.windows.clips[2]
    probes = held_out_probes(prior, name, 25, 6, rng())
    state = prior.start_after(motions[2].poses[25 - prior.windows.window_frames : 26], 1)
    assert probes.coefficients[0] == pytest.approx(state[0, prior.space.slices["coefficients"]], abs=1e-4)
    assert prior.windows.rows[probes.truth, :19] == pytest.approx(motions[2].poses[26, 6:], abs=1e-6)
    assert name in probes.description
    assert "frame 25" in probes.description


@pytest.mark.parametrize("clip", [None, 5])
def test_windows_of_a_probes_clip_are_not_in_the_database(prior, clip):
    name = None if clip is None else prior.windows.clips[clip]
    probes = held_out_probes(prior, name, None, 12, rng())
    windows = probes.prior.windows
    assert len(probes.coefficients) == 12
    for probe in probes.coefficients:
        (entry,) = np.flatnonzero((prior.windows.coefficients == probe.astype(np.float32)).all(axis=1))
        assert prior.windows.clip_of[entry] not in windows.clip_of
    assert len(set(windows.clip_of)) == 6  # a quarter of eight clips is held out
    assert len(probes.prior.tree.order) == len(windows)


def test_the_metrics_equal_those_of_an_enumeration(temperature, prior):
    probes = held_out_probes(prior, prior.windows.clips[2], 25, 6, rng())
    c = probes.prior.windows.coefficients
    tree = sign_tree(c)
    distances = [
        total_variation(np.exp(exact_log_prob(c, probe, 0.2)), np.exp(log_proposal(tree, probe, 0.2)))
        for probe in probes.coefficients
    ]
    assert temperature.metrics["tv_sign_tree"] == pytest.approx(np.mean(distances))
    assert temperature.metrics["tv_search"] <= prior.tail_probability
    assert 0.0 < temperature.metrics["visited_pct"] < 100.0
    assert temperature.metrics["distance_sign_tree"] > temperature.metrics["distance_exact"]


def test_histograms_are_densities_compared_with_the_probes_gaussian(histograms, prior):
    probe = held_out_probes(prior, prior.windows.clips[2], 25, 1, rng()).coefficients[0]
    bars = {figure.name: figure for figure in histograms.figures}
    assert list(bars) == [f"coefficients/{search}, c{k}" for search in ("sign tree", "our search") for k in (1, 3)]
    for search, name in (("sign tree", "sign_tree"), ("our search", "search")):
        for k in (1, 3):
            figure = bars[f"coefficients/{search}, c{k}"]
            assert isinstance(figure, Bars)
            width = figure.x[1] - figure.x[0]
            assert figure.heights.sum() * width == pytest.approx(1.0)
            # the mean density of a bin differs from that at its centre to second order in the width
            assert figure.model == pytest.approx(norm.pdf(figure.x, probe[k - 1], 1.0), abs=0.1 * width**2)
            direct = 0.5 * (np.abs(figure.heights - figure.model).sum() * width + 1.0 - figure.model.sum() * width)
            assert histograms.metrics[f"tv_c{k}_{name}"] == pytest.approx(direct)


def test_the_sampling_distance_is_that_of_gaussian_samples(histograms):
    """Against simulated counts; the formula's normal approximation of binomials has an error of a few per cent."""
    simulated = []
    for figure in histograms.figures:
        mass = figure.model * (figure.x[1] - figure.x[0])
        counts = rng().multinomial(1000, np.append(mass, 1.0 - mass.sum()), size=400)[:, :-1]
        simulated.append(0.5 * np.abs(counts / 1000 - mass).sum(axis=1).mean())
    assert histograms.metrics["tv_sampling"] == pytest.approx(np.mean(simulated), rel=0.05)


@pytest.mark.parametrize(
    ("study", "message"),
    [
        (lambda prior: Temperature(Smooth()), "implicit"), (lambda prior: TreeBalance(Smooth()), "implicit"),
        (lambda prior: Temperature(prior, clip="no_such_clip"), "no_such_clip"),
        (lambda prior: Temperature(prior, clip=prior.windows.clips[0], frame=3), "between 10 and"),
        (lambda prior: Temperature(prior, betas=(0.1, 0.0)), "betas"),
        (lambda prior: CoefficientHistograms(prior, components=(0,)), "components"),
        *((lambda prior, each=each: ImputeGaps(fractions=each), "fractions") for each in ((), (0.0,), (0.2, 1.0))),
    ],
)  # fmt: skip
def test_bad_input_of_a_study_is_rejected(prior, study, message):
    with pytest.raises(InputError, match=message):
        study(prior).run(rng())
