"""Recordings of all kinds are rows of one table: each component is of one type, and either static or over frames.

Rerun's catalog refuses a recording whose columns differ from those of another, or are static in one and over frames in
the other where they are unions, as bars and tensors are.
"""

from importlib.util import find_spec
from pathlib import Path

import pytest
from kinds_of_recordings import leave_kinds
from rerun.chunk import RrdReader

from workbench.results.gallery import gallery
from workbench.results.table import read_runs

BASELINES = Path(__file__).parents[2] / "recordings" / "baselines"


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    return leave_kinds(tmp_path_factory.mktemp("kinds"))


def test_a_component_is_of_one_type_and_logged_in_one_way(fresh):
    kinds: dict[tuple[str, str], dict[tuple[bool, str], str]] = {}
    for path in (*BASELINES.glob("*.rrd"), *fresh.glob("*.rrd")):
        for chunk in RrdReader(path).stream():
            schema = chunk.to_record_batch().schema
            for field in schema:
                if not field.name.startswith("rerun.") and field.name not in ("frame", "time"):
                    kind = (chunk.is_static, str(field.type))
                    kinds.setdefault((chunk.entity_path, field.name), {})[kind] = path.name
    assert len(kinds) > 500
    assert {component: found for component, found in kinds.items() if len(found) > 1} == {}


@pytest.mark.skipif(find_spec("datafusion") is None, reason="needs the extra 'catalog'")
@pytest.mark.slow
def test_all_baselines_and_all_kinds_are_in_one_gallery(fresh, monkeypatch):
    monkeypatch.setattr(
        "workbench.recording.read.crash_probe.crashing_recordings", lambda paths: set()
    )  # a process for each takes long
    found = read_runs(*sorted(BASELINES.glob("*.rrd")), fresh)
    with gallery(found) as served:
        assert served.left_out == []
        assert served.n_runs == len(list(BASELINES.glob("*.rrd"))) + 3 == len(found)
