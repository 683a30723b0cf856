"""Whatever the pose and the person, the files hold the same joints."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.motion.formats.bvh import bvh_text, read_bvh

singular = st.sampled_from([0.0, -0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-9])
angle = st.one_of(st.floats(-7.0, 7.0), singular)
place = st.floats(-100.0, 100.0)


@settings(max_examples=60, deadline=None)
@given(
    position=st.tuples(place, place, place),
    angles=st.lists(angle, min_size=22, max_size=22),
    height_m=st.floats(0.5, 2.5),
    unit=st.sampled_from(["cm", "m"]),
)
def test_a_bvh_file_holds_the_joints_of_the_pose(position, angles, height_m, unit):
    skeleton = person_skeleton(from_height(height_m))
    poses = np.array([[*position, *angles]])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.bvh"
        path.write_text(bvh_text(skeleton, poses, 30.0, unit))
        clip = read_bvh(path, unit)
    # Depth first, as the hierarchy is written, is the skeleton's own order. Six decimals of metres: 0.87e-6 m for each
    # of up to four places in a chain; those of degrees, 1e-8 rad in up to nine turns, add 2e-7 m.
    np.testing.assert_allclose(clip.positions[0], joints(skeleton, poses)[0], atol=4e-6)
