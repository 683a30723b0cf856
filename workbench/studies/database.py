"""What paper C's database gives back for a probe: draws at several temperatures, and how their coefficients spread."""

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
    """Windows to search for, and a prior whose database does not hold the clips that they come from.

    coefficients: (K, b), whitened; the first probe is the one that is shown. truth: the row after it in its clip.
    shown: its clip and frame, in words.
    """

    prior: Implicit
    coefficients: FloatArray
    truth: int
    shown: str


def left_out_probes(
    prior: Prior, clip: str | None, frame: int | None, n_probes: int, rng: np.random.Generator
) -> _Probes:
    """Take probes from the prior's own database, of which their clips, at most a quarter of all, are then left out.

    An entry that is its own probe would be all that is drawn at a low temperature, and its neighbours in time nearly
    so; leaving the clip out asks what a filter asks, for somebody else's or another take's motion. The components are
    still those of the whole database. clip, frame: the window shown, which ends at that frame of that clip; a random
    one where None. Raises InputError for a prior without a database, a clip or frame that it does not hold, and a
    database of a single clip.
    """
    if not isinstance(prior, Implicit):
        raise InputError("study: expected an implicit prior, such as prior=implicit")
    windows = prior.windows
    if len(windows.clips) < 2:
        raise InputError("study: expected a database of two clips or more, found one: probes come from clips left out")
    first = _shown_window(windows, clip, frame, rng)
    n_others = min(n_probes, max(1, len(windows.clips) // 4)) - 1
    others = rng.choice(np.delete(np.arange(len(windows.clips)), windows.clip_of[first]), n_others, replace=False)
    left_out = np.isin(windows.clip_of, [windows.clip_of[first], *others])
    inside = np.setdiff1d(np.flatnonzero(left_out), first)
    entries = np.append(first, rng.choice(inside, min(n_probes - 1, len(inside)), replace=False))
    chosen, end = windows.clip_of[first], windows.ends[first]
    return _Probes(
        prior=prior.only(~left_out),
        coefficients=windows.coefficients[entries].astype(np.float64),
        truth=int(end + 1),
        shown=f"frame {end - windows.firsts[chosen] + 1} of {windows.clips[chosen]} ({windows.activities[chosen]})",
    )


class Temperature:
    """Draws for one probe at four temperatures, and the searches' fidelity against temperature (paper C, fig. 3).

    As in the paper the poses after the windows drawn are shown, here with the pose that truly followed the probe.
    clip, frame: of the probe shown, see `left_out_probes`. betas: temperatures shown. n_draws: at each of them.
    n_probes: windows over which the fidelity is averaged.

    Metrics, at the prior's own temperature: tv_sign_tree, tv_search (total variation to the exact p(c_i | c_t) of the
    paper's tree and of our search), visited_pct (entries whose distance our search computes, %), distance_sign_tree,
    distance_search and distance_exact (median squared whitened distance from probe to draw).
    """

    def __init__(
        self, prior: Prior, *, clip: str | None = None, frame: int | None = None,
        betas: Sequence[float] = (0.01, 0.1, 1.0, 10.0), n_draws: int = 10, n_probes: int = 20,
    ) -> None:  # fmt: skip
        if not betas or min(betas) <= 0.0 or min(n_draws, n_probes) < 1:
            raise InputError("study: expected temperatures above zero, and one draw and probe or more")
        self.prior, self.clip, self.frame = prior, clip, frame
        self.betas, self.n_draws, self.n_probes = betas, n_draws, n_probes

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Draw, compare with the exact distribution, and say what is to be seen."""
        probes = left_out_probes(self.prior, self.clip, self.frame, self.n_probes, rng)
        sticks = [self._sticks(probes, name, beta, rng) for name in SEARCHES for beta in self.betas]
        scanned = np.unique([*SCANNED_BETAS, probes.prior.beta])
        found = {name: _fidelities(probes, name, scanned, rng) for name in SEARCHES}
        here = int(np.searchsorted(scanned, probes.prior.beta))
        tree, ours = found["sign_tree"][here], found["exact"][here]
        metrics = {
            "tv_sign_tree": tree.total_variation, "tv_search": ours.total_variation,
            "visited_pct": 100.0 * ours.visited, "distance_sign_tree": tree.distance,
            "distance_search": ours.distance, "distance_exact": ours.exact_distance,
        }  # fmt: skip
        return StudyResult(metrics, (*sticks, *_fidelity_curves(probes, scanned, found, rng)), self._note(probes))

    def _sticks(self, probes: _Probes, name: str, beta: float, rng: np.random.Generator) -> Sticks:
        windows = probes.prior.windows
        entries = probes.prior.searching(name, beta).draw(np.repeat(probes.coefficients[:1], self.n_draws, axis=0), rng)
        skeleton = person_skeleton(from_height(HEIGHT_M))
        poses = _poses(windows, np.append(windows.ends[entries] + 1, probes.truth))
        shades = np.append(np.full(self.n_draws, 0.25), 1.0)
        return Sticks(f"draws/{SEARCHES[name]}, β = {beta:g}", joints(skeleton, poses), skeleton.parents, shades)

    def _note(self, probes: _Probes) -> str:
        return (
            f"Paper C, fig. 3: the poses after {self.n_draws} windows drawn for one probe at each temperature β (dark) "
            f"and the pose that followed the probe (light), {probes.shown}, whose clip is not in the database. Above "
            "the paper's sign tree, below our search, which draws with the exact odds: cold draws resemble the probe, "
            "hot ones anything. The second page compares both searches with the exact distribution, over "
            f"{len(probes.coefficients)} probes from clips left out; the mark is the prior's own β = "
            f"{probes.prior.beta:g}."
        )


class CoefficientHistograms:
    """Coefficients of many windows drawn for one probe, beside the independent Gaussians (paper C, fig. 4).

    The Gaussian is the generative model of eq. 2 along one component: c_i,l ~ N(c_t,l, β σ_l²), centred at the probe's
    coefficient. It leaves out that windows are drawn from what was recorded, and that the components depend on each
    other. clip, frame: of the probe, see `left_out_probes`. components: counted from 1; those the database does not
    have are left out, which is logged and noted.

    Metrics: tv_c<l>_sign_tree and tv_c<l>_search, the total variation between the histogram and the Gaussian, 0 to 1;
    tv_sampling, what n_draws draws from the Gaussian itself are expected to have, the mean over the components.
    """

    def __init__(
        self, prior: Prior, *, clip: str | None = None, frame: int | None = None, beta: float = 1.0,
        n_draws: int = 1000, components: Sequence[int] = (3, 7, 11, 15), n_bins: int = 30,
    ) -> None:  # fmt: skip
        if not beta > 0.0 or min(n_draws, n_bins, *components) < 1:
            raise InputError("study: expected beta above 0, and draws, bins and components from 1")
        self.prior, self.clip, self.frame, self.beta = prior, clip, frame, beta
        self.n_draws, self.components, self.n_bins = n_draws, components, n_bins

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Draw with both searches and count."""
        probes = left_out_probes(self.prior, self.clip, self.frame, 1, rng)
        probe = probes.coefficients[0]
        components = [k for k in self.components if k <= len(probe)]
        if missing := [k for k in self.components if k > len(probe)]:
            log.warning("study: the database has %d components; left out: %s", len(probe), missing)
        repeated = np.repeat(probe[None], self.n_draws, axis=0)
        draws = {
            name: probes.prior.windows.coefficients[probes.prior.searching(name, self.beta).draw(repeated, rng)]
            for name in SEARCHES
        }
        both = np.concatenate(list(draws.values()))
        figures: list[Bars] = []
        metrics: dict[str, float] = {}
        sampling = []
        for name, label in SEARCHES.items():
            for k in components:
                centre, deviation, drawn = probe[k - 1], np.sqrt(self.beta), both[:, k - 1]
                low, high = min(centre - 3.5 * deviation, drawn.min()), max(centre + 3.5 * deviation, drawn.max())
                edges = np.linspace(low, high + 1e-9, self.n_bins + 1)
                mass = np.histogram(draws[name][:, k - 1], edges)[0] / self.n_draws
                model, width = np.diff(scipy.special.ndtr((edges - centre) / deviation)), edges[1] - edges[0]
                middles = 0.5 * (edges[1:] + edges[:-1])
                figures.append(Bars(f"coefficients/{label}, c{k}", middles, mass / width, f"c{k} (σ)", model / width))
                outside = 1.0 - model.sum()  # the Gaussian's tails, where nothing was drawn
                metrics[f"tv_c{k}_{METRIC_NAMES[name]}"] = 0.5 * float(np.abs(mass - model).sum() + outside)
                sampling.append(0.5 * float(np.sqrt(2.0 * model * (1.0 - model) / (np.pi * self.n_draws)).sum()))
        metrics["tv_sampling"] = float(np.mean(sampling)) if sampling else float("nan")
        return StudyResult(metrics, tuple(figures), self._note(probes, missing))

    def _note(self, probes: _Probes, missing: Sequence[int]) -> str:
        lacking = f" The database has no component {', '.join(map(str, missing))}." if missing else ""
        return (
            f"Paper C, fig. 4: coefficients of {self.n_draws} windows drawn at β = {self.beta:g} for one probe, "
            f"{probes.shown}, whose clip is not in the database, in units of each component's σ. Bars: draws by the "
            "paper's sign tree, above, and with the exact odds, below. Line: the independent Gaussian N(c_t, β σ²) "
            "about the probe. The exact odds are those of the Gaussian times the density of what was recorded, which "
            f"makes the histograms narrower and moves them to where there are windows.{lacking}"
        )


def _shown_window(windows: Windows, clip: str | None, frame: int | None, rng: np.random.Generator) -> int:
    """Find the index of the window that ends at a frame of a clip."""
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
    probes: _Probes, betas: FloatArray, found: dict[str, list[Fidelity]], rng: np.random.Generator
) -> tuple[Curves, ...]:
    x = np.log10(betas)
    mark = {"the prior's": float(np.log10(probes.prior.beta))}

    def curves(name: str, y_name: str, lines: dict[str, FloatArray]) -> Curves:
        return Curves(f"fidelity/{name}", x, lines, "log₁₀ β", y_name, mark)

    def over(field: str, factor: float = 1.0) -> dict[str, FloatArray]:
        return {SEARCHES[name]: factor * np.array([getattr(at, field) for at in each]) for name, each in found.items()}

    anything = rng.integers(len(probes.prior.windows), size=(len(probes.coefficients), 100))
    blind = ((probes.prior.windows.coefficients[anything] - probes.coefficients[:, None]) ** 2).sum(axis=2)
    distance = over("distance") | {"exact odds": over("exact_distance")[SEARCHES["exact"]]}
    distance["blind chance"] = np.full(len(x), float(np.median(blind)))
    return (
        curves("total variation to the exact odds", "total variation", over("total_variation")),
        curves("entries visited", "% of the database", over("visited", 100.0)),
        curves("from probe to draw", "median |c − cₜ|²  (σ²)", distance),
    )


def _poses(windows: Windows, rows: IntArray) -> FloatArray:
    """The poses (N, P) that rows stand for, at the origin; angles that are not modelled are zero."""
    poses = np.zeros((len(rows), len(POSE_NAMES)))
    poses[:, [POSE_NAMES.index(name) for name in windows.angles]] = windows.rows[rows, : len(windows.angles)]
    if windows.include_root:
        poses[:, [POSE_NAMES.index("root_pitch"), POSE_NAMES.index("root_roll")]] = windows.rows[rows, -2:]
    return poses
