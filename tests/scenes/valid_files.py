"""Small valid files of every input format."""

import h5py
import numpy as np

from workbench.motion.library import write_library
from workbench.motion.synthetic.gait import subjects, walker

BVH = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT arm
  {
    OFFSET 0 100 0
    CHANNELS 3 Xrotation Zrotation Yrotation
    End Site
    {
      OFFSET 50 0 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 2 3 4 5 6 7 8 9
1 2 3 4 5 6 7 8 9
"""
ASF = """:units
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    name thigh
    direction 0 -1 0
    length 7
    axis 0 0 20 XYZ
    dof rx ry
  end
  begin
    name shin
    direction 0 -1 0
    length 7
    axis 0 0 20 XYZ
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""
AMC = """# comment
:FULLY-SPECIFIED
:DEGREES
5
root 0 0 0 0 0 0
thigh 1 2
6
root 0 0 0 0 0 0
thigh 1 2
"""
TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n60\t60\t2\t2\tm\n"
    "Frame#\tTime\tneck\t\t\tleft_ankle\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n1\t0\t0\t1.5\t0\t0\t0.1\t0\n2\t0\t0\t1.5\t0\t0\t\t\n"
)
TOML = (
    "[left]\nsize = [64, 48]\nmatrix = [[80.0, 0.0, 31.0], [0.0, 80.0, 23.0], [0.0, 0.0, 1.0]]\n"
    "distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [1.2, 1.2, -1.2]\ntranslation = [0.0, 0.0, 4.0]\n"
    "[metadata]\na = 1\n"
)
YAML = (
    "seed: 3\nprior: {_target_: workbench.priors.smooth.Smooth, sigma: 1.0e-05, names: [a, b]}\n"
    "dataset: {motion: x}\nnote: c\nstudy: null\n"
)
ANNOTATIONS = "frame,joint,u,v,visible\n3,neck,31,23,1\n3,left_ankle,10.5,40,0\n10,neck,5,6,1\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    "1 2 3\n4 5 6\n"
)


def written(path, content):
    """Write a file and return its path."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def library(path):
    """Write a motion library of one short motion."""
    (subject,) = subjects(1, np.random.default_rng(0))
    write_library(path, [walker(subject, 0.2, 30.0)])
    return path


def points(path):
    """Write three frames of points in HDF5."""
    with h5py.File(path, "w") as file:
        for k in range(2):
            file[f"frames/{k}"] = np.arange(12.0).reshape(4, 3)
        file.create_dataset("frames/2", data=np.ones((50, 3)), chunks=(10, 3), compression="gzip")
    return path


def c3d(path):
    """Write two markers in two frames."""
    import ezc3d

    file, places = ezc3d.c3d(), np.ones((4, 2, 2))
    places[2, 0] = 1500.0
    file["data"]["points"] = places
    file["data"]["meta_points"]["residuals"] = np.zeros((1, 2, 2))
    file["parameters"]["POINT"]["RATE"]["value"] = [60.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["neck", "left_ankle"]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file.write(str(path))
    return path
