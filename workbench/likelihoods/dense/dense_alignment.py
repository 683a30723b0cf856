"""The whole person laid onto the image: every cell of their surface shows what it showed before, and where they end the
scene begins. It has derivatives, so that a pose can be climbed to by Gauss–Newton steps."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from workbench.body.camera import Camera
from workbench.body.kinematics import JointFrames, descendants, forward
from workbench.body.limbs import Body
from workbench.core.capabilities import DERIVATIVES, IMAGES, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import Evaluation, Likelihood, Slope
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.base import Remembering, among_finite, finite_rows
from workbench.likelihoods.cues.image_levels import grey_levels, spaced_frames
from workbench.likelihoods.dense import background_model
from workbench.likelihoods.dense.background_model import BackgroundModel, ViewState
from workbench.likelihoods.dense.layer_rendering import Facets, LayerImage, drawn, log_ratios, surface_facets
from workbench.likelihoods.dense.surface_elements import Cells, motion_of, moved_by, placed, surface_cells, visible
from workbench.likelihoods.dense.view_likelihood import Residuals, Sight, at, person_mask, pictures
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.errors import InputError

BLURS_PX = (6.0, 3.0, 1.2)
"""Smoothings of the image, b, one after the other."""
FOREGROUND_SIGMA = 0.25
"""Deviation s of how likely a pixel shows no scene, 0 to 1."""
MIN_FACING_COSINE = 0.3
"""Cosine of the angle to the line of sight below which a cell is not looked at."""
OUTLINE_SHARE = 0.25
"""Of the outline's loss in a misfit: it bends late, so that it says less of what is wrong than of what is unknown."""
PIXEL_SHARE = 1.0 / 10.0
"""As how many independent pixels one counts where the image is compared as layers, by every THIN-th row and column."""
FEW = 20.0
"""As many points of a limb say as much of its misfit as the whole person does."""


@dataclass(frozen=True, eq=False)
class DenseAlignment:
    """Compare the person with the image, smoothed more and then less:

        log p = − λ Σ_i ρ_2( (I_b(x_i) − T_b,i) / (σ √(1 + 1/n_i)) ) − λ Σ_j ρ_10( (F_b(x_j) − M_b(x_j)) / s )

    x_i: pixels of the visible cells of the limbs' surfaces. I_b: the image smoothed by b px. T_b,i: the level that the
    cell showed before, in n_i frames. x_j: the same pixels, and others beside the limbs (`surface_elements.beside`). F:
    how likely the image shows no scene there; M: the pose's outline; both smoothed by b. ρ_c = ½ c² r² / (c² + r²),
    Geman & McClure's loss. λ: as how many independent pixels one of them counts. A pose is judged at the last b.

    Derivatives are Gauss–Newton; that of the outline is the mean of F's and M's (Malis 2004). After a frame, cells
    learn from the expected pose: T += g (I − T), g = w max(1/(n + 1), rate), w being the loss's weight; scene and
    occluders are followed in `background_model`. Poses far apart are compared by all pixels of every THIN-th row and
    column (`layer_rendering`).

    sigma: σ, grey levels. count: λ. rate: as above. epsilon: share of outliers in the scene. n_frames: of the clip,
    evenly spread, from which the scene behind the person is learned. Raises InputError when a constant is out of range
    and for a camera that was not in the clip."""

    traits: ClassVar[Traits] = offering(DERIVATIVES, dataset=IMAGES, given=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    sigma: float = 10.0
    pixel_weight: float = 1.0 / 12.0
    learning_rate: float = 0.1
    outlier_fraction: float = 0.05
    n_frames: int = 60

    def __post_init__(self) -> None:
        check("alignment", self, sigma=POSITIVE, pixel_weight=POSITIVE, learning_rate=UNIT)
        check("alignment", self, outlier_fraction=INSIDE_UNIT, n_frames=at_least(3))

    @cached_property
    def cells(self) -> Cells:
        """Those of the body."""
        return surface_cells(self.body.limbs)

    @cached_property
    def facets(self) -> Facets:
        """What is drawn for them."""
        return surface_facets(self.body.limbs, self.cells)

    def facets_on(self, joints: BoolArray) -> Facets:
        """Those that hang on some of the joints (J,), found once."""
        key = joints.tobytes()
        if key not in self._facets_on:
            self._facets_on[key] = self.facets.on(joints)
        return self._facets_on[key]

    @cached_property
    def _facets_on(self) -> dict[bytes, Facets]:
        return {}

    @cached_property
    def moves(self) -> FloatArray:
        """Which numbers of the pose move what hangs on each joint, (J, P)."""
        return moved_by(self.body.skeleton)

    @cached_property
    def images(self) -> Mapping[str, Mapping[int, Float32Array]]:
        """Grey images of the clip, evenly spread, by the camera's name and the frame's index."""
        found: dict[str, dict[int, Float32Array]] = {}
        for frame in spaced_frames(self.clip, self.n_frames):
            for view in frame.views:
                found.setdefault(view.camera.name, {})[frame.index] = grey_levels(view, 0.0)
        return found

    def refitted(self, frame: Frame, poses: Mapping[int, FloatArray]) -> Likelihood:
        """The likelihood of a clip that was tracked before, by poses (P,) for indices of its frames, and that begins
        with `frame`: the scene is known wherever the person was not, and how they look is learned anew."""
        view_states = {}
        for view in frame.views:
            images = {i: image for i, image in self._images_of(view.camera).items() if i in poses}
            persons = [self._person(view, poses[i]) for i in images]
            scene = background_model.tracked_scene([*images.values()], persons)
            person = self._person(view, poses[frame.index])
            view_states[view.camera.name] = self._newly_seen(scene, grey_levels(view, 0.0), person)
        return Remembering(view_states, self._look)

    def prepare(self, previous: Frame | None, frame: Frame) -> "_AlignmentLook":
        """Look at a frame, the person still unknown."""
        return self._look({}, previous, frame)

    def _look(self, view_states: Mapping[str, ViewState], previous: Frame | None, frame: Frame) -> "_AlignmentLook":
        sights, notes = [], []
        for view in frame.views:
            seen = view_states.get(view.camera.name)
            if seen is not None:
                sights.append(self._sight(seen, view))
            elif previous is not None:
                notes.append(f"alignment: nothing is known yet of how {view.camera.name} sees the person")
        return _AlignmentLook(self, view_states, frame, tuple(sights), tuple(notes))

    def _sight(self, seen: ViewState, view: View) -> tuple[Sight, ViewState]:
        """Look at a view, and find what passes there, before the person is found."""
        image = grey_levels(view, 0.0)
        ratio = seen.scene.log_ratio(image, self.outlier_fraction)
        seen = seen.followed(image, ratio)
        foreground = (1.0 / (1.0 + np.exp(-2.0 * ratio))).astype(np.float32)
        levels, shown = pictures([image, foreground], BLURS_PX)
        return Sight(view.camera, levels, shown, seen.scene.known, ~seen.hidden, ratio), seen

    def residuals(self, sight: Sight, seen: ViewState, level: int, frames: JointFrames) -> tuple[Residuals, Residuals]:
        """Measure how far a pose, whose joints' frames are given, is from what one camera shows."""
        cells = placed(self.cells, frames, sight.camera)
        shown = visible(cells, sight.shape, MIN_FACING_COSINE)
        view_states = shown[seen.n[shown] > 0.0]
        sigma = self.sigma * np.sqrt(1.0 + 1.0 / seen.n[view_states])
        joints = self.cells.joints
        texture = sight.texture(level, cells, view_states, joints[view_states], seen.texture[level, view_states], sigma)
        blur = BLURS_PX[level]
        outline = sight.outline(level, blur, self.body, frames, cells, shown, joints[shown], FOREGROUND_SIGMA)
        return texture, outline

    def learned(self, seen: ViewState | None, view: View, pose: FloatArray, sight: Sight | None = None) -> ViewState:
        """Learn from a view, at which one has looked or not, and its expected pose (P,)."""
        image, person = grey_levels(view, 0.0), self._person(view, pose)
        if seen is None:
            scene = background_model.first_scene([*self._images_of(view.camera).values()], person)
            seen = self._newly_seen(scene, image, person)
        cells = placed(self.cells, forward(self.body.skeleton, pose[None]), view.camera)
        shown = visible(cells, (image.shape[0], image.shape[1]), MIN_FACING_COSINE)
        shown = shown[at(~seen.hidden, cells.pixels[shown]) > 0.0]
        levels = pictures([image], BLURS_PX)[0] if sight is None else sight.levels
        seen = seen.with_texture(levels, shown, cells.pixels[shown], self.sigma, self.learning_rate)
        return seen.with_person(image, person)

    def _images_of(self, camera: Camera) -> Mapping[int, Float32Array]:
        if camera.name not in self.images:
            raise InputError(f"likelihood: camera {camera.name} was not in the clip that it was learned from")
        return self.images[camera.name]

    def _person(self, view: View, pose: FloatArray) -> BoolArray:
        shape = view.image.shape[0], view.image.shape[1]
        return person_mask(self.body, view.camera, forward(self.body.skeleton, pose[None]), shape)

    def _newly_seen(self, scene: BackgroundModel, image: Float32Array, person: BoolArray) -> ViewState:
        return background_model.newly_seen(scene, image, person, len(BLURS_PX), len(self.cells.limbs))


@dataclass(frozen=True, eq=False)
class _AlignmentLook:
    """A look at one frame by an alignment: what the cameras show of whom they know."""

    likelihood: DenseAlignment
    view_states: Mapping[str, ViewState]
    frame: Frame
    sights: tuple[tuple[Sight, ViewState], ...]
    notes: tuple[str, ...] = ()

    @property
    def diagnostics(self) -> Mapping[str, float]:
        """How much of the images is hidden by what passes."""
        parts = [1.0 - float(sight.free.mean()) for sight, _ in self.sights]
        return {"passing": float(np.mean(parts)) if parts else 0.0}

    @property
    def levels(self) -> int:
        """How many smoothings there are, from most to least."""
        return len(BLURS_PX)

    @property
    def informative(self) -> bool:
        """Whether some camera knows the scene."""
        return bool(self.sights)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P), one after the other; the previous ones do not matter."""
        finite = finite_rows(pose)
        losses = np.array([self.slope(each, self.levels - 1, derive=False).log_prob for each in pose[finite]])
        return replace(among_finite("alignment", finite, losses), diagnostics=self.diagnostics)

    def slope(self, pose: FloatArray, level: int, derive: bool = True) -> Slope:
        """Log likelihood of a pose (P,) at a smoothing, with its derivatives unless they are not asked for."""
        own, size = self.likelihood, len(pose)
        frames = forward(own.body.skeleton, pose[None])
        motion = motion_of(own.body.skeleton, own.moves, pose, frames)
        loss, gradient, curvature = 0.0, np.zeros(size), np.zeros((size, size))
        for sight, seen in self.sights:
            for part in own.residuals(sight, seen, level, frames):
                loss += own.pixel_weight * part.loss
                if derive:
                    uphill, bent = part.normal(motion, sight.camera)
                    gradient -= own.pixel_weight * uphill
                    curvature += own.pixel_weight * bent
        return Slope(-loss, gradient, curvature)

    def compare(self, poses: FloatArray, moved: BoolArray) -> FloatArray:
        """By how much (N,) likelier the images are, as layers, in poses (N, P), which differ in what hangs on the
        joints `moved` (J,) alone, than without that; a pixel counts PIXEL_SHARE."""
        own, frames, total = self.likelihood, forward(self.likelihood.body.skeleton, poses), np.zeros(len(poses))
        for sight, seen in self.sights:
            camera, image, ratio, free = sight.thinned
            shown = LayerImage(image, ratio, free, seen.texture[-1], seen.n, own.sigma)
            behind = drawn(own.facets_on(~moved), frames, camera, image.shape)
            total += PIXEL_SHARE * log_ratios(behind, own.facets_on(moved), frames, camera, shown)
        return total

    def misfit(self, pose: FloatArray) -> FloatArray:
        """How badly what every joint (J,) moves fits, at the last smoothing: the mean loss of the texture at its cells
        and OUTLINE_SHARE of that of the outline, what is the whole person's being worth FEW points more."""
        own = self.likelihood
        frames, below = forward(own.body.skeleton, pose[None]), descendants(own.body.skeleton)
        moved = (below | np.eye(len(below), dtype=np.bool_)).astype(np.float64)
        sums = np.zeros((2, 2, len(moved)))  # of losses and of points, of texture and outline
        for sight, seen in self.sights:
            for kind, part in enumerate(own.residuals(sight, seen, self.levels - 1, frames)):
                for row, weights in enumerate((part.losses, part.counts)):
                    sums[kind, row] += moved @ np.bincount(part.joints, weights, len(moved))
        whole = sums[:, 0, :1] / np.maximum(sums[:, 1, :1], 1.0)
        texture, outline = (sums[:, 0] + FEW * whole) / (sums[:, 1] + FEW)
        return np.asarray(texture + OUTLINE_SHARE * outline)

    def update(self, expected_pose: FloatArray) -> Remembering[Mapping[str, ViewState]]:
        """The likelihood of the next frame; a pose that is not finite teaches nothing."""
        own, view_states = (
            self.likelihood,
            {**self.view_states, **{sight.camera.name: seen for sight, seen in self.sights}},
        )
        if np.isfinite(expected_pose).all():
            looked = {sight.camera.name: sight for sight, _ in self.sights}
            for view in self.frame.views:
                name = view.camera.name
                view_states[name] = own.learned(view_states.get(name), view, expected_pose, looked.get(name))
        return Remembering(view_states, own._look)
