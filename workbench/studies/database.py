"""Sampling from paper C's database for a probe, at several temperatures, and the distribution of its coefficients."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.core.prior import Prior
from workbench.core.study import Bars, Curves, Sticks, StudyResult
from workbench.motion.formats.names import clip_name
from workbench.motion.models.windows import Windows
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_tree import Fidelity, fidelity
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

SEARCHES = {"sign_tree": "sign tree", "exact": "our search"}
METRIC_NAMES = {"sign_tree": "sign_tree", "exact": "search"}
SCANNED_BETAS = np.logspace(-2.5, 1.0, 8)
HEIGHT_M = 1.75
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Probes:
    """Windows to search for, and a prior whose database excludes their clips.

    coefficients: (K, b), whitened; the first probe is the one displayed. truth: the row after it in its clip.
    description: its clip and frame, for the note.
    """

    prior: Implicit
    coefficients: FloatArray
    truth: int
    description: str


def held_out_probes(
    prior: Prior, clip: str | None, frame: int | None, n_probes: int, rng: np.random.Generator
) -> _Probes:
    """Return probes from the prior's database, and the prior without their clips, at most a quarter of all.

    At a low temperature a search in the whole database would return only the probe itself and its neighbours in time;
    without the clip it is the search of a filter, for another subject's or another recording's motion. The components
    are still those of the whole database.

    Parameters
    ----------
    prior : an implicit one.
    clip, frame : of the window displayed, which ends at that frame of that clip; None: random.
    n_probes : maximum number of probes.
    rng : of the choice of probes.

    Raises
    ------
    InputError : the prior has no database, or one of a single clip, or does not contain the clip or frame.
    """
    if not isinstance(prior, Implicit):
        raise InputError("study: expected an implicit prior, such as prior=implicit")
    windows = prior.windows
    if len(windows.clips) < 2:
        raise InputError(
            "study: expected a database of at least two clips, found one, as the clips of probes are excluded"
        )
    first = _shown_window(windows, clip, frame, rng)
    n_others = min(n_probes, max(1, len(windows.clips) // 4)) - 1
    others = rng.choice(np.delete(np.arange(len(windows.clips)), windows.clip_of[first]), n_others, replace=False)
    excluded = np.isin(windows.clip_of, [windows.clip_of[first], *others])
    inside = np.setdiff1d(np.flatnonzero(excluded), first)
    entries = np.append(first, rng.choice(inside, min(n_probes - 1, len(inside)), replace=False))
    chosen, end = windows.clip_of[first], windows.ends[first]
    frame = end - windows.firsts[chosen] + 1
    return _Probes(
        prior=prior.only(~excluded),
        coefficients=windows.coefficients[entries].astype(np.float64),
        truth=int(end + 1),
        description=f"frame {frame} of {windows.clips[chosen]} ({windows.activities[chosen]})",
    )


class Temperature:
    """Samples for one probe at four temperatures, and the searches' fidelity over temperature (paper C, fig. 3).

    As in the paper, the poses after the sampled windows are displayed, here with the true pose after the probe. clip,
    frame: of the probe displayed, see `held_out_probes`. betas: temperatures displayed. n_draws: samples at each of
    them. n_probes: windows over which the fidelity is averaged.

    Metrics, at the prior's temperature: tv_sign_tree, tv_search (total variation to the exact p(c_i | c_t) of the
    paper's tree and of our search), visited_pct (entries whose distance our search computes, %), distance_sign_tree,
    distance_search and distance_exact (median squared whitened distance from probe to sample).
    """

    def __init__(
        self, prior: Prior, *, clip: str | None = None, frame: int | None = None,
        betas: Sequence[float] = (0.01, 0.1, 1.0, 10.0), n_draws: int = 10, n_probes: int = 20,
    ) -> None:  # fmt: skip
        if not betas or min(betas) <= 0.0 or min(n_draws, n_probes) < 1:
            raise InputError("study: expected betas above 0, and n_draws and n_probes of at least 1")
        self.prior, self.clip, self.frame = prior, clip, frame
        self.betas, self.n_draws, self.n_probes = betas, n_draws, n_probes

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Sample, and compare with the exact distribution."""
        probes = held_out_probes(self.prior, self.clip, self.frame, self.n_probes, rng)
        sticks = [self._sticks(probes, name, beta, rng) for name in SEARCHES for beta in self.betas]
        scanned = np.unique([*SCANNED_BETAS, probes.prior.beta])
        fidelities = {name: _fidelities(probes, name, scanned, rng) for name in SEARCHES}
        here = int(np.searchsorted(scanned, probes.prior.beta))
        tree, ours = fidelities["sign_tree"][here], fidelities["exact"][here]
        metrics = {
            "tv_sign_tree": tree.total_variation, "tv_search": ours.total_variation,
            "visited_pct": 100.0 * ours.visited, "distance_sign_tree": tree.distance,
            "distance_search": ours.distance, "distance_exact": ours.exact_distance,
        }  # fmt: skip
        curves = _fidelity_curves(probes, scanned, fidelities, rng)
        return StudyResult(metrics, (*sticks, *curves), self._note(probes))

    def _sticks(self, probes: _Probes, name: str, beta: float, rng: np.random.Generator) -> Sticks:
        windows = probes.prior.windows
        entries = probes.prior.searching(name, beta).draw(np.repeat(probes.coefficients[:1], self.n_draws, axis=0), rng)
        skeleton = person_skeleton(from_height(HEIGHT_M))
        poses = _poses(windows, np.append(windows.ends[entries] + 1, probes.truth))
        shades = np.append(np.full(self.n_draws, 0.25), 1.0)
        return Sticks(f"draws/{SEARCHES[name]}, β = {beta:g}", joints(skeleton, poses), skeleton.parents, shades)

    def _note(self, probes: _Probes) -> str:
        return (
            f"**Paper C, fig. 3.** The poses after {self.n_draws} windows sampled for one probe at each temperature β "
            f"(dark) and the true pose after the probe (light), {probes.description}, whose clip is not in the "
            "database. Above: the paper's sign tree; below: our search, which samples with the exact probabilities. "
            "Samples at low β resemble the probe, those at high β are arbitrary. The second page compares both "
            f"searches with the exact distribution, over {len(probes.coefficients)} probes from held-out clips; the "
            f"mark is the prior's β = {probes.prior.beta:g}."
        )


class CoefficientHistograms:
    """Coefficients of many windows sampled for one probe, compared with independent Gaussians (paper C, fig. 4).

    The Gaussian is the generative model of eq. 2 along one component: c_i,l ~ N(c_t,l, β σ_l²), centred at the probe's
    coefficient. It ignores that windows are sampled from recorded ones, and that the components are dependent. clip,
    frame: of the probe, see `held_out_probes`. components: counted from 1; those the database does not have are
    omitted, with a warning and in the note.

    Metrics: tv_c<l>_sign_tree and tv_c<l>_search, the total variation between the histogram and the Gaussian, 0 to 1;
    tv_sampling, its expectation for n_draws samples from the Gaussian itself, the mean over the components.
    """

    def __init__(
        self, prior: Prior, *, clip: str | None = None, frame: int | None = None, beta: float = 1.0,
        n_draws: int = 1000, components: Sequence[int] = (3, 7, 11, 15), n_bins: int = 30,
    ) -> None:  # fmt: skip
        if not beta > 0.0 or min(n_draws, n_bins, *components) < 1:
            raise InputError("study: expected beta above 0, and n_draws, n_bins and components of at least 1")
        self.prior, self.clip, self.frame, self.beta = prior, clip, frame, beta
        self.n_draws, self.components, self.n_bins = n_draws, components, n_bins

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Sample with both searches and compute histograms."""
        probes = held_out_probes(self.prior, self.clip, self.frame, 1, rng)
        probe = probes.coefficients[0]
        components = [k for k in self.components if k <= len(probe)]
        if missing := [k for k in self.components if k > len(probe)]:
            log.warning("study: the database has %d components; omitted: %s", len(probe), missing)
        repeated = np.repeat(probe[None], self.n_draws, axis=0)
        draws = {
            name: probes.prior.windows.coefficients[probes.prior.searching(name, self.beta).draw(repeated, rng)]
            for name in SEARCHES
        }
        pooled = np.concatenate(list(draws.values()))
        figures: list[Bars] = []
        metrics: dict[str, float] = {}
        sampling = []
        for name, label in SEARCHES.items():
            for k in components:
                centre, deviation, samples = probe[k - 1], np.sqrt(self.beta), pooled[:, k - 1]
                low, high = min(centre - 3.5 * deviation, samples.min()), max(centre + 3.5 * deviation, samples.max())
                edges = np.linspace(low, high + 1e-9, self.n_bins + 1)
                mass = np.histogram(draws[name][:, k - 1], edges)[0] / self.n_draws
                model, width = np.diff(scipy.special.ndtr((edges - centre) / deviation)), edges[1] - edges[0]
                middles = 0.5 * (edges[1:] + edges[:-1])
                figures.append(Bars(f"coefficients/{label}, c{k}", middles, mass / width, f"c{k} (σ)", model / width))
                outside = 1.0 - model.sum()  # the Gaussian's tails, without samples
                metrics[f"tv_c{k}_{METRIC_NAMES[name]}"] = 0.5 * float(np.abs(mass - model).sum() + outside)
                sampling.append(0.5 * float(np.sqrt(2.0 * model * (1.0 - model) / (np.pi * self.n_draws)).sum()))
        metrics["tv_sampling"] = float(np.mean(sampling)) if sampling else float("nan")
        return StudyResult(metrics, tuple(figures), self._note(probes, missing))

    def _note(self, probes: _Probes, missing: Sequence[int]) -> str:
        omitted = f" The database has no component {', '.join(map(str, missing))}." if missing else ""
        return (
            f"**Paper C, fig. 4.** Coefficients of {self.n_draws} windows sampled at β = {self.beta:g} for one probe, "
            f"{probes.description}, whose clip is not in the database, in units of each component's σ. Bars: samples "
            "by the paper's sign tree, above, and with the exact probabilities, below. Line: the independent Gaussian "
            "N(c_t, β σ²) about the probe. The exact probabilities are those of the Gaussian times the density of the "
            f"recorded windows, which narrows the histograms and shifts them to where there are windows.{omitted}"
        )


def _shown_window(windows: Windows, clip: str | None, frame: int | None, rng: np.random.Generator) -> int:
    """Return the index of the window that ends at a frame of a clip."""
    if clip is None:
        inside = np.arange(len(windows))
    else:
        if clip_name(clip) not in windows.clips:
            raise InputError(f"study: no clip called {clip_name(clip)!r} in the database of {len(windows.clips)} clips")
        inside = np.flatnonzero(windows.clip_of == windows.clips.index(clip_name(clip)))
    if frame is None:
        return int(rng.choice(inside))
    # a clip's first row is its second frame, as the first has no velocity
    frames = windows.ends[inside] - windows.firsts[windows.clip_of[inside]] + 1
    if not (frames == frame).any():
        raise InputError(
            f"study: frame must lie between {frames.min()} and {frames.max()} for windows of "
            f"{windows.window_frames} frames and a pose after them, found {frame}"
        )
    return int(rng.choice(inside[frames == frame]))


def _fidelities(probes: _Probes, name: str, betas: FloatArray, rng: np.random.Generator) -> list[Fidelity]:
    prior = probes.prior.searching(name, probes.prior.beta)
    return [
        fidelity(
            prior.tree, prior.windows.coefficients, probes.coefficients, beta, rng,
            leaf=prior.leaf, tail_probability=prior.tail_probability,
        )
        for beta in tqdm(betas, desc=f"fidelity of the {SEARCHES[name]}", unit="β", disable=None)
    ]  # fmt: skip


def _fidelity_curves(
    probes: _Probes, betas: FloatArray, fidelities: dict[str, list[Fidelity]], rng: np.random.Generator
) -> tuple[Curves, ...]:
    x = np.log10(betas)
    marks = {"the prior's": float(np.log10(probes.prior.beta))}

    def curves(name: str, y_name: str, lines: dict[str, FloatArray]) -> Curves:
        return Curves(f"fidelity/{name}", x, lines, "log₁₀ β", y_name, marks)

    def values(field: str, factor: float = 1.0) -> dict[str, FloatArray]:
        return {SEARCHES[k]: factor * np.array([getattr(at, field) for at in each]) for k, each in fidelities.items()}

    random_entries = rng.integers(len(probes.prior.windows), size=(len(probes.coefficients), 100))
    chance = ((probes.prior.windows.coefficients[random_entries] - probes.coefficients[:, None]) ** 2).sum(axis=2)
    distance = values("distance") | {"exact odds": values("exact_distance")[SEARCHES["exact"]]}
    distance["blind chance"] = np.full(len(x), float(np.median(chance)))
    return (
        curves("total variation to the exact odds", "total variation", values("total_variation")),
        curves("entries visited", "% of the database", values("visited", 100.0)),
        curves("from probe to draw", "median |c − cₜ|²  (σ²)", distance),
    )


def _poses(windows: Windows, rows: IntArray) -> FloatArray:
    """Return the poses (N, P) of rows, at the origin; angles that are not modelled are zero."""
    poses = np.zeros((len(rows), len(POSE_NAMES)))
    poses[:, [POSE_NAMES.index(name) for name in windows.angles]] = windows.rows[rows, : len(windows.angles)]
    if windows.include_root:
        poses[:, [POSE_NAMES.index("root_pitch"), POSE_NAMES.index("root_roll")]] = windows.rows[rows, -2:]
    return poses
