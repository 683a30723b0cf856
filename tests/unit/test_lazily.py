"""A module is run when something of it is first asked for."""

import sys

import pytest

from workbench.lazily import lazily


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package `late_rooms` with a module `late` that counts how often it is run."""
    (tmp_path / "late_rooms").mkdir()
    (tmp_path / "late_rooms" / "__init__.py").write_text("runs = []")
    (tmp_path / "late_rooms" / "late.py").write_text("from late_rooms import runs\nruns.append(1)\nvalue = 3\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield "late_rooms"
    for name in ("late_rooms.late", "late_rooms"):
        sys.modules.pop(name, None)


def test_it_is_run_once_and_only_when_it_is_used(package):
    late = lazily(f"{package}.late")
    assert sys.modules[package].runs == []
    assert late.value == 3
    from late_rooms import late as again

    assert again is late is lazily(f"{package}.late")
    assert again.value == 3
    assert sys.modules[package].runs == [1]


def test_a_name_that_is_none_is_said_at_once(package):
    with pytest.raises(ModuleNotFoundError, match=r"late_rooms\.nowhere"):
        lazily(f"{package}.nowhere")
