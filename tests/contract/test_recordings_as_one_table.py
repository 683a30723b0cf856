"""All kinds of recordings fit into one table: each component has one type and is either static or temporal.

Rerun's catalog rejects recordings whose columns differ in type. It also rejects a union, such as bars and tensors, that
is static in one recording and temporal in another.
"""

from pathlib import Path

import pytest
from kinds_of_recordings import write_kinds
from rerun.chunk import RrdReader

BASELINES = Path(__file__).parents[2] / "recordings" / "baselines"


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    return write_kinds(tmp_path_factory.mktemp("kinds"))


def test_a_component_has_one_type_and_is_logged_in_one_way(fresh):
    kinds: dict[tuple[str, str], dict[tuple[bool, str], str]] = {}
    for path in (*BASELINES.glob("*.rrd"), *fresh.glob("*.rrd")):
        for chunk in RrdReader(path).stream():
            schema = chunk.to_record_batch().schema
            for field in schema:
                if not field.name.startswith("rerun.") and field.name not in ("frame", "time"):
                    kind = (chunk.is_static, str(field.type))
                    kinds.setdefault((chunk.entity_path, field.name), {})[kind] = path.name
    assert len(kinds) > 500
    assert {component: files for component, files in kinds.items() if len(files) > 1} == {}
