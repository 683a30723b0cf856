"""What is recorded can be seen: no view of any baseline, nor of what today's code records, complains."""

import time
from importlib.util import find_spec
from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb
from headless import complaints, settled, state_of, viewer
from kinds_of_recordings import leave_kinds

from workbench.results.gallery import gallery
from workbench.results.table import read_runs

BASELINES = sorted((Path(__file__).parents[2] / "recordings" / "baselines").glob("*.rrd"))
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def client():
    with viewer() as found:
        yield found


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    return leave_kinds(tmp_path_factory.mktemp("kinds"))


@pytest.mark.parametrize("path", BASELINES, ids=lambda path: path.stem)
def test_no_view_of_a_baseline_complains(client, path):
    state = state_of(client, path)
    assert state.views
    assert complaints(state) == []


@pytest.mark.parametrize("kind", ["images", "synthesis", "study"])
def test_no_view_of_a_fresh_recording_complains(client, fresh, kind):
    state = state_of(client, fresh / f"{kind}.rrd")
    assert state.views
    assert complaints(state) == []


def test_a_view_that_cannot_show_what_it_is_told_complains(client, tmp_path):
    stream = rr.RecordingStream("complaint", recording_id="complaint")
    stream.set_sinks(rr.FileSink(tmp_path / "bad.rrd"))
    stream.log("world/point", rr.Points3D([[0.0, 0.0, 0.0]]))
    stream.send_blueprint(rrb.Blueprint(rrb.Spatial2DView(origin="/world", contents=["$origin/**"]), auto_views=False))
    stream.flush()
    stream.disconnect()
    assert "require a pinhole" in complaints(state_of(client, tmp_path / "bad.rrd"))[0]


@pytest.mark.skipif(find_spec("datafusion") is None, reason="needs the extra 'catalog'")
def test_a_gallery_opens_without_complaint(fresh):
    with gallery(read_runs(fresh)) as served, viewer(served.url) as client:
        give_up = time.monotonic() + 20.0
        while len((state := settled(client)).recordings) < served.n_runs and time.monotonic() < give_up:
            time.sleep(0.5)  # until every card has the recording that it shows
        told = [each.message for each in client.get_logs() if each.level != "INFO"]
    assert state.location.startswith(served.url.partition("/entry/")[0])
    assert len(state.recordings) == served.n_runs == 3
    assert [each for each in told if "Software rasterizer" not in each] == []
