"""A small scene for the cues on a GPU, and what a GPU finds of it, as JSON:

python gpu_scene.py

With NUMBA_ENABLE_CUDASIM=1 numba plays the GPU, a Python thread for each of its threads: hence so few pixels.
"""

import json

import numpy as np
from likelihood_scenes import PERSON, begun, distorted, frame, people, texture
from still_clips import of_frames

from workbench.body.camera import plain_camera
from workbench.likelihoods.appearance import Appearance
from workbench.likelihoods.edges import Edges
from workbench.likelihoods.edges.model import BINS, EdgeModel
from workbench.likelihoods.silhouette import Silhouette

PARTS = ("torso", "head", "upper_arm", "forearm", "hand", "thigh", "calf")
CAMERAS = (
    distorted(plain_camera(32, 24, 36.0, (4.0, 0.0, 0.0), (0.0, 0.0, 0.0), name="front")),
    plain_camera(24, 32, 45.0, (0.5, -3.5, 0.5), (0.0, 0.0, 0.0), name="side"),
)


def grey():
    """An image (24, 30) of grey levels."""
    return texture(np.random.default_rng(3), 30, 24).astype(np.float32)


def poses():
    """Poses (13, 25), one of them not finite."""
    found = people(np.random.default_rng(1), 13)
    found[0], found[4, 7] = 0.0, np.nan
    return found


def looks():
    """Looks by appearance, edges and silhouette at the second frame that two cameras see of noise."""
    rng = np.random.default_rng(0)
    still, first, second = (
        frame(i, *((camera, texture(rng, camera.width, camera.height)) for camera in CAMERAS)) for i in range(3)
    )
    edges = Edges(PERSON)
    counts = rng.integers(1, 100, (2, 2, len(PARTS), BINS)).astype(float)
    edges.__dict__["log_ratio"] = EdgeModel(PARTS, counts[0], counts[1]).log_ratio(PERSON.limbs.names)
    cues = (Appearance(PERSON), edges, Silhouette(PERSON, of_frames([still] * 3)))
    return [begun(cue, first, np.zeros(25)).look(first, second) for cue in cues]


def main():
    from workbench.likelihoods.gpu import looks as gpu
    from workbench.likelihoods.gpu.images import filtered_on_gpu

    def evaluated(some):
        found = gpu.evaluate_on_gpu(some, poses())
        return [(each.log_prob.tolist(), each.notes) for each in found]

    every = looks()
    found = {"together": evaluated(every)}
    gpu.CHUNK = 9
    gpu.kept_lanes.cache_clear()
    found["alone, in chunks"] = [evaluated([look])[0] for look in every]
    found["filtered"] = [array.copy_to_host().tolist() for array in filtered_on_gpu(grey())]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
