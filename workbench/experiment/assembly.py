"""From a configuration to the parts of a run."""

import logging
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager

from omegaconf import DictConfig

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.dataset import Known
from workbench.core.frame_cache import FrameCache
from workbench.core.likelihood import Likelihood
from workbench.core.prior import Prior
from workbench.core.step import Inference
from workbench.experiment.config.compatibility import incompatibility, unread
from workbench.experiment.config.instantiate import build
from workbench.experiment.config.lacking import what_lacks
from workbench.experiment.tracking import Parts
from workbench.inference.initialization.from_keypoints import trajectory_of_keypoints
from workbench.inference.initialization.poses import start_poses
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

Stage = Callable[[str], AbstractContextManager[None]]
"""Takes the time of a named stage."""


def assemble(config: DictConfig, stage: Stage, names: Mapping[str, str] | None = None) -> Parts:
    """Build dataset, body, prior, likelihood and inference, and find the starting pose.

    names: the options chosen, by group, for what is refused. Raises InputError, before anything is built, when the
    configuration leaves out what it needs, and for parts that cannot work together.
    """
    if lacking := [name for name in ("dataset", "body", "inference") if config[name] is None]:
        raise InputError(
            f"config: {lacking[0]} is null; a run that tracks needs one: choose an option, {lacking[0]}=NAME"
        )
    if sentence := what_lacks(config, names or {}) or incompatibility(config, names or {}):
        raise InputError(sentence)
    with stage("dataset"):
        clip = FrameCache(build(config.dataset))
    known = clip.known
    body: Body = build(config.body, known=known, clip=clip)
    with stage("prior_learning"):
        prior: Prior | None = None if config.prior is None else build(
            config.prior, camera=lambda: _only_camera(known), frames_hz=known.rate_hz,
            trajectory=lambda: trajectory_of_keypoints(body.skeleton, clip),
        )  # fmt: skip
    _check_skeletons(known, body, prior)
    live = {"body": body, "clip": clip, "known": known, "phase_ends": known.phase_ends, "prior": prior}
    if ignored := unread(config):
        log.info("the %s is not built: this inference looks at none", ignored[0])
    unused = ignored or config.likelihood is None
    likelihood: Likelihood | None = None if unused else build(config.likelihood, **live)
    inference: Inference = build(config.inference, likelihood=likelihood, **live)
    with stage("start"):
        start = None
        if known.start_pose is not None or known.start_marks is not None or not inference.finds_start:
            start, sentence = start_poses(prior, body, clip)
            if sentence:
                log.info(sentence)
    return Parts(clip, body, prior, inference, start)


def _only_camera(known: Known) -> Camera:
    if len(known.cameras) != 1:
        raise InputError(f"prior: limbs flip before one camera, found {len(known.cameras)}")
    return known.cameras[0]


def _check_skeletons(known: Known, body: Body, prior: Prior | None) -> None:
    """Raise InputError where dataset, body and prior do not speak of one skeleton."""
    if known.body is not None and known.body.skeleton.names != body.skeleton.names:
        raise InputError("body: dataset.skeleton=full shows every joint of the motion file: choose body=dataset")
    if unknown := [name for name in (prior.parameters if prior else ()) if name not in body.skeleton.dof_names]:
        raise InputError(
            f"prior: it moves {unknown[0]}, which the tracked body does not have; dataset.skeleton and prior.skeleton "
            "must be the same"
        )
