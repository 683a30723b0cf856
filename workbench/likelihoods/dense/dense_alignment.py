"""Dense alignment of the person with the image: texture of the whole surface, and the boundary to the background.

The likelihood has derivatives, so that a pose can be optimised by Gauss–Newton steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from workbench.body.kinematics import JointFrames, descendants, forward
from workbench.body.limbs import Body
from workbench.cameras.camera import Camera
from workbench.core.capabilities import DERIVATIVES, IMAGES, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import Derivatives, Evaluation, Likelihood
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.base import AdaptiveLikelihood, expand_finite, finite_rows
from workbench.likelihoods.cues.image_levels import grey_levels, spaced_frames
from workbench.likelihoods.dense import background_model
from workbench.likelihoods.dense.background_model import BackgroundModel, ViewState
from workbench.likelihoods.dense.layer_rendering import (
    Facets,
    LayerImage,
    layer_log_ratios,
    render_layer,
    surface_facets,
)
from workbench.likelihoods.dense.surface_elements import (
    SurfaceElements,
    dof_mask,
    point_motion,
    project_elements,
    surface_elements,
    visible_elements,
)
from workbench.likelihoods.dense.view_likelihood import (
    Residuals,
    ViewLikelihood,
    mask_at,
    person_mask,
    smoothing_pyramids,
)
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.errors import InputError

BLURS_PX = (6.0, 3.0, 1.2)
"""Standard deviations b of the image's smoothing, by level of the pyramid."""
FOREGROUND_SIGMA = 0.25
"""Standard deviation s of a pixel's foreground probability, 0 to 1."""
MIN_FACING_COSINE = 0.3
"""Minimum cosine of the angle between a surface element's normal and the line of sight."""
OUTLINE_LOSS_WEIGHT = 0.25
"""Weight of the outline's loss in a mean loss: its scale is large, so that it also grows where the background is
unknown."""
LAYER_PIXEL_WEIGHT = 1.0 / 10.0
"""Effective number of independent pixels per pixel in layered comparison, at every SUBSAMPLING-th row and column."""
PRIOR_POINTS = 20.0
"""Number of points by which the mean loss of the whole person is weighted in the mean loss of a limb."""


@dataclass(frozen=True, eq=False)
class DenseAlignment:
    """Compare the person with the image, at decreasing levels of smoothing:

        log p = − λ Σ_i ρ_2( (I_b(x_i) − T_b,i) / (σ √(1 + 1/n_i)) ) − λ Σ_j ρ_10( (F_b(x_j) − M_b(x_j)) / s )

    x_i: pixels of the visible elements of the limbs' surfaces. I_b: the image smoothed by b px. T_b,i: the element's
    previous level, the mean of n_i frames. x_j: the same pixels, and others next to the limbs
    (`surface_elements.contour_samples`). F: foreground probability; M: the pose's outline; both smoothed by b. ρ_c = ½
    c² r² / (c² + r²), Geman & McClure's loss. λ: effective number of independent pixels per compared pixel. A pose is
    evaluated at the last b.

    Derivatives are Gauss–Newton; that of the outline is the mean of F's and M's (Malis 2004). After a frame, elements
    are updated at the expected pose: T += g (I − T), g = w max(1/(n + 1), learning_rate), w being the loss's weight;
    `background_model` tracks background and occluders. Distant poses are compared by all pixels of every SUBSAMPLING-th
    row and column (`layer_rendering`). Raises InputError if a parameter is out of range, or a camera is not in the
    sequence.

    Parameters
    ----------
    body, clip : the person's body and the sequence.
    sigma : σ, grey levels.
    pixel_weight : λ.
    learning_rate : minimum gain g of an inlier.
    outlier_fraction : of the background's pixels.
    n_frames : evenly spaced frames of the sequence from which the background is learned.
    """

    traits: ClassVar[Traits] = component_traits(DERIVATIVES, dataset=IMAGES, assumptions=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    sigma: float = 10.0
    pixel_weight: float = 1.0 / 12.0
    learning_rate: float = 0.1
    outlier_fraction: float = 0.05
    n_frames: int = 60

    def __post_init__(self) -> None:
        check("dense alignment", self, sigma=POSITIVE, pixel_weight=POSITIVE, learning_rate=UNIT)
        check("dense alignment", self, outlier_fraction=INSIDE_UNIT, n_frames=at_least(3))

    @cached_property
    def elements(self) -> SurfaceElements:
        """The body's surface elements."""
        return surface_elements(self.body.limbs)

    @cached_property
    def facets(self) -> Facets:
        """Their facets for rendering."""
        return surface_facets(self.body.limbs, self.elements)

    def facets_on(self, joints: BoolArray) -> Facets:
        """Return the facets on some of the joints (J,), from a cache."""
        key = joints.tobytes()
        if key not in self._facets_on:
            self._facets_on[key] = self.facets.on_joints(joints)
        return self._facets_on[key]

    @cached_property
    def _facets_on(self) -> dict[bytes, Facets]:
        return {}

    @cached_property
    def dof_mask(self) -> FloatArray:
        """1 where a number of the pose moves the points on a joint, else 0, (J, P)."""
        return dof_mask(self.body.skeleton)

    @cached_property
    def images(self) -> Mapping[str, Mapping[int, Float32Array]]:
        """Grey images of evenly spaced frames of the sequence, by the camera's name and the frame's index."""
        images: dict[str, dict[int, Float32Array]] = {}
        for frame in spaced_frames(self.clip, self.n_frames):
            for view in frame.views:
                images.setdefault(view.camera.name, {})[frame.index] = grey_levels(view, 0.0)
        return images

    def refitted(self, frame: Frame, poses: Mapping[int, FloatArray]) -> Likelihood:
        """Return the likelihood of a tracked sequence that begins with `frame`, given poses (P,) by frame index. The
        background is observed wherever the person was not; the texture is learned again from the first frame."""
        view_states = {}
        for view in frame.views:
            images = {i: image for i, image in self._images_of(view.camera).items() if i in poses}
            person_masks = [self._person_mask(view, poses[i]) for i in images]
            background = background_model.refitted_background([*images.values()], person_masks)
            person_mask = self._person_mask(view, poses[frame.index])
            view_states[view.camera.name] = self._initial_state(background, grey_levels(view, 0.0), person_mask)
        return AdaptiveLikelihood(view_states, self._prepare)

    def prepare(self, previous: Frame | None, frame: Frame) -> "_DenseFrameLikelihood":
        """Return the likelihood of a frame without any appearance of the person."""
        return self._prepare({}, previous, frame)

    def _prepare(
        self, states: Mapping[str, ViewState], previous: Frame | None, frame: Frame
    ) -> "_DenseFrameLikelihood":
        view_likelihoods, notes = [], []
        for view in frame.views:
            state = states.get(view.camera.name)
            if state is not None:
                view_likelihoods.append(self._view_likelihood(state, view))
            elif previous is not None:
                notes.append(f"dense alignment: no appearance in camera {view.camera.name} yet; the camera is ignored")
        return _DenseFrameLikelihood(self, states, frame, tuple(view_likelihoods), tuple(notes))

    def _view_likelihood(self, state: ViewState, view: View) -> tuple[ViewLikelihood, ViewState]:
        """Return a view's likelihood and its model with the occluders of this frame, before the pose is known."""
        image = grey_levels(view, 0.0)
        ratio = state.background.log_ratio(image, self.outlier_fraction)
        state = state.tracked(image, ratio)
        foreground = (1.0 / (1.0 + np.exp(-2.0 * ratio))).astype(np.float32)
        pyramid, foreground_pyramid = smoothing_pyramids([image, foreground], BLURS_PX)
        model = state.background.observed, ~state.occluded, ratio
        return ViewLikelihood(view.camera, pyramid, foreground_pyramid, *model), state

    def residuals(
        self, view: ViewLikelihood, state: ViewState, level: int, frames: JointFrames
    ) -> tuple[Residuals, Residuals]:
        """Return the residuals of texture and outline in one camera, given the pose's joints' frames."""
        projected, joints = project_elements(self.elements, frames, view.camera), self.elements.joints
        visible = visible_elements(projected, view.shape, MIN_FACING_COSINE)
        textured = visible[state.n[visible] > 0.0]
        sigma = self.sigma * np.sqrt(1.0 + 1.0 / state.n[textured])
        means = state.texture[level, textured]
        texture = view.texture_residuals(level, projected, textured, joints[textured], means, sigma)
        pose = self.body, frames, projected, visible, joints[visible]
        return texture, view.outline_residuals(level, BLURS_PX[level], *pose, FOREGROUND_SIGMA)

    def updated_view(
        self, state: ViewState | None, view: View, pose: FloatArray, view_likelihood: ViewLikelihood | None = None
    ) -> ViewState:
        """Return a view's model updated at the expected pose (P,); None for a model not yet initialised."""
        image, person_mask = grey_levels(view, 0.0), self._person_mask(view, pose)
        if state is None:
            background = background_model.initial_background([*self._images_of(view.camera).values()], person_mask)
            state = self._initial_state(background, image, person_mask)
        projected = project_elements(self.elements, forward(self.body.skeleton, pose[None]), view.camera)
        visible = visible_elements(projected, (image.shape[0], image.shape[1]), MIN_FACING_COSINE)
        visible = visible[mask_at(~state.occluded, projected.pixels[visible]) > 0.0]
        pyramid = smoothing_pyramids([image], BLURS_PX)[0] if view_likelihood is None else view_likelihood.pyramid
        state = state.with_texture(pyramid, visible, projected.pixels[visible], self.sigma, self.learning_rate)
        return state.with_person(image, person_mask)

    def _images_of(self, camera: Camera) -> Mapping[int, Float32Array]:
        if camera.name not in self.images:
            raise InputError(f"likelihood: camera {camera.name} is not in the sequence, so has no background")
        return self.images[camera.name]

    def _person_mask(self, view: View, pose: FloatArray) -> BoolArray:
        shape = view.image.shape[0], view.image.shape[1]
        return person_mask(self.body, view.camera, forward(self.body.skeleton, pose[None]), shape)

    def _initial_state(self, background: BackgroundModel, image: Float32Array, mask: BoolArray) -> ViewState:
        return background_model.initial_view_state(background, image, mask, len(BLURS_PX), len(self.elements.limbs))


@dataclass(frozen=True, eq=False)
class _DenseFrameLikelihood:
    """The dense likelihood of one frame, in the cameras with a model."""

    likelihood: DenseAlignment
    view_states: Mapping[str, ViewState]
    frame: Frame
    view_likelihoods: tuple[tuple[ViewLikelihood, ViewState], ...]
    notes: tuple[str, ...] = ()

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """The fraction of the images that occluders cover."""
        fractions = [1.0 - float(view.unoccluded.mean()) for view, _ in self.view_likelihoods]
        return {"occluded_fraction": float(np.mean(fractions)) if fractions else 0.0}

    @property
    def n_levels(self) -> int:
        """Number of levels of smoothing, from most to least."""
        return len(BLURS_PX)

    @property
    def informative(self) -> bool:
        """Whether some camera has a model."""
        return bool(self.view_likelihoods)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log likelihoods (N,) of poses (N, P), one after the other; previous poses are ignored."""
        finite = finite_rows(pose)
        losses = np.array([self.derivatives(each, self.n_levels - 1, derive=False).log_prob for each in pose[finite]])
        return replace(expand_finite("dense alignment", finite, losses), diagnostics=self.diagnostics)

    def derivatives(self, pose: FloatArray, level: int, derive: bool = True) -> Derivatives:
        """Return the log likelihood of a pose (P,) at a level of smoothing, with its derivatives if `derive`."""
        likelihood, size = self.likelihood, len(pose)
        frames = forward(likelihood.body.skeleton, pose[None])
        motion = point_motion(likelihood.body.skeleton, likelihood.dof_mask, pose, frames)
        loss, gradient, curvature = 0.0, np.zeros(size), np.zeros((size, size))
        for view, state in self.view_likelihoods:
            for residuals in likelihood.residuals(view, state, level, frames):
                loss += likelihood.pixel_weight * residuals.loss
                if derive:
                    loss_gradient, loss_curvature = residuals.normal_equations(motion, view.camera)
                    gradient -= likelihood.pixel_weight * loss_gradient
                    curvature += likelihood.pixel_weight * loss_curvature
        return Derivatives(-loss, gradient, curvature)

    def compare(self, poses: FloatArray, moved: BoolArray) -> FloatArray:
        """Return the log likelihood ratios (N,) of rendering and omitting the body parts on joints `moved` (J,) as
        layers. poses: (N, P), which may differ only in these body parts. A pixel has the weight LAYER_PIXEL_WEIGHT."""
        likelihood, frames, total = self.likelihood, forward(self.likelihood.body.skeleton, poses), np.zeros(len(poses))
        for view, state in self.view_likelihoods:
            camera, image, ratio, unoccluded = view.subsampled
            observed = LayerImage(image, ratio, unoccluded, state.texture[-1], state.n, likelihood.sigma)
            behind = render_layer(likelihood.facets_on(~moved), frames, camera, image.shape)
            facets = likelihood.facets_on(moved)
            total += LAYER_PIXEL_WEIGHT * layer_log_ratios(behind, facets, frames, camera, observed)
        return total

    def mean_loss(self, pose: FloatArray) -> FloatArray:
        """Return the mean loss (J,) of the points that each joint moves, at the last level of smoothing. It is that of
        the texture plus OUTLINE_LOSS_WEIGHT times that of the outline; the whole person's counts as PRIOR_POINTS points
        more."""
        likelihood = self.likelihood
        frames, below = forward(likelihood.body.skeleton, pose[None]), descendants(likelihood.body.skeleton)
        carries = (below | np.eye(len(below), dtype=np.bool_)).astype(np.float64)
        sums = np.zeros((2, 2, len(carries)))  # texture and outline; losses and weights; joints
        for view, state in self.view_likelihoods:
            for row, residuals in enumerate(likelihood.residuals(view, state, self.n_levels - 1, frames)):
                for column, weights in enumerate((residuals.losses, residuals.weights)):
                    sums[row, column] += carries @ np.bincount(residuals.joints, weights, len(carries))
        whole_body = sums[:, 0, :1] / np.maximum(sums[:, 1, :1], 1.0)
        texture, outline = (sums[:, 0] + PRIOR_POINTS * whole_body) / (sums[:, 1] + PRIOR_POINTS)
        return np.asarray(texture + OUTLINE_LOSS_WEIGHT * outline)

    def update(self, expected_pose: FloatArray) -> AdaptiveLikelihood[Mapping[str, ViewState]]:
        """Return the likelihood of the next frame; not updated if the expected pose is not finite."""
        likelihood = self.likelihood
        view_states = {**self.view_states, **{view.camera.name: state for view, state in self.view_likelihoods}}
        if np.isfinite(expected_pose).all():
            view_likelihoods = {view.camera.name: view for view, _ in self.view_likelihoods}
            for view in self.frame.views:
                name = view.camera.name
                state, view_likelihood = view_states.get(name), view_likelihoods.get(name)
                view_states[name] = likelihood.updated_view(state, view, expected_pose, view_likelihood)
        return AdaptiveLikelihood(view_states, likelihood._prepare)
