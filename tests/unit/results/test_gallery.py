"""Runs as cards: what the catalog serves of them, to whom, and what is said of those left out."""

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
    """What a gallery serves, and the client, without which it says nothing."""
    from rerun.catalog import CatalogClient

    server, _, dataset = served.url.rpartition("/entry/")
    client = CatalogClient(server)
    return client.get_dataset(id=dataset), client


def rows(served):
    """The table of the runs that a gallery serves, by their cards' titles."""
    dataset, _client = dataset_of(served)
    table = dataset.segment_table().to_pandas()
    return table.set_index(table["property:card:title"].str[0])


@served_by_catalog
def test_a_card_has_a_title_and_numbers_and_any_key_is_a_column(root):
    with gallery(read_runs(root)) as served:
        table = rows(served)
    assert served.left_out == []
    varied = ("smooth, n_particles=100", "smooth, n_particles=400", "walking, n_particles=100")
    assert set(table.index) == {f"walk_straight: {each}" for each in varied}
    row = table.loc["walk_straight: smooth, n_particles=400"]
    assert row["property:card:mpjpe_abs_mm"] == [10.33]  # of 10.333…, which is a column, too
    assert row["property:metrics:mpjpe_abs_mm"] == [10.0 + 1 / 3]
    assert row["property:card:status"] == ["complete"]
    assert row["property:card:path"] == [str(root / "1")]
    assert row["property:card:rank"] == [1.0]  # the newest is the first
    assert sorted(each[0] for each in table["property:settings:inference_n_particles"]) == [100.0, 100.0, 400.0]
    assert {each[0] for each in table["property:choices:prior"]} == {"smooth", "walking"}


@served_by_catalog
def test_nothing_but_this_machine_is_listened_to(root):
    mine = psutil.Process()
    before = {each.laddr for each in mine.net_connections() if each.status == psutil.CONN_LISTEN}
    with gallery(read_runs(root)) as served:
        during = {each.laddr for each in mine.net_connections() if each.status == psutil.CONN_LISTEN} - before
        assert [each.ip for each in during] == ["127.0.0.1"]
        assert f"127.0.0.1:{next(iter(during)).port}/" in served.url


@served_by_catalog
def test_what_cannot_be_served_is_left_out_in_a_sentence(root, tmp_path):
    write_recorded_run(tmp_path / "thief", "run 1", prior="stolen", day=1)
    write_run(tmp_path / "early", status="failed")
    write_run(tmp_path / "torn")
    whole = (root / "0" / "run.rrd").read_bytes()
    (tmp_path / "torn" / "run.rrd").write_bytes(whole[: len(whole) // 2])
    with gallery(read_runs(root, tmp_path)) as served:
        assert served.n_runs == 3
        assert not any("stolen" in title for title in rows(served).index)
    with pytest.raises(InputError, match="has no recording"), gallery(read_runs(tmp_path / "early")):
        pass
    told = "\n".join(sorted(served.left_out))
    assert f"left out: {tmp_path / 'thief'}: it has the same id as {root / '1'}" in told
    assert f"left out: {tmp_path / 'early'}: it has no recording (failed)" in told
    assert f"left out: {tmp_path / 'torn' / 'run.rrd'}: expected a whole Rerun recording" in told


@served_by_catalog
def test_hostile_texts_are_shown_and_do_nothing(tmp_path):
    hostile = "<script>alert(1)</script>\n../../\x1b[31m" + "x" * 10_000
    write_recorded_run(tmp_path / "hostile", "../../../etc/passwd", prior=hostile, experiment=hostile,
                   settings={hostile: 1.0, "prior": {"_target_": hostile}, "a": {"b": hostile}, "": 3})  # fmt: skip
    write_recorded_run(tmp_path / "good", "good", day=2)
    with gallery(read_runs(tmp_path)) as served:
        table = rows(served)
    assert served.n_runs == 2
    assert all(len(title) <= 200 and title.isprintable() for title in table.index)
    assert max(map(len, table.columns)) < 200


def test_without_the_extra_a_sentence_says_what_installs_it(root, monkeypatch):
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"-e '\.\[catalog\]'"), gallery(read_runs(root)):
        pass
