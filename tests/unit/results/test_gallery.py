"""A gallery serves the runs as cards of a local catalog and reports the omitted ones."""

from importlib.util import find_spec

import psutil
import pytest
from run_folders import write_run
from small_recordings import write_recorded_run

from workbench.results import gallery as module
from workbench.results.gallery import gallery
from workbench.results.table import read_runs
from workbench.utils.errors import InputError

served_by_catalog = pytest.mark.skipif(find_spec("datafusion") is None, reason="needs the extra 'catalog'")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("gallery")
    for k, (prior, n) in enumerate([("smooth", 100), ("smooth", 400), ("walking", 100)]):
        write_recorded_run(root / str(k), f"run {k}", prior=prior, n=n, error=10.0 + k / 3, day=1 + k)
    return root


def dataset_of(served):
    """Return the data set that a gallery serves, and the client that it needs."""
    from rerun.catalog import CatalogClient

    server, _, dataset = served.url.rpartition("/entry/")
    client = CatalogClient(server)
    return client.get_dataset(id=dataset), client


def rows(served):
    """Return the table of the served runs, by the titles of their cards."""
    dataset, _client = dataset_of(served)
    table = dataset.segment_table().to_pandas()
    return table.set_index(table["property:card:title"].str[0])


@served_by_catalog
def test_a_card_has_a_title_and_metrics_and_all_keys_are_columns(root):
    with gallery(read_runs(root)) as served:
        table = rows(served)
    assert served.left_out == []
    labels = ("smooth, n_particles=100", "smooth, n_particles=400", "walking, n_particles=100")
    assert set(table.index) == {f"walk_straight: {label}" for label in labels}
    row = table.loc["walk_straight: smooth, n_particles=400"]
    assert row["property:card:mpjpe_abs_mm"] == [10.33]  # 10.333… rounded
    assert row["property:metrics:mpjpe_abs_mm"] == [10.0 + 1 / 3]
    assert row["property:card:status"] == ["complete"]
    assert row["property:card:path"] == [str(root / "1")]
    assert row["property:card:rank"] == [1.0]  # the newest run has rank 0
    assert sorted(value[0] for value in table["property:settings:inference_n_particles"]) == [100.0, 100.0, 400.0]
    assert {value[0] for value in table["property:choices:prior"]} == {"smooth", "walking"}


@served_by_catalog
def test_the_catalog_listens_on_this_machine_only(root):
    def listening():
        connections = psutil.Process().net_connections()
        return {connection.laddr for connection in connections if connection.status == psutil.CONN_LISTEN}

    before = listening()
    with gallery(read_runs(root)) as served:
        (address,) = listening() - before
        assert address.ip == "127.0.0.1"
        assert f"127.0.0.1:{address.port}/" in served.url


@served_by_catalog
def test_runs_without_a_readable_recording_of_their_own_are_omitted(root, tmp_path):
    write_recorded_run(tmp_path / "duplicate", "run 1", prior="other_prior", day=1)
    write_run(tmp_path / "failed", status="failed")
    write_run(tmp_path / "truncated")
    content = (root / "0" / "run.rrd").read_bytes()
    (tmp_path / "truncated" / "run.rrd").write_bytes(content[: len(content) // 2])
    with gallery(read_runs(root, tmp_path)) as served:
        assert served.n_runs == 3
        assert not any("other_prior" in title for title in rows(served).index)
    with pytest.raises(InputError, match="has no recording"), gallery(read_runs(tmp_path / "failed")):
        pass
    messages = "\n".join(sorted(served.left_out))
    assert f"left out: {tmp_path / 'duplicate'}: it has the same id as {root / '1'}" in messages
    assert f"left out: {tmp_path / 'failed'}: it has no recording (failed)" in messages
    assert f"left out: {tmp_path / 'truncated' / 'run.rrd'}: expected a whole Rerun recording" in messages


@served_by_catalog
def test_hostile_texts_become_printable_titles_and_short_columns(tmp_path):
    hostile = "<script>alert(1)</script>\n../../\x1b[31m" + "x" * 10_000
    write_recorded_run(tmp_path / "hostile", "../../../etc/passwd", prior=hostile, experiment=hostile,
                   settings={hostile: 1.0, "prior": {"_target_": hostile}, "a": {"b": hostile}, "": 3})  # fmt: skip
    write_recorded_run(tmp_path / "valid", "valid", day=2)
    with gallery(read_runs(tmp_path)) as served:
        table = rows(served)
    assert served.n_runs == 2
    assert all(len(title) <= 200 and title.isprintable() for title in table.index)
    assert max(map(len, table.columns)) < 200


def test_a_missing_extra_is_named(root, monkeypatch):
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"-e '\.\[catalog\]'"), gallery(read_runs(root)):
        pass
