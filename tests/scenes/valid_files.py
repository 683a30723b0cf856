"""Small valid files of every input format."""

import json

import cv2
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

STEREO = """%YAML:1.0
---
image_size: [ 640, 480 ]
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]
M2: [ 500., 510., 320., 240. ]
D1: [ -1.e-01, 2.e-02, 0., 0., 0. ]
D2: [ 0., 0., 0., 0. ]
R: [ 0., 0.1, 0. ]
T: [ -0.5, 0., 0. ]
"""
LENS = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>500. 0. 320. 0. 500. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients>-1.e-01 2.e-02 0. 0. 0. 0. 0. 0.</distortion_coefficients>
</opencv_storage>
"""
QUALISYS = """<calibration><cameras>
<camera serial="a" model="Miqus Video" viewrotation="0"><fov_video left="0" top="0" right="639" bottom="479"/>
<transform x="1000" y="0" z="1500" r11="1" r12="0" r13="0" r21="0" r22="0" r23="1" r31="0" r32="-1" r33="0"/>
<intrinsic focalLengthU="32000" focalLengthV="32000" centerPointU="20480" centerPointV="15360" radialDistortion1="-0.1"
radialDistortion2="0.1" radialDistortion3="0" tangentalDistortion1="0.001" tangentalDistortion2="0"/></camera>
</cameras></calibration>
"""
VICON = """<?xml version="1.0" encoding="UTF-8" standalone="no" ?>
<Cameras VERSION="1.0"><Camera DEVICEID="1" TYPE="VideoInputDevice" PIXEL_ASPECT_RATIO="1" SENSOR_SIZE="640 480">
<KeyFrames><KeyFrame FOCAL_LENGTH="500" ORIENTATION="0.5 0.5 -0.5 0.5" POSITION="1000 0 1500"
PRINCIPAL_POINT="320 240" VICON_RADIAL2="Vicon3Parameter 320 240 1e-7 1e-14 0"/></KeyFrames></Camera></Cameras>
"""
HUMANEVA = "500 500 320 240 0 -0.1 0.1 0.001 0 0 1 0 0 0 0 -1 0 1 0 100 200 3000\n"
MULTICAL = json.dumps({
    "cameras": {
        name: {"model": "standard", "image_size": [640, 480], "K": [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0],
               [0.0, 0.0, 1.0]], "dist": [[-0.1, 0.1, 0.0, 0.0, 0.0]]} for name in "ab"
    },
    "camera_poses": {name: {"R": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "T": [0.5, 0.0, 0.0]}
                     for name in ("a", "b_to_a")},
})  # fmt: skip
MC_CALIB = """%YAML:1.0
---
camera_0:
   camera_matrix: { rows: 3, cols: 3, data: [ 500., 0., 320., 0., 500., 240., 0., 0., 0. ] }
   distortion_vector: [ -0.1, 0.1, 0., 0., 0. ]
   distortion_type: 0
   camera_group: 0
   img_width: 640
   img_height: 480
   camera_pose_matrix: { rows: 4, cols: 4, data: [ 1., 0., 0., 2., 0., 1., 0., 3., 0., 0., 1., 4., 0., 0., 0., 1. ] }
"""


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


def write_storage(path, **values):
    """Write values as OpenCV does; return the path."""
    storage = cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
    for key, value in values.items():
        storage.write(key, value)
    storage.release()
    return path
