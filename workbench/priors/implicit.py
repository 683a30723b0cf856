"""Implicit prior of paper C: a motion database, sampled with probabilities that depend on the recent motion."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, LOOKAHEAD_WINDOWS, Traits, component_traits
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
"""Constructor of each search's data structure."""
PREDICTIONS = ("copy", "increment", "blend")
INITIAL_BETA = 0.05  # temperature of the search for initial windows
INITIAL_POSITION_STD, INITIAL_ROTATION_STD, INITIAL_ANGLE_STD = 0.01, 0.02, 0.02  # of the initial poses, m and rad
MAX_EXAMPLES = 2000


class Implicit:
    """The implicit prior over states {pose, c, contribution of the last d − 1 rows to the next coefficients} (C).

    Paper C, section 4. The state's first 25 columns are the pose. The others are the whitened coefficients c_t of the
    particle's last d frames and the rest of `Windows.memory`. A step samples an entry i with probability p(Ψ_i | Φ_t),
    predicts by the row that follows it, and appends that row to the particle's window.

    Root translation and heading always change by the database's increments in the body's heading frame; pitch and roll
    are treated as angles. Angles that are not modelled, and the root unless it is modelled, are constant. Deviation:
    no joint limits other than those of the database.

    Parameters
    ----------
    windows : the database.
    search : "exact" samples from p(c_i | c_t) without `tail_probability` of its mass, once for all particles with equal
        coefficients; "sign_tree" is the paper's tree, "median_tree" a balanced one.
    beta : temperature.
    tail_probability : probability mass that the exact search may omit.
    leaf : distribution in a leaf of a tree, "gaussian" or "uniform".
    importance_correction : `propose` weights a tree's samples by p(c_i | c_t) over their probability in the tree (C,
        footnote 3), with a linear scan per parent.
    prediction : "copy" takes the angles of the pose after the window (φ_{t+1} = ψ_{i+1} + noise); "increment" adds the
        database's change to the particle's angles; "blend" also reduces the difference to the database's angles.
    blend_rate : fraction of that difference that "blend" removes per frame.
    velocity_noise_fraction : fraction of the noise that enters the velocities in the particle's window; with 0 the
        onset of a motion is followed late.
    sigma_position, sigma_rotation, sigma_angles : noise per frame at 30 Hz, which grows with the square root of the row
        interval: m forward, sideways, up; rad of heading, pitch, roll; rad for all modelled angles or for each.

    Raises
    ------
    InputError : an unknown option, a value out of range, or the importance correction of an exact search.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density if the search is exact, and fixed other joints unless the database moves all."""
        density = (DENSITY,) if keys.get("search", "exact") == "exact" else ()
        moves_all = list(keys.get("angles") or ["body"]) == ["body"] and keys.get("root", True)
        return component_traits(*density, LOOKAHEAD_WINDOWS, assumptions=() if moves_all else (FIXED_OTHER_JOINTS,))

    def __init__(
        self, windows: Windows, *,
        search: str = "exact", beta: float = 0.05, tail_probability: float = 0.01, leaf: str = "gaussian",
        importance_correction: bool = False, prediction: str = "blend", blend_rate: float = 0.1,
        velocity_noise_fraction: float = 1.0,
        sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.005),
        sigma_rotation: tuple[float, float, float] = (0.02, 0.01, 0.01), sigma_angles: float | Sequence[float] = 0.02,
    ) -> None:  # fmt: skip
        for name, value, options in (
            ("search", search, tuple(TREES)), ("prediction", prediction, PREDICTIONS), ("leaf", leaf, LEAVES),
        ):  # fmt: skip
            if value not in options:
                raise InputError(f"prior: {name} must be one of {', '.join(options)}, found {value!r}")
        if not (beta > 0.0 and 0.0 < tail_probability < 1.0):
            raise InputError(f"prior: expected beta > 0 and 0 < tail_probability < 1, found {beta}, {tail_probability}")
        if not (0.0 <= blend_rate <= 1.0 and 0.0 <= velocity_noise_fraction <= 1.0):
            values = f"{blend_rate} and {velocity_noise_fraction}"
            raise InputError(f"prior: blend_rate and velocity_noise_fraction must be from 0 to 1, found {values}")
        if importance_correction and search == "exact":
            raise InputError(
                "prior: importance_correction requires a tree search; samples of the exact search need no weights"
            )
        self.windows, self.importance_correction = windows, importance_correction
        modelled = (*POSE_NAMES[:N_ROOT], *windows.angles) if windows.include_root else windows.angles
        self.parameters = tuple(name for name in POSE_NAMES if name in modelled)
        self.search, self.leaf, self.beta, self.tail_probability = search, leaf, beta, tail_probability
        blend_rate = {"copy": 1.0, "increment": 0.0, "blend": blend_rate}[prediction]
        noise = self._deviations(sigma_position, sigma_rotation, sigma_angles)
        noise *= np.sqrt(REFERENCE_RATE_HZ / windows.rate_hz)
        self.prediction = WindowPrediction(windows, blend_rate, velocity_noise_fraction, noise)
        self._initial_noise = self._deviations(
            (INITIAL_POSITION_STD,) * 3, (INITIAL_ROTATION_STD,) * 3, INITIAL_ANGLE_STD
        )
        b = len(windows.sigmas)
        ahead = tuple(f"c{k + 1}_ahead{j}" for j in range(1, windows.window_frames) for k in range(b))
        self.space = StateSpace.of({
            "root_position": (POSE_NAMES[:3], "m"), "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
            "angles": (POSE_NAMES[N_ROOT:], "rad"),
            "coefficients": (tuple(f"c{k + 1}" for k in range(b)), "σ"), "ahead": (ahead, "σ"),
        })  # fmt: skip
        self.tree = TREES[search](windows.coefficients)
        self._density = self._search_density()

    @property
    def capabilities(self) -> PriorCapabilities:
        """The density, if the search is exact, and poses of the database."""
        return PriorCapabilities(density=self._density, examples=self._examples)

    def searching(self, search: str, beta: float) -> "Implicit":
        """Return the prior with another search and temperature."""
        return self._replaced(self.windows, search, beta)

    def only(self, mask: BoolArray) -> "Implicit":
        """Return the prior restricted to the windows in a mask (n,), with renormalised probabilities."""
        return self._replaced(self.windows.only(mask), self.search, self.beta)

    def _replaced(self, windows: Windows, search: str, beta: float) -> "Implicit":
        other = copy(self)
        other.windows, other.search, other.beta = windows, search, beta
        other.importance_correction = self.importance_correction and search != "exact"
        other.prediction = replace(self.prediction, windows=windows)
        if search != self.search or windows is not self.windows:
            other.tree = TREES[search](windows.coefficients)
        other._density = other._search_density()
        return other

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D): an initial pose (P,) plus noise, with windows that end at similar poses.

        As in C, section 6, by linear search: an entry has the weight
        exp(−½ Σ_a (ψ_a − pose_a)² / (INITIAL_BETA · s_a²)) over the modelled angles and, if the root is
        modelled, its pitch and roll; s_a are the database's standard deviations.
        """
        pose_columns, row_columns = self.prediction.absolute
        rows = self.windows.rows[self.windows.ends][:, row_columns]
        squares = (((rows - pose[pose_columns]) / self.windows.scales[row_columns]) ** 2).sum(axis=1, dtype=np.float64)
        weights = np.exp((squares.min() - squares) / (2.0 * INITIAL_BETA)).cumsum()
        entries = np.searchsorted(weights, rng.random(n) * weights[-1], side="right").clip(max=len(weights) - 1)
        poses = pose + self._initial_noise * rng.standard_normal((n, len(POSE_NAMES)))
        return np.concatenate([poses, self.windows.memory(self.windows.window_rows(entries))], axis=1)

    def start_after(self, poses: FloatArray, n: int) -> FloatArray:
        """Return n equal states (n, D) after poses (d + 1, P) at the library's rate, without noise."""
        rows = pose_rows(poses, self.windows.rate_hz, self.windows.angles, self.windows.include_root)
        memory = self.windows.memory(rows[None, ::-1][:, : self.windows.window_frames])
        return np.repeat(np.concatenate([poses[-1:], memory], axis=1), n, axis=0)

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later.

        Raises InputError if dt_s is not a whole number of the library's frames (to 5 % of one).
        """
        return self._sample(state, dt_s, rng, weighted=False)[0]

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample as `sample_transition`; return states (N, D) and log weights (N,), zero without a correction."""
        return self._sample(state, dt_s, rng, weighted=self.importance_correction)

    def _sample(
        self, state: FloatArray, dt_s: float, rng: np.random.Generator, *, weighted: bool
    ) -> tuple[FloatArray, FloatArray]:
        log_weights = np.zeros(len(state))
        for _ in range(self.rows_in(dt_s)):
            probes = state[:, self.space.slices["coefficients"]]
            entries = self.draw(probes, rng)
            if weighted:
                log_weights += self._log_importance(probes, entries)
            state = self.predict(state, entries, rng.standard_normal((len(state), len(POSE_NAMES))))
        return state, log_weights

    def rows_in(self, dt_s: float) -> int:
        """Return the number of library frames in dt_s seconds; raises InputError unless it is whole (to 5 %)."""
        if (frames := whole_frames(dt_s, self.windows.rate_hz)) is None:
            raise InputError(
                f"prior: a frame interval of {dt_s:.4g} s is not a whole number of rows of an implicit prior at "
                f"{self.windows.rate_hz:g} Hz; learn it at a rate that is a multiple of the video's"
            )
        return frames

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        return np.ascontiguousarray(state[:, : len(POSE_NAMES)])

    def draw(self, probes: FloatArray, rng: np.random.Generator) -> IntArray:
        """Sample an entry (N,) for each probe (N, b), whitened coefficients."""
        if isinstance(self.tree, Tree):
            uniforms = rng.random((len(probes), self.tree.depth + 1))
            return draw(self.tree, probes, self.beta, uniforms, self.leaf)
        uniforms = rng.random(len(probes))
        order, firsts = group_equal(probes)
        counts = np.diff(np.append(firsts, len(probes)))
        entries = np.empty(len(probes), dtype=np.int64)
        result = search(self.tree, probes[order[firsts]], counts, self.beta, uniforms[order], self.tail_probability)
        entries[order] = result.entries
        return entries

    def _log_importance(self, probes: FloatArray, entries: IntArray) -> FloatArray:
        assert isinstance(self.tree, Tree)  # checked in __init__
        order, firsts = group_equal(probes)
        log_weights = np.empty(len(probes))
        for rows in np.split(order, firsts[1:]):
            log_weights[rows] = log_importance(self.tree, probes[rows[0]], entries[rows], self.beta, self.leaf)
        return log_weights

    def predict(self, state: FloatArray, entries: IntArray, noise: FloatArray) -> FloatArray:
        """Return the states (N, D) one library frame later for entries (N,); noise : (N, P) standard normal."""
        return self.prediction.predict(state, entries, noise)

    def _examples(self) -> FloatArray:
        """Return poses (n, P) at the windows' ends, at most MAX_EXAMPLES; root at the origin, heading zero."""
        n = len(self.windows)
        chosen = np.linspace(0, n - 1, min(n, MAX_EXAMPLES)).round().astype(np.int64)
        pose_columns, row_columns = self.prediction.absolute
        poses = np.zeros((len(chosen), len(POSE_NAMES)))
        poses[:, pose_columns] = self.windows.rows[self.windows.ends[chosen]][:, row_columns]
        return poses

    def _search_density(self) -> ImplicitDensity | None:
        """Return the transition density of the exact search; None for another search."""
        if isinstance(self.tree, KdTree):
            return ImplicitDensity(self.prediction, self.tree, self.beta, self.tail_probability)
        return None

    def _deviations(
        self, position: Sequence[float], rotation: Sequence[float], angles: float | Sequence[float]
    ) -> FloatArray:
        n_angles = len(self.windows.angles)
        for name, values, size in (
            ("sigma_position", position, 3), ("sigma_rotation", rotation, 3), ("sigma_angles", angles, n_angles),
        ):  # fmt: skip
            if np.shape(values) != (size,) and not (name == "sigma_angles" and np.ndim(values) == 0):
                raise InputError(f"prior: {name} must hold {size} numbers, found {np.size(values)}")
        deviations = np.zeros(len(POSE_NAMES))
        if self.windows.include_root:
            deviations[:N_ROOT] = (*position, *rotation)
        deviations[[POSE_NAMES.index(name) for name in self.windows.angles]] = angles
        return deviations
