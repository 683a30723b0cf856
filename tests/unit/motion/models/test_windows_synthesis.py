"""What windows know of their clips: kept on disk, checked, and used to leave windows out."""

import numpy as np
import pytest

from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit


@pytest.fixture(scope="module")
def motions():
    return builtin_motions(n_subjects=3)


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions)


def test_a_prior_of_some_windows_draws_those_only_with_their_odds(windows):
    kept = windows.clip_of != 1
    whole = Implicit(windows, beta=2.0, epsilon=1e-6)
    some = whole.only(kept)
    probes = np.repeat(windows.coefficients[[40]].astype(np.float64), 20000, axis=0)  # of the first clip
    from_whole, from_some = (prior.draw(probes, np.random.default_rng(0)) for prior in (whole, some))
    assert 1 not in some.windows.clip_of[from_some]
    assert 1 in windows.clip_of[from_whole]
    places = np.flatnonzero(kept)[from_some]
    conditional = np.bincount(from_whole, minlength=len(windows))[kept] / kept[from_whole].sum()
    seen = np.bincount(places, minlength=len(windows))[kept] / len(places)
    assert np.abs(seen - conditional).max() < 5 * np.sqrt(2 * conditional.max() / kept[from_whole].sum())


def test_another_search_has_its_own_tree_and_leaves_the_first_alone(windows):
    exact = Implicit(windows, beta=0.5)
    tree = exact.searching("sign_tree", 0.1)
    assert (tree.search, tree.beta, exact.search, exact.beta) == ("sign_tree", 0.1, "exact", 0.5)
    own = Implicit(windows, search="sign_tree", beta=0.1)
    probes = windows.coefficients[::7].astype(np.float64)
    assert (tree.draw(probes, np.random.default_rng(0)) == own.draw(probes, np.random.default_rng(0))).all()
