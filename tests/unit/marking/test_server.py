"""The page's server without a browser: frames, marks, undo, going on, and all that is refused."""

import http.client
import json
from threading import Thread

import cv2
import numpy as np
import pytest

from workbench.datasets.files.marks import read_marks
from workbench.errors import InputError
from workbench.marking.frames import Frames
from workbench.marking.server import MOST_BYTES, Server
from workbench.marking.table import open_table

N = 70


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Images as grey as their number times three."""
    folder = tmp_path_factory.mktemp("film")
    for t in range(N):
        cv2.imwrite(str(folder / f"{t}.png"), np.full((48, 64, 3), 3 * t, np.uint8))
    return folder


@pytest.fixture
def server(film, tmp_path):
    frames = Frames(film)
    with Server(frames, open_table(tmp_path / "marks.csv", frames.n_frames, frames.size)) as serving:
        thread = Thread(target=serving.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield serving
        serving.shutdown()
        thread.join()


def ask(server, method, path, body=None, token=None, **headers):
    """Status, headers and body of the answer to one request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    own = {"Content-Type": "application/json"} if body is not None else {}
    text = body if body is None or isinstance(body, (str, bytes)) else json.dumps(body)
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, f"/{server.token if token is None else token}/{path}", text, own | given)
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def put(server, frame, joint, u, v, visible=True):
    values = {"frame": frame, "joint": joint, "u": u, "v": v, "visible": visible}
    status, _, body = ask(server, "POST", "mark", values)
    return status, json.loads(body)


@pytest.mark.parametrize("order", [(0, 1, 2), (69, 3, 68), (60, 0, 61, 0)])
def test_frames_come_in_any_order(server, order):
    for number in order:
        status, headers, body = ask(server, "GET", f"frame/{number}.jpg")
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        assert (status, headers["Content-Type"], image.shape) == (200, "image/jpeg", (48, 64, 3))
        assert abs(float(image.mean()) - 3 * number) < 2.0


def test_marks_are_posted_undone_and_gone_on_with(server):
    assert put(server, 5, "left_knee", 10.5, 20, False) == (
        200, {"frame": 5, "joint": "left_knee", "marks": {"left_knee": [10.5, 20.0, False]}},
    )  # fmt: skip
    put(server, 5, "neck", 30, 4)
    assert read_marks(server.table.path).at(5)[1].sum() == 1
    assert list(open_table(server.table.path, N, (64, 48)).by_frame()[5]) == ["neck", "left_knee"]
    status, _, body = ask(server, "POST", "undo", {})
    assert (status, json.loads(body)["joint"]) == (200, "neck")
    put(server, 5, "left_knee", None, None)
    state = json.loads(ask(server, "GET", "state")[2])
    assert state["marks"] == {}
    assert (state["n_frames"], state["size"], len(state["joints"])) == (N, [64, 48], 14)
    for _ in range(2):
        body = ask(server, "POST", "undo", {})[2]
    assert json.loads(ask(server, "POST", "undo", {})[2])["frame"] is None


def test_the_page_loads_nothing_from_elsewhere(server):
    status, headers, body = ask(server, "GET", "")
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert b"http" not in body.replace(b"http-equiv", b"")
    assert b"src=" not in body.replace(b".src =", b"")


@pytest.mark.parametrize(
    ("change", "status"), [
        ({"Host": "evil.example"}, 403), ({"Host": "127.0.0.1"}, 403), ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403), ({"token": ""}, 403), ({"token": "x" * 32}, 403), ({"token": ".."}, 403),
    ],
)  # fmt: skip
def test_who_does_not_know_the_address_is_refused(server, change, status):
    for method, path, body in (("GET", "state", None), ("GET", "frame/0.jpg", None), ("POST", "mark", {})):
        assert ask(server, method, path, body, **change)[0] == status
    assert not server.table.marks


def test_the_page_itself_may_say_where_it_is_from(server):
    own = f"http://127.0.0.1:{server.server_port}"
    assert ask(server, "POST", "undo", {}, Origin=own)[0] == 200
    assert ask(server, "GET", "state", Host=f"localhost:{server.server_port}")[0] == 200


@pytest.mark.parametrize(
    ("method", "path", "body", "headers", "status"), [
        ("GET", "other", None, {}, 404), ("GET", "frame/70.jpg", None, {}, 404), ("GET", "frame/-1.jpg", None, {}, 404),
        ("GET", "frame/../page.html", None, {}, 404), ("GET", "frame/9999999999999999999.jpg", None, {}, 404),
        ("GET", "mark", None, {}, 404), ("POST", "state", {}, {}, 404), ("POST", "mark", "{", {}, 400),
        ("POST", "mark", "[" * 4000, {}, 400), ("POST", "mark", {"frame": 0}, {}, 400),
        ("POST", "mark", b"\xff", {}, 400),
        ("POST", "mark", "x" * (MOST_BYTES + 1), {}, 413), ("POST", "undo", {}, {"Content_Type": "text/plain"}, 415),
        ("POST", "undo", {}, {"Content_Length": "-1"}, 411),
        ("PUT", "mark", {}, {}, 501), ("DELETE", "mark", None, {}, 501),
    ],
)  # fmt: skip
def test_other_requests_are_refused(server, method, path, body, headers, status):
    assert ask(server, method, path, body, **headers)[0] == status
    assert not server.table.marks


def test_it_listens_on_this_machine_alone(server):
    assert server.server_address[0] == "127.0.0.1"
    assert server.url.startswith("http://127.0.0.1:")
    assert len(server.token) >= 32


def test_a_port_that_is_taken_is_said(server, film):
    with pytest.raises(InputError, match="cannot be listened at"):
        Server(server.frames, server.table, server.server_port)


def test_a_source_without_frames_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected images"):
        Frames(tmp_path)
    with pytest.raises(InputError, match="no such video"):
        Frames(tmp_path / "none.mp4")
