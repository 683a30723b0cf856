"""The walking model by paper B: period, alignment and functional PCA instead of gait events and whole cycles."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.cycle_alignment import Alignment, align
from workbench.motion.models.functional_pca import Slices, cut, fpca_shrunk
from workbench.motion.models.period import find_period
from workbench.motion.models.walking import CHANNEL_NAMES, SPEED_WEIGHT, WalkingModel, motion_channels
from workbench.motion.pose_sequence import LONGEST_S, SHORTEST_S, Motion
from workbench.utils.errors import InputError

LEAST_OBSERVED = 0.5
log = logging.getLogger(__name__)


def learn_cyclic(motions: Sequence[Motion], q: int = 5, n_phases: int = 64) -> WalkingModel:
    """The walking model of motions with q components (paper B, section 2); missing angles are NaN in their poses.

    A missing position or heading makes the torso's speed missing. Motions in which no period is found are left out,
    with a warning. Raises InputError when fewer than two are left, or they hold too few cycles.

    Deviation: slices seen by less than half, the ends of the sequences, are left out, because what is imputed in
    them pulls the coefficients' standard deviations towards zero.
    """
    sequences, periods, rates = [], [], []
    for motion in motions:
        channels = motion_channels(motion)
        channels[:, 0] *= SPEED_WEIGHT
        try:
            period = find_period(channels[:, 1:], SHORTEST_S * motion.rate_hz, LONGEST_S * motion.rate_hz)
        except InputError as error:
            log.warning("%s left out of the training set: %s", motion.name, error)
            continue
        sequences.append(channels)
        periods.append(period)
        rates.append(motion.rate_hz / period)
    if len(sequences) < 2:
        raise InputError(f"prior: expected two motions with a period or more, found {len(sequences)} of {len(motions)}")
    alignment = align([channels[:, 1:] for channels in sequences], periods)
    slices = cut(sequences, _from_left_thigh_ahead(alignment), n_phases)
    kept = slices.observed.mean(axis=(1, 2)) >= LEAST_OBSERVED
    slices = Slices(slices.values[kept], slices.observed[kept], slices.sequence[kept], slices.cycle[kept])
    pca = fpca_shrunk(slices, q)
    weights = np.array([SPEED_WEIGHT] + [1.0] * (len(CHANNEL_NAMES) - 1))
    return WalkingModel(
        mean=pca.mean / weights, components=pca.components / weights, scales=pca.scales,
        cycle_rate_hz=(float(np.mean(rates)), float(np.std(rates, ddof=1))), explained=pca.explained,
        n_cycles=len(slices.values),
    )  # fmt: skip


def _from_left_thigh_ahead(alignment: Alignment) -> Alignment:
    """Turn the alignment of joint angles with phase 0 where the left thigh is furthest ahead of the right."""
    first = len(POSE_NAMES) - alignment.reference.shape[1]
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") - first for side in ("left", "right"))
    ahead = int(np.argmax(alignment.reference[:, left] - alignment.reference[:, right]))
    offsets = (alignment.offsets - ahead / len(alignment.reference)) % 1.0
    return replace(alignment, offsets=offsets, reference=np.roll(alignment.reference, -ahead, axis=0))
