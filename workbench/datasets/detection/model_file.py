"""The file of a landmark model: a path of the user's own, or BlazePose's, downloaded once into the cache.

BlazePose's landmark models are by The MediaPipe Authors, under the Apache License 2.0. They are not part of the
workbench: `full` is taken out of a wheel on PyPI, whose other contents are not installed.
"""

import hashlib
import logging
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

FULL = "pose_landmark_full.tflite"
FULL_SHA256 = "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f"
_WHEEL = "mediapipe==0.10.21"
_MEMBER = f"mediapipe/modules/pose_landmark/{FULL}"
_PLATFORM = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.12", "--only-binary", ":all:")
_TIMEOUT_S = 600.0


def model_file(model: str, cache: Path) -> Path:
    """Return the path of a landmark model.

    Parameters
    ----------
    model : "full" for BlazePose's, which is downloaded into `cache` where it is not there yet; else a path.
    cache : folder for what can be made again.

    Raises
    ------
    InputError
        For a path that is no file, and where the model can neither be found nor downloaded.
    """
    if model != "full":
        path = Path(model).expanduser()
        if not path.is_file():
            raise InputError(f"{model}: no such model; expected 'full' or the path of a BlazePose landmark model")
        return path
    path = cache.expanduser() / "models" / FULL
    if not path.is_file():
        log.info("downloading BlazePose's landmark model (Apache License 2.0) out of %s from PyPI, 35 MB", _WHEEL)
        content = _downloaded(path)
        with whole_file(path, parents=True) as part:
            part.write_bytes(content)
    if _sha256(path.read_bytes()) != FULL_SHA256:
        raise InputError(f"{path}: not BlazePose's {FULL} of {_WHEEL}; delete the file to download it again")
    return path


def _downloaded(path: Path) -> bytes:
    """Return the content of the model, out of the wheel that pip downloads."""
    by_hand = f"put {FULL} of {_WHEEL} at {path}, or choose a model file by --model PATH"
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "--no-deps", "--quiet", *_PLATFORM, "-d", folder, _WHEEL]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"BlazePose's landmark model: cannot be downloaded ({error}); {by_hand}") from None
        wheels = list(Path(folder).glob("*.whl"))
        if done.returncode or len(wheels) != 1:
            reason = next(iter(done.stderr.strip().splitlines()[-1:]), "pip failed")
            raise InputError(f"BlazePose's landmark model: cannot be downloaded ({reason}); {by_hand}")
        with zipfile.ZipFile(wheels[0]) as wheel:
            content = wheel.read(_MEMBER)
    if _sha256(content) != FULL_SHA256:
        raise InputError(f"BlazePose's landmark model: {_WHEEL} holds another file than expected; {by_hand}")
    return content


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
