"""Commands that read files, with small valid inputs of every kind."""

import json
import shlex
from contextlib import suppress

import cv2
import h5py
import numpy as np
import valid_files
from crowd_scenes import CAMERAS, walkers
from openpose_scenes import points, write
from rendered_boards import COLUMNS, ROWS, board_poses, lens, rendered
from run_folders import write_run
from skeleton_files import walk_bvh
from small_recordings import record
from video_files import video

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera_file import write_cameras
from workbench.cli.main import main
from workbench.detections.readers.formats import LAYOUTS
from workbench.results.evaluate.joint_files import SEVENTEEN

N_FRAMES = 16
VIEWS = {name: camera.scaled(0.25) for name, camera in CAMERAS.items()}
(WALK,) = walkers([((-0.6, 0.1), (0.9, 0.1))], n_frames=N_FRAMES, rate_hz=15.0)
CAMERA_FILES = {
    "b.yml": valid_files.STEREO, "b.xml": valid_files.LENS, "b.qca.txt": valid_files.QUALISYS,
    "b.xcp": valid_files.VICON, "b.cal": valid_files.HUMANEVA, "b.json": valid_files.MULTICAL,
    "mccalib.yml": valid_files.MC_CALIB, "b.toml": valid_files.TOML,
}  # fmt: skip
_ASF_LEG = "".join(
    f"begin\n name {side}{bone}\n direction {f'{sign} 0 0' if bone in ('hipjoint', 'clavicle') else '0 -1 0'}\n"
    f"length {length}\naxis 0 0 0 XYZ\n{dof}end\n"
    for side, sign in (("l", 1), ("r", -1))
    for bone, length, dof in (
        ("hipjoint", 2.0, ""), ("femur", 7.3, "dof rx ry rz\n"), ("tibia", 7.3, "dof rx\n"), ("foot", 2.0, ""),
        ("clavicle", 3.0, ""), ("humerus", 5.0, "dof rx ry rz\n"), ("radius", 4.0, "dof rx\n"), ("wrist", 1.0, ""),
    )
)  # fmt: skip
ASF = (
    ":units\nlength 0.45\nangle deg\n:root\norder TX TY TZ RX RY RZ\naxis XYZ\nposition 0 0 0\norientation 0 0 0\n"
    f":bonedata\n{_ASF_LEG}begin\nname upperneck\ndirection 0 1 0\nlength 9\naxis 0 0 0 XYZ\nend\n"
    "begin\nname head\ndirection 0 1 0\nlength 3\naxis 0 0 0 XYZ\nend\n:hierarchy\nbegin\n"
    "root lhipjoint rhipjoint upperneck\n" + "".join(
        f"{s}hipjoint {s}femur\n{s}femur {s}tibia\n{s}tibia {s}foot\n"
        f"{s}clavicle {s}humerus\n{s}humerus {s}radius\n{s}radius {s}wrist\n"
        for s in "lr") + "upperneck head lclavicle rclavicle\nend\n"
)  # fmt: skip
AMC = ":FULLY-SPECIFIED\n:DEGREES\n" + "".join(
    f"{k}\nroot 0 17 {k / 10} 0 0 0\nlfemur {k} 0 0\nltibia {k}\nrfemur {-k} 0 0\nrtibia 5\nlhumerus 1 2 3\n"
    f"rhumerus 1 2 3\nlradius 9\nrradius 9\n" for k in range(1, 12)
)  # fmt: skip
_MULTI = (
    "dataset=multi_view 'dataset.sources={front: front.mp4, left: left.mp4, back: back.mp4}' 'dataset.keypoints="
    "{front: json/front, left: json/left, back: json/back}' dataset.calibration_file=calib.toml"
)
_FIT = "body=keypoints prior=smooth likelihood=keypoints inference=least_squares hydra.run.dir=out"
_ONE = "check-calibration dataset=video dataset.source=front.mp4 body=height body.height_m=1.65 -o out"
_CALIBRATED = "dataset.camera_name=front dataset.calibration_file=calib.toml"
_POINTS = (
    "run experiment=custom dataset=point_files dataset.rate_hz=10 body=height body.height_m=1.69 prior=activity "
    "prior.n_components=2 likelihood=surface_points inference=least_squares hydra.run.dir=out dataset.n_frames=2"
)
DETECTORS = (
    "one.json", "alpha.json", "mmpose.json", "inferencer.json", "coco.json", "sleap.csv", "mediapipe.csv", "dlc.csv",
    "annotations.csv", "text", "json/front",
)  # fmt: skip
_SHORT = "dataset.n_frames=2 inference.n_particles=8 hydra.run.dir=out paths.data=."
_OWN = "conf/experiment/mine.yaml conf/prior/own.yaml"
_COMMANDS = {
    "multi_view": (f"check-calibration {_MULTI} -o out", "json/*/*0003*.json calib.toml *.mp4"),
    "fit": (
        f"run experiment=custom {_FIT} {_MULTI} dataset.truth=walk.trc", "json/*/*0003*.json calib.toml walk.trc",
    ),
    "video": (f"{_ONE} dataset.keypoints=json/front {_CALIBRATED}", "front.mp4"),
    "images": (
        f"{_ONE} dataset.source=images dataset.rate_hz=15 dataset.keypoints=json/front {_CALIBRATED}", "images/1?.png",
    ),
    **{name: (f"{_ONE} dataset.keypoints={name} {_CALIBRATED}",
              f"{name}/*0003* {name}/3.txt" if "." not in name else name) for name in DETECTORS},
    **{name: (f"{_ONE} dataset.keypoints=json/front dataset.calibration_file={name}", name) for name in CAMERA_FILES},
    "easymocap": (f"{_ONE} dataset.keypoints=json/front dataset.calibration_file=intri.yml", "intri.yml extri.yml"),
    **{f"clouds {each}": (f"{_POINTS} dataset.source={each}", each if "." in each else f"{each}/1.*") for each in
       ("ply", "xyz", "csv", "npy", "npz", "pcd", "clouds.h5")},
    **{f"evaluate {each}": (f"evaluate walk.{each} --truth walk.trc --rate 15", f"walk.{each}") for each in
       ("trc", "csv", "bvh", "c3d", "mot", "npz", "npy", "rrd")},
    "evaluate plain": ("evaluate plain.csv --truth walk.npy --truth-rate 15 --align rigid", "plain.csv walk.npy"),
    "evaluate amc": ("evaluate 5_01.amc --truth walk.trc", "5.asf 5_01.amc"),
    "import bvh": ("import own.bvh -o out.h5", "own.bvh"),
    "export": ("export walk.rrd -o out.trc --intervals", "walk.rrd"),
    "overlay": ("export walk.rrd -o out.mp4", "walk.rrd"),
    "measure": ("measure walk.rrd -o out", "walk.rrd"),
    "check": ("check walk.rrd small.rrd", "walk.rrd small.rrd"),
    "repeat": ("run from=walk.rrd hydra.run.dir=out paths.data=.", "walk.rrd front.mp4"),
    "list": ("runs list . --columns varied", "runs/*/summary.json"),
    "query": ("runs list . mpjpe_abs_mm<50 seed=1,2 --sort -mpjpe_abs_mm --json", "runs/*/summary.json"),
    "compare": ("runs compare walk.rrd small.rrd --latex", "walk.rrd small.rrd"),
    "report": ("report walk.rrd small.rrd -o out.html", "walk.rrd small.rrd"),
    "diff": ("runs diff walk.rrd small.rrd", "walk.rrd small.rrd"),
    "board": (f"calibrate board one=boards --corners {COLUMNS}x{ROWS} --square-mm 50 -o out.toml", "boards/1.png"),
    "height": ("calibrate height front.mp4 annotations.csv --height-m 1.7 -o out.toml", "annotations.csv front.mp4"),
    "config": ("run --config-dir=conf experiment=mine hydra.run.dir=out --cfg job", _OWN),
    "own": ("run --config-dir=conf experiment=mine hydra.run.dir=out", _OWN),
    "sweep": ("run -m --config-dir=conf experiment=mine hydra.sweep.dir=out seed=1,2 sweep.objective=coverage_90",
              "conf/experiment/mine.yaml"),
    "library": (
        f"run experiment=walk_straight dataset.motion=library/motions.h5:walker_00_straight {_SHORT}",
        "library/motions.h5",
    ),
    "data": (f"run experiment=walk_straight dataset.motion=own.bvh prior=smooth {_SHORT}", "own.bvh"),
    "components": ("components prior.smooth inference experiment", ""),
    "track": ("track front.mp4 dataset.keypoints=json/front dataset.n_frames=8 -o out", "json/front/*0003*.json"),
}  # fmt: skip
COMMANDS = {name: (shlex.split(command), files.split()) for name, (command, files) in _COMMANDS.items()}
"""The arguments of each command, and patterns of the files that it reads."""
_EXPERIMENT = """# @package _global_
# A generated walk.
defaults:
  - override /dataset: synthetic
  - override /prior: own
  - override /likelihood: image_motion
assumptions: [initial_pose, limb_lengths, limb_radii, camera_calibration]
dataset: {n_frames: 2, motion: builtin}
inference: {n_particles: 8}
seed: 3
"""
_PRIOR = "_target_: workbench.priors.smooth.Smooth # A walk.\nsigma: {root_z: 0.05}\n"


def write_inputs(folder):
    """Write all inputs into a folder, which becomes the current one."""
    rows = _write_cameras(folder)
    _write_detections(folder, rows)
    _write_points(folder)
    walk_bvh(folder).rename(folder / "own.bvh")
    texts = {"5.asf": ASF, "5_01.amc": AMC, "conf/experiment/mine.yaml": _EXPERIMENT, "conf/prior/own.yaml": _PRIOR}
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        valid_files.written(folder / name, text)
    (folder / "library").mkdir()
    valid_files.library(folder / "library" / "motions.h5")
    for k in range(3):
        write_run(folder / "runs" / str(k), seed=k, error=10.0 + k)
    coco = [JOINT_NAMES.index(name) if name in JOINT_NAMES else 0 for name in SEVENTEEN["COCO"]]
    np.save(folder / "walk.npy", WALK[:, coco])
    np.savez(folder / "walk.npz", joints=WALK, names=np.array(JOINT_NAMES), fps=15.0)
    header = ",".join(["time", *(f"{name}_{axis}" for name in JOINT_NAMES for axis in "xyz")])
    table = np.column_stack([np.arange(N_FRAMES) / 15.0, WALK.reshape(N_FRAMES, -1)])
    np.savetxt(folder / "plain.csv", table, "%.4f", ",", header=header, comments="")
    (folder / "boards").mkdir()
    for k, pose in enumerate(board_poses(7)):
        cv2.imwrite(str(folder / "boards" / f"{k}.png"), rendered(lens(), *pose))
    record(folder / "small.rrd")


def write_motions(folder):
    """Fit the walk and export it in the formats of motion."""
    with suppress(SystemExit):
        main(["run", *COMMANDS["fit"][0][1:-1]])
    (folder / "out" / "run.rrd").rename(folder / "walk.rrd")
    for suffix in ("trc", "csv", "bvh", "c3d", "mot"):
        main(["export", "walk.rrd", "-o", f"walk.{suffix}"])


def _write_cameras(folder):
    """Write videos, images, OpenPose's files and camera files; return the points (F, 17, 3) of the front camera."""
    (folder / "images").mkdir()
    for name, camera in VIEWS.items():
        video(folder / f"{name}.mp4", N_FRAMES, 15.0, (320, 240))
        people = [dict(zip(JOINT_NAMES, pixels, strict=True)) for pixels in camera.project(WALK)]
        write(folder / "json" / name, {k: [points("BODY_25", each)] for k, each in enumerate(people)})
    for k in range(N_FRAMES):
        cv2.imwrite(str(folder / "images" / f"{k}.png"), np.full((240, 320, 3), 9 * k, np.uint8))
    write_cameras(folder / "calib.toml", list(VIEWS.values()), 0.1, {})
    for name, text in CAMERA_FILES.items():
        valid_files.written(folder / name, text)
    matrix = "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 250., 0., 160., 0., 250., 120., 0., 0., 1. ]\n"
    vector = "   rows: 3\n   cols: 1\n   dt: d\n   data: [ 1.2, 0.1, 0.3 ]\n"
    head = '%YAML:1.0\n---\nnames:\n   - "1"\n'
    (folder / "intri.yml").write_text(f"{head}K_1: !!opencv-matrix\n{matrix}H_1: 240\nW_1: 320\n")
    (folder / "extri.yml").write_text(f"{head}R_1: !!opencv-matrix\n{vector}T_1: !!opencv-matrix\n{vector}")
    pixels = VIEWS["front"].project(WALK)
    return np.array([points("COCO_17", dict(zip(JOINT_NAMES, each, strict=True))) for each in pixels])


def _write_detections(folder, rows):
    """Write the points (F, 17, 3) of a person in the formats of other detectors."""
    flat = [row.ravel().round(2).tolist() for row in rows]
    person = [{"keypoints": row[:, :2].tolist(), "keypoint_scores": row[:, 2].tolist()} for row in rows]
    dataset = {
        "images": [{"id": k, "file_name": f"{k}.png", "width": 320, "height": 240} for k in range(N_FRAMES)],
        "annotations": [{"image_id": k, "keypoints": each, "num_keypoints": 17} for k, each in enumerate(flat)],
    }
    files = {
        "one.json": [{"people": [{"pose_keypoints_2d": each}]} for each in flat],
        "alpha.json": [{"image_id": f"{k}.jpg", "keypoints": each, "score": 2.0} for k, each in enumerate(flat)],
        "mmpose.json": {"meta_info": {}, "instance_info": [
            {"frame_id": k, "instances": [each]} for k, each in enumerate(person)]},
        "inferencer.json": [[each] for each in person],
        "coco.json": dataset,
    }  # fmt: skip
    files["one.json"] = {f"{k}.jpg": each for k, each in enumerate(files["one.json"])}
    files["inferencer.json"] = [{"frame_id": k, "instances": each} for k, each in enumerate(files["inferencer.json"])]
    for name, content in files.items():
        (folder / name).write_text(json.dumps(content))
    names, table = LAYOUTS["COCO_17"], rows.reshape(N_FRAMES, -1)
    columns = {
        "sleap.csv": ["frame_idx", *(f"{name}.{axis}" for name in names for axis in ("x", "y", "score"))],
        "mediapipe.csv": ["frame", *(f"{axis}{k}" for k in range(17) for axis in ("x", "y", "v"))],
    }
    for name, header in columns.items():
        numbered = np.column_stack([np.arange(N_FRAMES), table])
        np.savetxt(folder / name, numbered, "%g", ",", header=",".join(header), comments="")
    parts = {"scorer": ["net"] * 51, "bodyparts": np.repeat(names, 3), "coords": ["x", "y", "likelihood"] * 17}
    lines = [[first, *cells] for first, cells in parts.items()]
    lines += [[str(k), *map(str, row)] for k, row in enumerate(table)]
    (folder / "dlc.csv").write_text("\n".join(map(",".join, lines)))
    marked = [f"{k},{name},{u:.1f},{v:.1f},1" for k in range(0, N_FRAMES, 3)
              for name, (u, v) in zip(JOINT_NAMES, VIEWS["front"].project(WALK[k]), strict=True)]  # fmt: skip
    (folder / "annotations.csv").write_text("\n".join(["frame,joint,u,v,visible", *marked, ""]))
    (folder / "text").mkdir()
    for k, row in enumerate(rows / [320.0, 240.0, 1.0]):
        (folder / "text" / f"{k}.txt").write_text(f"0 0.5 0.5 0.2 0.6 {' '.join(f'{x:.5f}' for x in row.ravel())}\n")


def _write_points(folder):
    """Write three frames of points about the joints in every format."""
    rng = np.random.default_rng(0)
    clouds = np.repeat(WALK[:3], 8, axis=1) + rng.normal(0.0, 0.04, (3, 8 * WALK.shape[1], 3))
    for k, cloud in enumerate(clouds):
        for name in ("ply", "xyz", "csv", "npy", "npz", "pcd"):
            (folder / name).mkdir(exist_ok=True)
        text = "\n".join(" ".join(f"{x:.3f}" for x in point) for point in cloud)
        ply = valid_files.PLY[: valid_files.PLY.index("1 2 3")].replace("vertex 2", f"vertex {len(cloud)}")
        (folder / "ply" / f"{k}.ply").write_text(f"{ply}{text}\n")
        (folder / "xyz" / f"{k}.xyz").write_text(f"{text}\n")
        (folder / "csv" / f"{k}.csv").write_text("x,y,z\n" + text.replace(" ", ",") + "\n")
        np.save(folder / "npy" / f"{k}.npy", cloud)
        np.savez(folder / "npz" / f"{k}.npz", points=cloud)
        head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(cloud)}\nHEIGHT 1\n"
        (folder / "pcd" / f"{k}.pcd").write_text(f"{head}POINTS {len(cloud)}\nDATA ascii\n{text}\n")
    with h5py.File(folder / "clouds.h5", "w") as file:
        for k, cloud in enumerate(clouds):
            file[f"frames/{k}"] = cloud
