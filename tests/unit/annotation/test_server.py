"""The page's server without a browser: frames, annotations, undo, and requests that are refused."""

import http.client
import json
from threading import Thread

import cv2
import numpy as np
import pytest

from workbench.annotation.annotations import Annotations
from workbench.annotation.frames import Frames
from workbench.annotation.server import Server
from workbench.datasets.files.joint_annotations import read_annotations
from workbench.utils.errors import InputError

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
    with Server(frames, Annotations(tmp_path / "marks.csv", frames.n_frames, frames.size)) as serving:
        thread = Thread(target=serving.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield serving
        serving.shutdown()
        thread.join()


def ask(server, method, path, body=None, token=None):
    """Status, headers and body of the answer to one request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    text = body if body is None or isinstance(body, (str, bytes)) else json.dumps(body)
    connection.request(method, f"/{server.token if token is None else token}/{path}", text)
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def put(server, frame, joint, u, v, visible=True):
    values = {"frame": frame, "joint": joint, "u": u, "v": v, "visible": visible}
    status, _, body = ask(server, "POST", "annotate", values)
    return status, json.loads(body)


@pytest.mark.parametrize("order", [(0, 1, 2), (69, 3, 68), (60, 0, 61, 0)])
def test_frames_come_in_any_order(server, order):
    for number in order:
        status, headers, body = ask(server, "GET", f"frame/{number}")
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        assert (status, headers["Content-Type"], image.shape) == (200, "image/jpeg", (48, 64, 3))
        assert abs(float(image.mean()) - 3 * number) < 2.0


def test_annotations_are_posted_undone_and_continued(server):
    assert put(server, 5, "left_knee", 10.5, 20, False) == (
        200, {"frame": 5, "joint": "left_knee", "annotations": {"left_knee": [10.5, 20.0, False]}},
    )  # fmt: skip
    put(server, 5, "neck", 30, 4)
    assert read_annotations(server.annotations.path).at(5)[1].sum() == 1
    assert list(Annotations(server.annotations.path, N, (64, 48)).by_frame()[5]) == ["neck", "left_knee"]
    status, _, body = ask(server, "POST", "undo", {})
    assert (status, json.loads(body)["joint"]) == (200, "neck")
    put(server, 5, "left_knee", None, None)
    state = json.loads(ask(server, "GET", "state")[2])
    assert state["annotations"] == {}
    assert (state["n_frames"], state["size"], len(state["joints"])) == (N, [64, 48], 14)
    for _ in range(2):
        body = ask(server, "POST", "undo", {})[2]
    assert json.loads(ask(server, "POST", "undo", {})[2])["frame"] is None


def test_the_page_loads_nothing_from_elsewhere(server):
    status, headers, body = ask(server, "GET", "")
    assert (status, headers["Content-Type"]) == (200, "text/html")
    assert b"http" not in body
    assert b"src=" not in body.replace(b".src =", b"")


@pytest.mark.parametrize("token", ["", "x" * 32, ".."])
def test_a_wrong_token_is_refused(server, token):
    for method, path, body in (("GET", "state", None), ("GET", "frame/0", None), ("POST", "annotate", {})):
        assert ask(server, method, path, body, token)[0] == 403
    assert not server.annotations.values


@pytest.mark.parametrize(
    ("method", "path", "body", "status"), [
        ("GET", "other", None, 404), ("GET", "frame/70", None, 400), ("GET", "frame/-1", None, 400),
        ("GET", "frame/../page.html", None, 404), ("GET", "frame/one", None, 400), ("GET", "annotate", None, 404),
        ("POST", "state", {}, 404), ("POST", "annotate", "{", 400), ("POST", "annotate", "[" * 4000, 400),
        ("POST", "annotate", {"frame": 0}, 400), ("POST", "annotate", b"\xff", 400), ("PUT", "annotate", {}, 501),
    ],
)  # fmt: skip
def test_other_requests_are_refused(server, method, path, body, status):
    assert ask(server, method, path, body)[0] == status
    assert not server.annotations.values


def test_it_listens_on_this_machine_only(server):
    assert server.server_address[0] == "127.0.0.1"
    assert server.url.startswith("http://127.0.0.1:")
    assert len(server.token) >= 32


def test_a_port_in_use_is_refused(server):
    with pytest.raises(InputError, match="cannot be used"):
        Server(server.frames, server.annotations, server.server_port)
