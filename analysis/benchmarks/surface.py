"""Time of the implicit surface: residuals F, residuals with their Jacobian J, and the attachment of points to parts.

    python -m analysis.benchmarks.surface

Prints microseconds for 400 points, the minimum over the repeats, of the kernels and of their NumPy oracle, on the
25-parameter person and on the same person with a joint in the middle of every bone: 29 joints, 75 degrees of freedom,
as paper D's body (28 joints, about 80). (F and J) / F is what D's section 4 bounds by the logarithm of their number;
"ratio with attach" counts the search for the points' parts in both.
Everything is measured in one process, in turns, so that other load hits all alike.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from analysis.benchmarks.machine import processor, versions
from tests.oracles import surface as oracle
from workbench.body.kinematics import forward
from workbench.body.limbs import person, skeleton_limbs
from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.body.surface import (
    KINDS,
    Surface,
    attach,
    limbs_surface,
    person_surface,
    residual_jacobian,
    residuals,
)
from workbench.utils.arrays import FloatArray

N_POINTS, REPEATS = 400, 300


def main() -> None:
    body = person(from_height(1.75))
    many = with_middle_joints(body.skeleton)
    print(f"{processor()}, 1 thread; {versions()}")
    print(f"{N_POINTS} points; µs, minimum of {REPEATS} repeats (of the reference: {REPEATS // 100})\n")
    print("dofs  ellipsoids  kind          F   F and J   ratio   attach   ratio with attach   reference F and J")
    for skeleton, surface in ((body.skeleton, person_surface(body)), (many, limbs_surface(skeleton_limbs(many)))):
        _print_rows(skeleton, surface, np.random.default_rng(0))


def _print_rows(skeleton: Skeleton, surface: Surface, rng: np.random.Generator) -> None:
    pose = 0.2 * rng.standard_normal(len(skeleton.dof_names))
    frames = forward(skeleton, pose[None])
    carriers = rng.integers(len(surface), size=N_POINTS)
    centers = np.einsum("kab,kb->ka", frames.rotations[0, surface.joints[carriers]], surface.centers[carriers])
    points = frames.positions[0, surface.joints[carriers]] + centers + 0.06 * rng.standard_normal((N_POINTS, 3))
    for kind in KINDS:
        attachment = attach(surface, frames, points, kind)
        arguments = (skeleton, surface, pose, points, kind, attachment)
        plain, full, search = _fastest_us(
            [
                partial(residuals, *arguments),
                partial(residual_jacobian, *arguments),
                partial(attach, surface, frames, points, kind),
            ],
            REPEATS,
        )
        (reference,) = _fastest_us([partial(oracle.residual_jacobian, *arguments)], REPEATS // 100)
        print(
            f"{len(pose):<6}{len(surface):<12}{kind:<10}{plain:>5.0f}{full:>10.0f}{full / plain:>8.2f}{search:>9.0f}"
            f"{(full + search) / (plain + search):>20.2f}{reference:>20.0f}"
        )


def with_middle_joints(skeleton: Skeleton) -> Skeleton:
    """The same bones, each with a joint in its middle, and three turns for every joint but the ends."""
    names, parents, offsets = [skeleton.names[0]], [-1], [np.zeros(3)]
    for parent, joint in skeleton.bones:
        above = names.index(skeleton.names[parent])
        names += [f"{skeleton.names[joint]}_middle", skeleton.names[joint]]
        parents += [above, len(names) - 2]
        offsets += [0.5 * skeleton.offsets[joint]] * 2
    turning = [joint for joint in range(1, len(names)) if joint in parents]
    axes = [*skeleton.dof_axes[:N_ROOT], *np.tile(np.eye(3), (len(turning), 1))]
    return Skeleton(
        names=tuple(names),
        parents=np.array(parents),
        offsets=np.array(offsets),
        dof_names=(*skeleton.dof_names[:N_ROOT], *(f"{names[joint]}_{axis}" for joint in turning for axis in "xyz")),
        dof_joints=np.repeat([0, *turning], [N_ROOT, *[3] * len(turning)]),
        dof_axes=np.array(axes),
        limits=np.tile([-1e6, 1e6], (len(axes), 1)),
    )


def _fastest_us(timed: Sequence[Callable[[], object]], repeats: int) -> FloatArray:
    """Fastest run of each function, µs; they take turns, after one round that compiles and fills caches."""
    times = np.empty((repeats + 1, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            start = time.perf_counter()
            function()
            repeat[column] = time.perf_counter() - start
    fastest: FloatArray = 1e6 * times[1:].min(axis=0)
    return fastest


if __name__ == "__main__":
    main()
