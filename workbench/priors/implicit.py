"""The implicit prior of paper C: a database of motions, searched at random with the right odds."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, LOOKAHEAD_WINDOWS, Traits, offering
from workbench.core.keys import records_arguments
from workbench.core.prior import PriorCapabilities
from workbench.core.side_information import FIXED_OTHER_JOINTS
from workbench.core.state_space import StateSpace
from workbench.motion.models.windows import Windows, pose_rows
from workbench.priors.density import REFERENCE_RATE_HZ, whole_frames
from workbench.priors.implicit_density import ImplicitDensity
from workbench.priors.implicit_prediction import WindowPrediction
from workbench.priors.implicit_search import KdTree, group_equal, kd_tree, search
from workbench.priors.implicit_tree import LEAVES, Tree, draw, log_importance, median_tree, sign_tree
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray
from workbench.utils.errors import InputError

TREES: dict[str, Callable[[Float32Array], KdTree | Tree]] = {
    "exact": kd_tree, "sign_tree": sign_tree, "median_tree": median_tree,
}  # fmt: skip
"""How the data structure of every search is built."""
PREDICTIONS = ("copy", "increment", "blend")
START_BETA = 0.05  # temperature of the search for windows to start with
START_POSITION, START_ROTATION, START_ANGLES = 0.01, 0.02, 0.02  # deviations of the first poses, m and rad
MOST_EXAMPLES = 2000


@records_arguments
class Implicit:
    """The implicit prior over states {pose, c, what the last d − 1 rows add to the next coefficients} (C, section 4).

    The state's first 25 columns are the pose; then come the whitened coefficients c_t of the particle's own last d
    frames and the rest of `Windows.memory`. A step searches an entry i with probability p(Ψ_i | Φ_t), predicts by what
    follows it, and slides the window on by that.

    search: "exact" draws from p(c_i | c_t) but for the part `tail_probability` of its mass, once for all particles with the same
    coefficients; "sign_tree" is the paper's tree, "median_tree" the balanced one; `leaf`, "gaussian" or "uniform", is
    how those draw in a leaf. beta: temperature. reweight: `propose` weighs a tree's draws by p(c_i | c_t) over the
    tree's odds (C, footnote 3), at a scan per parent.

    prediction: "copy" takes the angles of the pose after the window (φ_{t+1} = ψ_{i+1} + noise); "increment" adds the
    database's change to the particle's own angles; "blend" does that and draws the angles towards the database's by the
    part `blend_rate` of their difference a frame. The root's place and heading always move by the database's increments in
    the body's own heading frame; its pitch and roll are treated as angles.

    sigma_position: m, forward, sideways, up. sigma_rotation: rad, heading, pitch, roll. sigma_angles: rad, one for all
    modelled angles or one for each. All per frame at 30 Hz; they grow with the square root of the time between rows.
    Angles that are not modelled, and the root where it is not, stay as they start. inertia: part of the noise that
    enters the velocities in the particle's window too: with 0 the onset of a motion is followed late. Deviation:
    nothing keeps the angles inside the skeleton's limits but the database."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density where the search is exact, and that what the database does not move stays."""
        density = (DENSITY,) if keys.get("search", "exact") == "exact" else ()
        moves_all = list(keys.get("angles") or ["body"]) == ["body"] and keys.get("root", True)
        return offering(*density, LOOKAHEAD_WINDOWS, given=() if moves_all else (FIXED_OTHER_JOINTS,))

    def __init__(
        self, windows: Windows, *,
        search: str = "exact", beta: float = 0.05, tail_probability: float = 0.01, leaf: str = "gaussian",
        importance_correction: bool = False, prediction: str = "blend", blend_rate: float = 0.1, velocity_noise_fraction: float = 1.0,
        sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.005),
        sigma_rotation: tuple[float, float, float] = (0.02, 0.01, 0.01), sigma_angles: float | Sequence[float] = 0.02,
    ) -> None:  # fmt: skip
        for name, given, known in (
            ("search", search, tuple(TREES)), ("prediction", prediction, PREDICTIONS), ("leaf", leaf, LEAVES),
        ):  # fmt: skip
            if given not in known:
                raise InputError(f"prior: {name} must be one of {', '.join(known)}, found {given!r}")
        if not (beta > 0.0 and 0.0 < tail_probability < 1.0):
            raise InputError(f"prior: expected beta > 0 and 0 < tail_probability < 1, found {beta}, {tail_probability}")
        if not (0.0 <= blend_rate <= 1.0 and 0.0 <= velocity_noise_fraction <= 1.0):
            raise InputError(
                f"prior: blend_rate and velocity_noise_fraction must lie between 0 and 1, found {blend_rate} and {velocity_noise_fraction}"
            )
        if importance_correction and search == "exact":
            raise InputError("prior: importance_correction is for a tree's draws; the exact search's need no weights")
        self.windows, self.importance_correction = windows, importance_correction
        moved = (*POSE_NAMES[:N_ROOT], *windows.angles) if windows.include_root else windows.angles
        self.parameters = tuple(name for name in POSE_NAMES if name in moved)
        self.search, self.leaf, self.beta, self.tail_probability = search, leaf, beta, tail_probability
        blend_rate = {"copy": 1.0, "increment": 0.0, "blend": blend_rate}[prediction]
        noise = self._deviations(sigma_position, sigma_rotation, sigma_angles)
        self.prediction = WindowPrediction(windows, blend_rate, velocity_noise_fraction, noise)
        self._start_noise = self._deviations((START_POSITION,) * 3, (START_ROTATION,) * 3, START_ANGLES)
        b = len(windows.sigmas)
        ahead = tuple(f"c{k + 1}_ahead{j}" for j in range(1, windows.window_frames) for k in range(b))
        self.space = StateSpace.of({
            "root_position": (POSE_NAMES[:3], "m"), "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
            "angles": (POSE_NAMES[N_ROOT:], "rad"),
            "coefficients": (tuple(f"c{k + 1}" for k in range(b)), "σ"), "ahead": (ahead, "σ"),
        })  # fmt: skip
        self.tree = TREES[search](windows.coefficients)
        self._density = self._of_search()

    @property
    def capabilities(self) -> PriorCapabilities:
        """Its density, where the search is exact, and poses of its database."""
        return PriorCapabilities(density=self._density, examples=self._examples)

    def searching(self, search: str, beta: float) -> "Implicit":
        """Exchange the prior's search and temperature."""
        return self._exchanged(self.windows, search, beta)

    def only(self, kept: BoolArray) -> "Implicit":
        """Restrict the prior to drawing from the windows kept (n,) alone, with the odds they have among themselves."""
        return self._exchanged(self.windows.only(kept), self.search, self.beta)

    def _exchanged(self, windows: Windows, search: str, beta: float) -> "Implicit":
        other = copy(self)
        other.windows, other.search, other.beta = windows, search, beta
        other.importance_correction = self.importance_correction and search != "exact"
        other.prediction = replace(self.prediction, windows=windows)
        if search != self.search or windows is not self.windows:
            other.tree = TREES[search](windows.coefficients)
        other._density = other._of_search()
        return other

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) at a starting pose (P,) with noise, and with the windows of entries that end near it.

        As in C, section 6, by a linear search: an entry counts exp(−½ Σ_a (ψ_a − pose_a)² / (START_BETA · s_a²)) over
        the modelled angles and, where the root is modelled, its pitch and roll, s_a being the database's deviations.
        """
        ours, theirs = self.prediction.absolute
        rows = self.windows.rows[self.windows.ends][:, theirs]
        squares = (((rows - pose[ours]) / self.windows.scales[theirs]) ** 2).sum(axis=1, dtype=np.float64)
        odds = np.exp((squares.min() - squares) / (2.0 * START_BETA)).cumsum()
        entries = np.searchsorted(odds, rng.random(n) * odds[-1], side="right").clip(max=len(odds) - 1)
        poses = pose + self._start_noise * rng.standard_normal((n, len(POSE_NAMES)))
        return np.concatenate([poses, self.windows.memory(self.windows.window_rows(entries))], axis=1)

    def start_after(self, poses: FloatArray, n: int) -> FloatArray:
        """N equal states (N, D) that have just gone through poses (d + 1, P) at the library's rate, without noise."""
        rows = pose_rows(poses, self.windows.rate_hz, self.windows.angles, self.windows.include_root)
        memory = self.windows.memory(rows[None, ::-1][:, : self.windows.window_frames])
        return np.repeat(np.concatenate([poses[-1:], memory], axis=1), n, axis=0)

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later.

        Raises InputError when dt_s is not a whole number of the library's frames (to 5 % of one).
        """
        return self._move(state, dt_s, rng, weigh=False)[0]

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """The draws (N, D) of `sample_transition` and their log weights (N,), which are zero without `importance_correction`."""
        return self._move(state, dt_s, rng, weigh=self.importance_correction)

    def _move(
        self, state: FloatArray, dt_s: float, rng: np.random.Generator, *, weigh: bool
    ) -> tuple[FloatArray, FloatArray]:
        log_weights = np.zeros(len(state))
        for _ in range(self.rows_in(dt_s)):
            probes = state[:, self.space.slices["coefficients"]]
            entries = self.draw(probes, rng)
            if weigh:
                log_weights += self._log_importance(probes, entries)
            state = self.predict(state, entries, rng.standard_normal((len(state), len(POSE_NAMES))))
        return state, log_weights

    def rows_in(self, dt_s: float) -> int:
        """The library's frames in dt_s seconds; raises InputError unless it is a whole number (to 5 % of one)."""
        if (frames := whole_frames(dt_s, self.windows.rate_hz)) is None:
            raise InputError(
                f"prior: frames {dt_s:.4g} s apart are not a whole number of steps of an implicit prior learned at "
                f"{self.windows.rate_hz:g} Hz; learn it at a rate that is a multiple of the video's"
            )
        return frames

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        return np.ascontiguousarray(state[:, : len(POSE_NAMES)])

    def draw(self, probes: FloatArray, rng: np.random.Generator) -> IntArray:
        """An entry (N,) for each probe (N, b), whitened coefficients."""
        if isinstance(self.tree, Tree):
            uniforms = rng.random((len(probes), self.tree.depth + 1))
            return draw(self.tree, probes, self.beta, uniforms, self.leaf)
        uniforms = rng.random(len(probes))
        order, firsts = group_equal(probes)
        counts = np.diff(np.append(firsts, len(probes)))
        entries = np.empty(len(probes), dtype=np.int64)
        found = search(self.tree, probes[order[firsts]], counts, self.beta, uniforms[order], self.tail_probability)
        entries[order] = found.entries
        return entries

    def _log_importance(self, probes: FloatArray, entries: IntArray) -> FloatArray:
        assert isinstance(self.tree, Tree)  # __init__ saw to it
        order, firsts = group_equal(probes)
        log_weights = np.empty(len(probes))
        for own in np.split(order, firsts[1:]):
            log_weights[own] = log_importance(self.tree, probes[own[0]], entries[own], self.beta, self.leaf)
        return log_weights

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """The states (N, D) one library frame later when entries (N,) were drawn; noise: (N, P) standard normal."""
        return self.prediction.predict(state, entries, noise)

    def _examples(self) -> FloatArray:
        """Poses (n, P) at the windows' ends, evenly thinned to MOST_EXAMPLES; root at the origin, heading zero."""
        n = len(self.windows)
        chosen = np.linspace(0, n - 1, min(n, MOST_EXAMPLES)).round().astype(np.int64)
        ours, theirs = self.prediction.absolute
        poses = np.zeros((len(chosen), len(POSE_NAMES)))
        poses[:, ours] = self.windows.rows[self.windows.ends[chosen]][:, theirs]
        return poses

    def _of_search(self) -> ImplicitDensity | None:
        """The density of what the exact search draws; None for another search."""
        if isinstance(self.tree, KdTree):
            return ImplicitDensity(self.prediction, self.tree, self.beta, self.tail_probability)
        return None

    def _deviations(
        self, position: Sequence[float], rotation: Sequence[float], angles: float | Sequence[float]
    ) -> FloatArray:
        n_angles = len(self.windows.angles)
        for name, given, size in (
            ("sigma_position", position, 3), ("sigma_rotation", rotation, 3), ("sigma_angles", angles, n_angles),
        ):  # fmt: skip
            if np.shape(given) != (size,) and not (name == "sigma_angles" and np.ndim(given) == 0):
                raise InputError(f"prior: {name} must hold {size} numbers, found {np.size(given)}")
        deviations = np.zeros(len(POSE_NAMES))
        if self.windows.include_root:
            deviations[:N_ROOT] = (*position, *rotation)
        deviations[[POSE_NAMES.index(name) for name in self.windows.angles]] = angles
        return deviations * np.sqrt(REFERENCE_RATE_HZ / self.windows.rate_hz)
