"""No view of a baseline or of a new recording reports a warning or an error."""

from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb
from headless import state_of, view_problems, viewer
from kinds_of_recordings import write_kinds

BASELINES = sorted((Path(__file__).parents[2] / "recordings" / "baselines").glob("*.rrd"))
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def client():
    with viewer() as client:
        yield client


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    return write_kinds(tmp_path_factory.mktemp("kinds"))


@pytest.mark.parametrize("path", BASELINES, ids=lambda path: path.stem)
def test_no_view_of_a_baseline_reports_a_problem(client, path):
    state = state_of(client, path)
    assert state.views
    assert view_problems(state) == []


@pytest.mark.parametrize("kind", ["images", "synthesis", "study"])
def test_no_view_of_a_new_recording_reports_a_problem(client, fresh, kind):
    state = state_of(client, fresh / f"{kind}.rrd")
    assert state.views
    assert view_problems(state) == []


def test_a_view_without_a_camera_reports_a_problem(client, tmp_path):
    stream = rr.RecordingStream("problem", recording_id="problem")
    stream.set_sinks(rr.FileSink(tmp_path / "bad.rrd"))
    stream.log("world/point", rr.Points3D([[0.0, 0.0, 0.0]]))
    stream.send_blueprint(rrb.Blueprint(rrb.Spatial2DView(origin="/world", contents=["$origin/**"]), auto_views=False))
    stream.flush()
    stream.disconnect()
    assert "require a pinhole" in view_problems(state_of(client, tmp_path / "bad.rrd"))[0]
