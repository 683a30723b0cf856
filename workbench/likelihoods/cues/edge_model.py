"""How edge and ridge filters respond on limbs and elsewhere, learned from rendered people (Sidenbladh & Black 2003)."""

import logging
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.core.frame import View
from workbench.datasets.synthetic import Synthetic
from workbench.likelihoods.cues.edge_filters import POINTS, filtered, responses, smoothed
from workbench.likelihoods.cues.limb_points import limb_points, looked_up
from workbench.motion.models.store import Provenance, keep, load
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.source_hash import code_digest

log = logging.getLogger(__name__)

BINS = 32
EDGE_RANGE, RIDGE_RANGE = (0.0, 1.0), (-1.0, 1.0)  # of the responses; beyond, they belong to the last bin
OUTLIERS = 0.05  # share of responses that say nothing
SCENES, FRAMES = 10, 5  # rendered people, and frames of each to learn from
NOT_LEARNED = ("neck", "foot")
"""Limbs that only some bodies have: nothing is learned of their edges, which are not looked at."""
_FIRST_SEED = 1000  # of clothes, backgrounds and walks that no experiment renders
_DISPLACED = 8  # wrong poses for every true one


@dataclass(frozen=True, eq=False)
class EdgeModel:
    """Counts of responses by limb part. parts: names of G limbs, without left and right. on, off: (2, G, BINS), of
    edges and of ridges, on the limbs and with the body displaced."""

    parts: tuple[str, ...]
    on: FloatArray
    off: FloatArray

    def log_ratio(self, limbs: Sequence[str]) -> Float32Array:
        """log p(response | on) − log p(response | off), (2, L, BINS), of limbs by name. A share `OUTLIERS` of either is
        what both have in common, so that bins hardly ever met say little. 0 of those NOT_LEARNED, which a warning says.
        Raises InputError for another limb that the model does not have."""
        parts = [_part(name) for name in limbs]
        unknown = sorted(set(parts) - set(self.parts))
        if strange := [part for part in unknown if part not in NOT_LEARNED]:
            raise InputError(f"edges: the model knows {', '.join(self.parts)}, but not the limb {strange[0]!r}")
        if unknown:
            log.warning("edges: not looked at on %s, of which nothing is learned", " and ".join(unknown))
        every = (self.on, self.off, self.on + self.off + 1.0)
        on, off, common = (counts / counts.sum(axis=-1, keepdims=True) for counts in every)
        ratio = np.log((1.0 - OUTLIERS) * on + OUTLIERS * common) - np.log((1.0 - OUTLIERS) * off + OUTLIERS * common)
        ratio = np.concatenate([ratio, np.zeros((2, 1, BINS))], axis=1)  # the last of those not learned
        return ratio[:, [-1 if part in unknown else self.parts.index(part) for part in parts]].astype(np.float32)


def edge_model(cache: str) -> EdgeModel:
    """The model of rendered people, from the folder `cache` or learned anew, which takes half a minute."""
    code = code_digest(sys.modules[__name__])
    provenance = Provenance({}, {"scenes": SCENES, "frames": FRAMES, "bins": BINS, "seed": _FIRST_SEED}, (), code)
    path = Path(cache).expanduser() / "models" / f"edges-{provenance.key[:16]}.h5"
    if path.is_file():
        return load(EdgeModel, path)
    log.info("learning edges and ridges from rendered people")
    rng = np.random.default_rng(_FIRST_SEED)
    return keep(path, learn_edges(rendered_people(rng), rng), provenance)


def rendered_people(rng: np.random.Generator) -> Iterable[tuple[Body, View, FloatArray]]:
    """Views of walkers of all sorts, with their bodies and true poses (P,)."""
    for scene in range(SCENES):
        dataset = Synthetic(
            path=("straight", "circle")[scene % 2], n_frames=FRAMES, rate_hz=4.0,
            view_deg=float(rng.uniform(30.0, 150.0)), person_px=float(rng.uniform(200.0, 340.0)),
            contrast=float(rng.uniform(0.5, 1.5)), clutter=float(rng.uniform(0.5, 1.5)), seed=_FIRST_SEED + scene,
            exact=True,  # where limbs are is to be learned from, as if they were marked by hand
        )  # fmt: skip
        for frame in dataset.frames():
            if frame.truth is not None and frame.truth.pose is not None:
                yield dataset.body, frame.views[0], frame.truth.pose


def learn_edges(seen: Iterable[tuple[Body, View, FloatArray]], rng: np.random.Generator) -> EdgeModel:
    """Count the responses at true poses (P,), and at the same displaced in the image by 5 to 60 cm."""
    counts: dict[str, FloatArray] = {}
    for body, view, pose in seen:
        angle, far = rng.uniform(0.0, 2.0 * np.pi, _DISPLACED), rng.uniform(0.05, 0.6, _DISPLACED)
        poses = np.repeat(pose[None], 1 + _DISPLACED, axis=0)
        right, down, _ = view.camera.rotation
        poses[1:, :3] += np.outer(far * np.cos(angle), right) + np.outer(far * np.sin(angle), down)
        points = limb_points(body, POINTS, view.camera, forward(body.skeleton, poses))
        edges, ridges, looked_at = responses(filtered(smoothed(view), looked_up(points)), points)
        kinds = ((edges, looked_at[..., [0, 2]], EDGE_RANGE), (ridges, looked_at[..., 1], RIDGE_RANGE))
        for limb, name in enumerate(body.limbs.names):
            found = counts.setdefault(_part(name), np.zeros((2, 2, BINS)))
            for kind, (values, counted, (low, high)) in enumerate(kinds):
                for on, rows in enumerate((slice(0, 1), slice(1, None))):
                    inside = np.clip(values[rows, limb][counted[rows, limb]], low, np.nextafter(high, low))
                    found[on, kind] += np.histogram(inside, BINS, (low, high))[0]
    if not counts:
        raise InputError("edges: expected views of people to learn from")
    on, off = np.stack(list(counts.values()), axis=2)
    return EdgeModel(tuple(counts), on, off)


def _part(limb: str) -> str:
    return limb.removeprefix("left_").removeprefix("right_")
