"""The constants that the papers leave open: what they say, the candidates, the choice, and on whom it was made.

`analysis.literal_constants` prints the curve of a constant; the experiments' files contain those of papers A to C.
"""

from typing import NamedTuple

from omegaconf import OmegaConf

from analysis.figures.recordings import chosen
from analysis.figures.unrecorded import composed
from workbench.body.surface import OVERHANG
from workbench.motion.models.cycle_alignment import N_KNOTS
from workbench.priors.implicit import INITIAL_BETA
from workbench.priors.smooth import INITIAL_VELOCITY_SCALE


class OpenConstant(NamedTuple):
    """A constant without a value in its paper. choice: a value, or experiment and key whose value it is with
    paper=literal. candidates: what was tried, with the measure. people: on whom."""

    paper: str
    name: str
    said: str
    choice: str | tuple[str, str]
    candidates: str
    people: str

    @property
    def value(self) -> str:
        """The chosen value."""
        if isinstance(self.choice, str):
            return self.choice
        experiment, key = self.choice
        config = composed([*chosen(experiment), "paper=literal"])
        return f"{OmegaConf.select(config, key)} (`{experiment}`, `{key}`)"


_NOT_VARIED = "not varied"
_NOBODY = "–"
_WALKERS, _ARM = "CMU 38_02, 39_02", "generated arms of seeds 100 to 105"
_FEW_ARMS = "generated arms of seeds 100 to 102"
_RUNS = "arms of three other runs of Bandai"
_VALIDATION = "`clips.validation`, seeds 100, 101"
OPEN_CONSTANTS = tuple(
    OpenConstant(*entry)
    for entry in (
        ("A", "σ of grey levels, walks", "a Gaussian", ("walk_straight", "likelihood.sigma"), "20–80", _WALKERS),
        ("A", "σ of grey levels, arm", "as above", ("arm_twist", "likelihood.sigma"), "10–80", _ARM),
        ("A", "p_occluded, walks", "a constant", ("walk_straight", "likelihood.p_occluded"), "0.0003–0.01", _WALKERS),
        ("A", "p_occluded, arm", "a constant", ("arm_twist", "likelihood.p_occluded"), "0.0003–0.003", _ARM),
        ("A", "fraction of outliers ε", "a mixture", ("arm_twist", "likelihood.outlier_fraction"), "0.01–0.2", _ARM),
        (
            "A", "sampled pixels of a limb", "n", ("arm_twist", "likelihood.n_samples"),
            "24, 48, 96: tracked 0, 3, 3 of 3, 109, 34, 41 mm", _FEW_ARMS,
        ),
        (
            "A", "noise of poses and velocities", "no value",
            "`SIGMA`, `SIGMA_VELOCITY` of the smooth prior, in fig. 4 1.5 times the latter",
            "estimated from recorded motion; 1, 1.5 times", f"all recordings; {_ARM}",
        ),
        ("A", "view of the arm", "a picture", ("arm_twist", "dataset.view_azimuth_deg"), "45, 65, 110, 135", _ARM),
        (
            "A", "initial velocities", "no value", f"{INITIAL_VELOCITY_SCALE:g} σ of the velocities",
            "1, 3, 6: tracked 2, 3, 3 of 3, 77, 34, 52 mm", _FEW_ARMS,
        ),
        (
            "A", "initial poses, in σ", "set by hand", ("arm_twist", "prior.initial_pose_scale"),
            "1, 2, 4: tracked 3, 3, 0 of 3, 38, 34, 150 mm", _FEW_ARMS,
        ),
        ("A", "noise of coefficients, in λ", "ελ", ("walk_straight", "prior.sigma_coefficients"), "as ours", "–"),
        ("A", "noise of the phase", "no value", ("walk_straight", "prior.sigma_phase"), "as ours", "–"),
        (
            "B", "knots of the alignment's spline", "a regression spline", str(N_KNOTS),
            "8, 16, 32: flat, deviation after the alignment 0.843, 0.841, 0.840", "CMU 38, 39",
        ),
        ("B", "components q", "no value", ("walk_cyclic", "prior.n_components"), _NOT_VARIED, _NOBODY),
        ("B", "missing samples", "no value", ("walk_cyclic", "prior.missing_fraction"), _NOT_VARIED, _NOBODY),
        (
            "B", "noise of the root's position", "no value", ("walk_cyclic", "prior.sigma_position"),
            "a walker's displacement per frame", "all recordings",
        ),
        ("B", "σ of grey levels", "no value", ("walk_cyclic", "likelihood.sigma"), "3–14", _WALKERS),
        ("B", "p_occluded", "a constant", ("walk_cyclic", "likelihood.p_occluded"), "0.001–0.01", _WALKERS),
        (
            "C", "β of tracking", "“the temperature”; 1 in fig. 4", ("body_implicit", "prior.beta"), "0.005–0.1",
            _WALKERS,
        ),
        ("C", "β of the arm", "1 in fig. 4", ("arm_implicit", "prior.beta"), "0.02–0.2", _RUNS),
        ("C", "σ of grey levels, arm", "no value", ("arm_implicit", "likelihood.sigma"), "10–80", _RUNS),
        ("C", "p_occluded, arm", "no value", ("arm_implicit", "likelihood.p_occluded"), "0.0003–0.01", _RUNS),
        (
            "C", "β of synthesis", "lower than for tracking", ("synthesize_run", "prior.beta"), "0.0003–0.01",
            "continuations of four other runs of Bandai",
        ),
        ("C", "β of the initial search", "a linear search", f"{INITIAL_BETA:g}", _NOT_VARIED, _NOBODY),
        (
            "C", "noise of a copied pose", "small", ("body_implicit", "prior.sigma_angles"),
            "0.01, 0.02, 0.04: 157, 95, 88 mm, 19.4, 12.0, 14.1 px", "CMU 38_02, seed 100",
        ),
        ("C", "σ of grey levels", "no value", ("body_implicit", "likelihood.sigma"), "35–80", _WALKERS),
        ("C", "p_occluded", "no value", ("body_implicit", "likelihood.p_occluded"), "0.0003–0.003", _WALKERS),
        (
            "D", "sharpness a of the surface", "a_i, eq. 2", ("points_walk_steady", "likelihood.sharpness"),
            "0.125, 0.25, 0.5, 1, 2, 4: hips 6.4, 5.7, 5.2, 4.9, 8.2, 16.3°, knees 7.7, 6.6, 6.5, 6.8, 12.8, 25.2°, "
            "tracked 8, 8, 8, 8, 7, 0 of 8 (10 components)", _VALIDATION,
        ),
        (
            "D", "overhang of the limbs", "“ellipsoidal primitives”", f"{OVERHANG:g} of a limb's thickness",
            "0, 0.15, 0.3, 0.6: hips 5.5, 5.2, 5.1, 5.0°, knees 6.4, 6.4, 6.4, 6.5° (10 components)",
            "`clips.validation`, seed 100",
        ),
        (
            "D", "points of a frame", "a picture", ("points_walk_steady", "dataset.n_points"),
            "200, 400, 800: flat, hips 5.6, 5.4, 5.9°, knees 8.7, 8.3, 8.7°", _WALKERS,
        ),
        (
            "D", "depth noise of the points at 4 m, m", "“very noisy”", ("points_walk_steady", "dataset.sigma_m"),
            "0.01, 0.02, 0.04: flat, hips 5.9, 5.4, 5.2°, knees 8.5, 8.3, 8.4°", _WALKERS,
        ),
        (
            "D", "points off the body", "“very noisy”", ("points_walk_steady", "dataset.outlier_fraction"), _NOT_VARIED,
            _NOBODY,
        ),
        ("D", "samples of a cycle", "the same number", "64", _NOT_VARIED, _NOBODY),
    )
)  # fmt: skip
"""All constants of the literal rows that no paper gives."""


def section() -> list[str]:
    """Return the lines of the section of the page on deviations, in Markdown."""
    return [
        "## Constants that the papers leave open", "",
        "Choices are those of `paper=literal`, with the experiment and the key that has the value. Candidates were "
        "compared by `python -m analysis.literal_constants`, on people and seeds whose results are not reported; the "
        "files of the experiments contain the curves of papers A to C. *As ours*: our experiment's value, which was "
        "tuned on validation people.", "",
        "| paper | constant | the paper says | choice | candidates | chosen on |",
        "| --- | --- | --- | --- | --- | --- |",
        *(
            f"| {each.paper} | {each.name} | {each.said} | {each.value} | {each.candidates} | {each.people} |"
            for each in OPEN_CONSTANTS
        ), "",
    ]  # fmt: skip
