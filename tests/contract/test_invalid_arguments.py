"""Every component rejects invalid values and combinations with a message that names the key or the other component.

The range checks themselves are tested in tests/unit/core/test_checks.py; these tests check that every class uses them.
"""

import numpy as np
import pytest
from linear_gaussian import DrawnOnly, LinearPrior, TwoJoints
from still_clips import clip as clip_of

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.inference.smc.bootstrap import Auxiliary, Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.partitioned import Partitioned
from workbench.inference.smc.reinitializing import Reinitializing
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag
from workbench.inference.smc.tempered_smc import Annealed, TemperedSMC
from workbench.inference.synthesis import Synthesis
from workbench.likelihoods.cues.appearance import Appearance
from workbench.likelihoods.cues.background import Background
from workbench.likelihoods.cues.edges import Edges
from workbench.likelihoods.cues.silhouette import Silhouette
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors import from_motions
from workbench.priors.ar_offsets import AROffsets
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

BODY, PRIOR, DRAWN_ONLY = person(from_height(1.75)), LinearPrior(), DrawnOnly()
PLAIN = ParticleFilter(PRIOR, None)


def filtered(algorithm, prior=PRIOR, **options):
    return ParticleFilter(prior, None, algorithm=algorithm, **options)


def static_clip():
    return clip_of(*[np.full((240, 320), 100, np.uint8)] * 3)[0]


MAKERS = {
    "filter": lambda cache, **options: ParticleFilter(PRIOR, None, **options),
    "bootstrap": lambda cache, **options: Bootstrap(**options),
    "auxiliary": lambda cache, **options: Auxiliary(**options),
    "gauss_newton": lambda cache, **options: GaussNewton(**options),
    "partitioned": lambda cache, **options: Partitioned(**options),
    "tempered_smc": lambda cache, **options: TemperedSMC(**options),
    "annealed": lambda cache, **options: Annealed(**options),
    "reinitializing": lambda cache, **options: Reinitializing(PLAIN, **options),
    "fixed_lag": lambda cache, **options: FixedLag(PLAIN, **options),
    "backward_simulation": lambda cache, **options: BackwardSimulation(PLAIN, **options),
    "motion_fit": lambda cache, **options: MotionFit(**options),
    "synthesis": lambda cache, **options: Synthesis(Smooth(), BODY, **options),
    "ar_offsets": lambda cache, **options: AROffsets(Smooth(), **options),
    "walking": lambda cache, **options: from_motions.walking(motions="builtin", cache=cache, n_components=3, **options),
    "smooth": lambda cache, **options: Smooth(**options),
    "implicit": lambda cache, **options: Implicit(learn_windows(builtin_motions(n_subjects=1)), **options),
    "image_motion": lambda cache, **options: ImageMotion(BODY, **options),
    "background": lambda cache, **options: Background(BODY, static_clip(), **options),
    "appearance": lambda cache, **options: Appearance(BODY, **options),
    "edges": lambda cache, **options: Edges(BODY, **options),
    "silhouette": lambda cache, **options: Silhouette(BODY, static_clip(), **options),
    "keypoints": lambda cache, **options: KeypointLikelihood(BODY, **options),
    "surface_points": lambda cache, **options: SurfacePoints(BODY, **options),
}
OUT_OF_RANGE = """
filter n_particles=0 on_degenerate=ignore | bootstrap resampling=stratifed ess_threshold=1.5
auxiliary first_stage_power=1.5
gauss_newton proposal_fraction=1.0 curvature_weight=-0.1 n_newton_steps=0 | partitioned intermediate_power=2.0
tempered_smc n_mcmc_steps=0 ess_threshold=1.0 | annealed layers=0
reinitializing reinitialized_fraction=0.0 n_particles=0 | fixed_lag lag=0 min_effective_ancestors=0
backward_simulation n_paths=0 | motion_fit rho=1.0 | synthesis blend_time_s=-1.0 look_ahead=-1
ar_offsets sigma=0.0 ar_coefficient=1.0
smooth damping=-1.0 | walking transition=C
implicit search=linear prediction=guess leaf=nearest beta=0.0 blend_rate=1.5
image_motion sigma=0 outlier_fraction=1 n_samples=0 reduction=max effective_pixels=0 sampling=even
image_motion occlusion=yes background=moving
background effective_pixels=0 outlier_fraction=0 n_frames=2 n_samples=0 | edges effective_responses=0
appearance effective_pixels=0 sigma=0 outlier_fraction=1 learning_rate=1.5 n_samples=0
silhouette effective_pixels=0 outlier_fraction=1 n_frames=2 dilation_px=-1
keypoints sigma_px=0 likelihood_power=1.5 loss=cauchy loss_scale=0
surface_points sigma=0 sharpness=0 outlier_fraction=0 likelihood_power=1.5 loss=cauchy loss_scale=0 residual=depth
"""
RANGES = [
    (name, *text.split("="))
    for name, *texts in (part.split() for part in OUT_OF_RANGE.strip().replace("\n", "|").split("|"))
    for text in texts
]


@pytest.mark.parametrize(("name", "key", "text"), RANGES)
def test_a_value_out_of_range_is_rejected_with_its_key(name, key, text, cache):
    value = text if text.isalpha() else float(text)
    with pytest.raises(InputError, match=rf"\b{key}\b.*found|\b{key}\b.*must"):
        MAKERS[name](str(cache), **{key: value})


INVALID_COLLECTIONS = [
    ("ar_offsets", {"parameters": ["root_x"]}, "parameters"),
    ("walking", {"sigma_rotation": (0.1, 0.1)}, "sigma_rotation"),
    ("implicit", {"sigma_position": (0.1, 0.2)}, "sigma_position"),
    ("smooth", {"parameters": ["left_elbow"]}, "parameters: 'left_elbow' is unknown"),
    ("smooth", {"parameters": []}, "at least one"),
    ("smooth", {"initial_uniform": ["left_elbow_flexion"] * 2}, "named twice"),
    ("smooth", {"initial_uniform": ["root_x"]}, "root_x has no limits"),
    ("smooth", {"sigma": {"arm": 0.1}}, "sigma: 'arm' is unknown"),
    ("smooth", {"sigma_velocity": {"elbow": float("nan")}}, r"sigma_velocity\.elbow"),
    ("smooth", {"lower": {"elbow_flexion": 3.0}}, "lower and upper of left_elbow_flexion .* found 3.0 and 2.7"),
    ("smooth", {"penalty": {"speed": 1.0}}, "'speed'"),
    ("smooth", {"penalty": {"angle": 0.0}}, "penalty.angle"),
    ("synthesis", {"look_ahead": 3}, "look_ahead"),
]


@pytest.mark.parametrize(("name", "options", "message"), INVALID_COLLECTIONS)
def test_an_invalid_item_of_a_list_or_mapping_is_rejected_by_name(name, options, message, cache):
    with pytest.raises(InputError, match=message):
        MAKERS[name](str(cache), **options)


CONFLICTS = {
    "can only be sampled from": [
        lambda: filtered(TemperedSMC(), DRAWN_ONLY), lambda: filtered(Annealed(), DRAWN_ONLY),
        lambda: filtered(Auxiliary(), DRAWN_ONLY), lambda: filtered(GaussNewton(), DRAWN_ONLY),
        lambda: filtered(Partitioned(), DRAWN_ONLY), lambda: BackwardSimulation(ParticleFilter(DRAWN_ONLY, None)),
    ],
    "the other way round": [
        lambda: Reinitializing(FixedLag(PLAIN)), lambda: BackwardSimulation(Reinitializing(PLAIN)),
        lambda: BackwardSimulation(FixedLag(PLAIN)), lambda: FixedLag(BackwardSimulation(PLAIN)),
    ],
    "n_particles": [
        lambda: filtered(TemperedSMC(), n_particles=1), lambda: filtered(GaussNewton(), n_particles=1),
    ],
    "all of which are in one partition": [lambda: filtered(Partitioned())],
    "tail": [lambda: filtered(Partitioned(partitions=["root", "tail"]), TwoJoints())],
    "10000 frames": [
        lambda: Synthesis(Implicit(learn_windows(builtin_motions(n_subjects=1))), BODY, look_ahead=10000),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("message", "make"), [(message, make) for message, makers in CONFLICTS.items() for make in makers]
)
def test_incompatible_components_are_rejected(message, make):
    with pytest.raises(InputError, match=message):
        make()
