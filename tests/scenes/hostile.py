"""Files that were changed at random, and what every reader says of them: `python hostile.py KIND CASES SEED [FOLDER]`.

A process of its own, as a reader may end it. It prints one line of JSON: how many cases were read, how many were
refused in a sentence, the first of those that ended otherwise, the slowest in s, and the most memory in MB.
"""

import io
import json
import logging
import os
import resource
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
from hostile_hdf5 import changed_c3d, changed_hdf5, flipped
from omegaconf import OmegaConf

from workbench import apart, hdf5
from workbench.body.camera import load_cameras
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES
from workbench.core.postures import Postures
from workbench.datasets.files.marks import read_marks
from workbench.datasets.files.point_formats import read_csv, read_hdf5, read_npz, read_ply
from workbench.errors import LONGEST, InputError
from workbench.learning.linear_motion import LinearMotion
from workbench.learning.store import Provenance, load, save
from workbench.limits import parse_yaml
from workbench.mocap import c3d
from workbench.mocap.asf_amc import read_amc, read_asf
from workbench.mocap.bvh import read_bvh
from workbench.mocap.generated.gait import subjects, walker
from workbench.mocap.library import read_library, write_library
from workbench.mocap.marker_files import read_markers
from workbench.mocap.openpose import read_openpose
from workbench.recording.read.properties import check_settings, checked

HANG_S = 5.0
"""Seconds of the processor, of all processes of a case: what else the machine does counts nothing."""

ASLEEP_S = 600.0
MEMORY_BYTES = 4 << 30

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
    id 1
    name arm
    direction 1 0 0
    length 5
    axis 0 0 0 XYZ
    dof rx ry rz
    limits (-1 2)
  end
:hierarchy
  begin
    root arm
  end
"""
AMC = ":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 1 2 3 4 5\narm 1 2 3\n2\nroot 0 1 2 3 4 5\narm 1 2 3\n"
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
TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n60\t60\t2\t2\tm\n"
    "Frame#\tTime\tneck\t\t\tleft_ankle\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n1\t0\t0\t1.5\t0\t0\t0.1\t0\n2\t0\t0\t1.5\t0\t0\t\t\n"
)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    "1 2 3\n4 5 6\n"
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
MARKS = "frame,joint,u,v,visible\n3,neck,31,23,1\n3,left_ankle,10.5,40,0\n10,neck,5,6,1\n"
TOKENS = (
    b"nan", b"inf", b"-1", b"0", b"1e300", b"-1e18", b"9" * 30, b"9" * 5000, b"[" * 3000, b"{" * 3000, b"a." * 3000,
    b"(" * 2000, b"\x00", b"\xff\xfe", "\u2028é٣".encode(), b"\xed\xa0\x80", b"\n", b"\t" * 50, b'"', b"'" * 3, b",",
    b":",
    b"}", b"]", b"&a [*a, *a]", b"!!python/object:os.system {}", b"!!set {x}", b"2026-01-01", b"!!binary aGk=", b"null",
    b"true", b"#", b"1_000", b"x" * 200_000, b"- " * 500, b"? ", b"{JOINT", b"1" + b"0" * 400, b"\\ud800", b"..", b"~",
)  # fmt: skip


def mutated(content, rng):
    """Change bytes in one to four ways."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, len(data) + 1))
        span = int(min(len(data) - at, rng.integers(1, 1 + max(1, len(data) // 4))))
        match int(rng.integers(0, 8)):
            case 0 if at < len(data):
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del data[at : at + span]
            case 2:
                data[at:at] = data[at : at + span]
            case 3:
                data[at:at] = TOKENS[int(rng.integers(0, len(TOKENS)))]
            case 4:
                del data[at:]
            case 5:
                lines = bytes(data).split(b"\n")
                a, b = rng.integers(0, len(lines), 2)
                lines[a], lines[b] = lines[b], lines[a]
                data = bytearray(b"\n".join(lines))
            case 6:
                words = bytes(data).split(b" ")
                words[int(rng.integers(0, len(words)))] = TOKENS[int(rng.integers(0, len(TOKENS)))]
                data = bytearray(b" ".join(words))
            case _:
                data[at : at + span] = rng.bytes(span)
    return bytes(data)


def a_library(path):
    """A library of one short motion."""
    (subject,) = subjects(1, np.random.default_rng(0))
    write_library(path, [walker(subject, 0.2, 30.0)])


def a_model(path):
    """A model of the simplest kind."""
    n, few, full = len(POSE_NAMES), len(POSE_NAMES) - 4, 2 * len(POSE_NAMES) - 4
    taken = Postures(np.ones(1), np.zeros((1, few)), np.eye(few)[None])
    model = LinearMotion(
        30.0, np.zeros((n, full)), np.zeros(n), np.eye(n), np.zeros((n, few)), np.zeros(n), np.eye(n), taken
    )
    save(path, model, Provenance({"a": "b"}, {"c": 1}, ("d",)))


def some_points(path):
    """Two frames of points."""
    with h5py.File(path, "w") as file:
        for k in range(2):
            file[f"frames/{k}"] = np.arange(12.0).reshape(4, 3)
        file.create_dataset("frames/2", data=np.ones((50, 3)), chunks=(10, 3), compression="gzip")


def a_c3d(path):
    """Two markers in two frames."""
    import ezc3d

    file, points = ezc3d.c3d(), np.ones((4, 2, 2))
    points[2, 0] = 1500.0
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.zeros((1, 2, 2))
    file["parameters"]["POINT"]["RATE"]["value"] = [60.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["neck", "left_ankle"]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file.write(str(path))


def some_npz(path):
    """An archive of one array."""
    np.savez_compressed(path, points=np.arange(12.0).reshape(4, 3))


def openpose(n):
    """One person of n points."""
    return json.dumps({"people": [{"pose_keypoints_2d": [float(k % 7) for k in range(3 * n)]}]})


def read_folder(path):
    """A folder with one of a detector's files."""
    return read_openpose(path.parent)


def read_points(path):
    """All frames of points."""
    return list(read_hdf5(path))


def read_model(path):
    """A learned model."""
    return load(LinearMotion, path)


def read_recorded(path):
    """A recorded configuration."""
    found = parse_yaml(path, path.read_bytes().decode("utf-8", "surrogateescape"))
    if isinstance(found, dict):
        check_settings(path, found)


KINDS = {
    "bvh": ("a.bvh", BVH, read_bvh), "asf": ("a.asf", ASF, read_asf), "amc": ("a.amc", AMC, read_amc),
    "trc": ("a.trc", TRC, read_markers), "c3d": ("a.c3d", a_c3d, read_markers), "ply": ("a.ply", PLY, read_ply),
    "csv": ("a.csv", "x,y,z,w\n1,2,3,4\n4,5,6,7\n", read_csv), "marks": ("a.csv", MARKS, read_marks),
    "toml": ("a.toml", TOML, load_cameras), "json": ("a_1.json", openpose(25), read_folder),
    "yaml": ("a.yaml", YAML, read_recorded), "npz": ("a.npz", some_npz, read_npz),
    "library": ("a.h5", a_library, read_library), "points": ("a.h5", some_points, read_points),
    "models": ("a.h5", a_model, read_model),
}  # fmt: skip
"""By kind: the file's name, what is in a sound one, and its reader."""

OWN_PROCESS = ("c3d", "library", "points", "models")
"""Kinds whose readers are libraries in C, tried in a process of their own."""


def prepare(kind, folder):
    """Leave a sound file of a kind in the folder; its path and its bytes."""
    name, sound, _ = KINDS[kind]
    path = folder / name
    if callable(sound):
        sound(path)
    else:
        path.write_text(sound)
    if kind == "amc":
        (folder / "a.asf").write_text(ASF)
    return path, path.read_bytes()


ATOMS = (
    "a", "", "complete", "nan", "\ud800", "x" * 1000, 0, 1, -1, 2**40, 10**400, 3.5, float("nan"), float("inf"), 1e300,
    True, None, b"x", [], [1.0, 2.0], ["a", "b"], ["a", 1], [[1.0], [2.0]], [None], {"a": 1}, [{"a": 1}], (1, 2),
)  # fmt: skip


def some_properties(rng):
    """What a run records of itself, with a few values of other kinds."""
    found = {
        "run": {"id": "a", "status": "complete", "format": 2, "platform": "x"},
        "config": {"TextDocument:text": YAML},
        "provenance": {"experiment": "walk", "seed": 3, "choices": ["prior=a", "body=b"], "workbench": "0.1"},
        "body": {"joints": list(JOINT_NAMES), "pose": list(POSE_NAMES)},
        "shape": {name: list(v) if isinstance(v, tuple) else v for name, v in from_height(1.7).as_dict().items()},
        "metrics": {"error_abs_mm": 1.0, "frames": 3.0}, "cost": {"seconds": 1.0},
        "marginals": {"names": ["a"], "units": ["m"], "low": 0.0, "high": 1.0, "frames": [0.0, 1.0]},
    }  # fmt: skip
    for _ in range(int(rng.integers(1, 4))):
        name = list(found)[int(rng.integers(0, len(found)))]
        if not isinstance(found[name], dict) or not found[name]:
            continue
        key = list(found[name])[int(rng.integers(0, len(found[name])))]
        if rng.random() < 0.15:
            del found[name][key]
        elif (name, key) == ("config", "TextDocument:text"):
            found[name][key] = mutated(YAML.encode(), rng).decode("utf-8", "surrogateescape")
        else:
            found[name][key] = ATOMS[int(rng.integers(0, len(ATOMS)))]
    return found


def read_properties(folder, rng):
    """Give a run of such properties, beside a sound one, to what report, view, export and check make of it."""
    from workbench.cli.export import _skeleton
    from workbench.cli.view import names
    from workbench.experiment.stored import runnable, tolerances
    from workbench.recording.compare.compare import compare
    from workbench.recording.read.chunks import Curve
    from workbench.recording.read.reader import Joints, Run
    from workbench.report.contents import contents, group_csv, run_csv
    from workbench.report.groups import group_runs
    from workbench.report.page import terminal

    curve = {"error_abs_mm": Curve(np.arange(3), np.ones((3, 1)))}
    plain = {"run": {"id": "b", "status": "complete"}, "config": {"TextDocument:text": YAML}, "provenance": {"seed": 3}}
    sound = Run(folder / "b.rrd", {**plain, "metrics": {"error_abs_mm": 2.0}}, curve)
    hostile = Run(folder / "a.rrd", checked(folder / "a.rrd", some_properties(rng)), curve)
    _ = hostile.status, hostile.format, hostile.platform, hostile.is_study
    grouping = group_runs([hostile, sound])
    shown = terminal(contents(grouping)) + group_csv(grouping) + run_csv(grouping)
    shown.encode()
    assert grouping.groups, "the sound one is hidden"
    _ = hostile.settings
    names([hostile, sound])
    nothing = np.empty(0, dtype=np.int64), np.empty((0, len(POSE_NAMES)))
    where = Joints(JOINT_NAMES, np.empty(0, dtype=np.int64), np.empty((0, len(JOINT_NAMES), 3)))
    for one in (hostile, sound):
        one.__dict__.update(poses=nothing, figures=(), marginals=None, note=None, joints=where, true_joints=where)
        one.__dict__["scalars"] = {"estimate/pose": None}
    own = OmegaConf.create({"paths": {"data": None, "cache": "/c"}, "check": {"default": {}}})
    compare(hostile, hostile, tolerances(hostile, own))
    if not hostile.is_study:
        _skeleton(hostile, "a recording")
    runnable(hostile, [], own)


def in_another_process(change, *arguments):
    """Call what changes a file in a fork, as the library that writes HDF5 now and then ends whoever called it."""
    if (child := os.fork()) == 0:
        with suppress(Exception):
            change(*arguments)
        os._exit(0)
    os.waitpid(child, 0)


def changed(kind, path, content, rng):
    """Change the file of a kind: any bytes, a few bits, or, where a library wrote it, what it holds."""
    way = rng.random()
    if kind not in OWN_PROCESS or way < 0.2:
        path.write_bytes(mutated(content, rng))
        return
    if way < 0.6:
        path.write_bytes(flipped(content, rng))
    elif kind == "c3d":
        path.write_bytes(changed_c3d(content, rng))
    else:
        path.write_bytes(content)
        in_another_process(changed_hdf5, path, np.random.default_rng(rng.integers(2**32)))
        if way > 0.9:
            path.write_bytes(flipped(path.read_bytes(), rng))


def forked(command, files):
    """Begin what `python -m MODULE PATH` does, but for starting Python, which takes most of the time. files: those that
    it reads, writes, and complains to."""
    _, _, _, module, path = command
    if child := os.fork():
        return child
    code = 1
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, file in enumerate(files):
            os.dup2(file, number)
        os.closerange(3, max(files) + 1)  # what the other end holds, too, which else would not be seen to end
        sys.stdin = io.TextIOWrapper(os.fdopen(0, "rb"))
        sys.stdout, sys.stderr = (io.TextIOWrapper(os.fdopen(number, "wb")) for number in (1, 2))
        apart.bounded(path, {"workbench.hdf5": hdf5._tell, "workbench.mocap.c3d": c3d._points}[module])
        code = 0
    except SystemExit as end:
        code = end.code
    finally:
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(code)


def in_a_fork(command, **_):
    """What `subprocess.run` does of such a command."""
    nothing, out, error = os.open(os.devnull, os.O_RDONLY), os.memfd_create("out"), os.memfd_create("error")
    child = forked(command, (nothing, out, error))
    try:
        _, status = os.waitpid(child, 0)
    except TimeoutError:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise
    said = [os.pread(file, os.fstat(file).st_size, 0) for file in (out, error)]
    for file in (nothing, out, error):
        os.close(file)
    return subprocess.CompletedProcess(command, os.waitstatus_to_exitcode(status), *said)


class Forked:
    """What `subprocess.Popen` does of such a command."""

    def __init__(self, command, *, stderr, **_):
        (read, stdin), (stdout, write) = os.pipe(), os.pipe()
        self.child, self.code = forked(command, (read, write, stderr.fileno())), None
        os.close(read), os.close(write)
        self.stdin, self.stdout = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.wait(), self.stdin.close(), self.stdout.close()

    def wait(self):
        if self.code is None:
            self.code = os.waitstatus_to_exitcode(os.waitpid(self.child, 0)[1])
        return self.code

    def kill(self):
        if self.code is None:
            os.kill(self.child, signal.SIGKILL)


def spent_s():
    """Seconds of the processor so far, of this process and of those that it began."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def most_mb():
    """Most memory that this process or one it began has held, MB.

    Not by `ru_maxrss` of this one, which counts what its parent held when it began this one.
    """
    (own,) = (line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    return max(int(own), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) // 1024


def run(kind, cases, seed, folder):
    """Read so many changed files; what became of them."""
    rng = np.random.default_rng(seed)
    told = {"kind": kind, "cases": cases, "slowest_s": 0.0}
    told |= dict.fromkeys(("read", "refused", "long", "hangs", "tracebacks"), 0)
    first = []
    if kind == "properties":  # once, as what it imports takes seconds
        with suppress(InputError):
            read_properties(folder, np.random.default_rng(0))
    path, content = (None, b"") if kind == "properties" else prepare(kind, folder)
    reader = (lambda _: read_properties(folder, rng)) if kind == "properties" else KINDS[kind][2]
    for _ in range(cases):
        if path is not None:
            changed(kind, path, content, rng)
        began = spent_s()
        try:
            signal.setitimer(signal.ITIMER_REAL, ASLEEP_S)
            reader(path)
            told["read"] += 1
        except InputError as error:
            told["refused"] += 1
            told["long"] += len(str(error)) > LONGEST
        except Exception as error:  # noqa: BLE001 (what is counted)
            told["hangs" if isinstance(error, TimeoutError) else "tracebacks"] += 1
            where = traceback.extract_tb(error.__traceback__)[-1]
            first.append(f"{type(error).__name__}: {str(error)[:100]} at {Path(where.filename).name}:{where.lineno}")
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        told["slowest_s"] = round(max(told["slowest_s"], spent_s() - began), 3)
    told["most_mb"] = most_mb()
    return {**told, "first": sorted(set(first))[:20]}


def _out_of_time(*_):
    raise TimeoutError


def main(kind, cases, seed, folder=None):
    """Run one kind in a folder of its own, with bounded memory."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    signal.signal(signal.SIGALRM, _out_of_time)
    warnings.simplefilter("ignore")
    logging.disable()
    if kind in OWN_PROCESS:
        apart.subprocess = SimpleNamespace(
            run=in_a_fork, Popen=Forked, PIPE=subprocess.PIPE, TimeoutExpired=subprocess.TimeoutExpired
        )
    if kind == "c3d":
        import ezc3d  # noqa: F401 (before all forks)
    with tempfile.TemporaryDirectory() as made:
        print(json.dumps(run(kind, int(cases), int(seed), Path(folder or made))), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
