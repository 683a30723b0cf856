"""The annotation server without a browser: frames, annotations, undo and rejected requests."""

import http.client
import json
from threading import Thread

import cv2
import numpy as np
import pytest

from workbench.detections.annotation.annotations import Annotations
from workbench.detections.annotation.frames import Frames
from workbench.detections.annotation.server import Server
from workbench.detections.joint_annotations import read_annotations
from workbench.utils.errors import InputError

N = 70


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """A folder of images with the constant grey level 3 t."""
    folder = tmp_path_factory.mktemp("images")
    for t in range(N):
        cv2.imwrite(str(folder / f"{t}.png"), np.full((48, 64, 3), 3 * t, np.uint8))
    return folder


@pytest.fixture
def server(images, tmp_path):
    frames = Frames(images)
    with Server(frames, Annotations(tmp_path / "annotations.csv", frames.n_frames, frames.size)) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def request(server, method, path, body=None, token=None):
    """Return status, headers and body of the response."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    text = body if body is None or isinstance(body, (str, bytes)) else json.dumps(body)
    connection.request(method, f"/{server.token if token is None else token}/{path}", text)
    response = connection.getresponse()
    return response.status, response.headers, response.read()


def put(server, frame, joint, u, v, visible=True):
    values = {"frame": frame, "joint": joint, "u": u, "v": v, "visible": visible}
    status, _, body = request(server, "POST", "annotate", values)
    return status, json.loads(body)


@pytest.mark.parametrize("order", [(0, 1, 2), (69, 3, 68), (60, 0, 61, 0)])
def test_frames_are_served_in_any_order(server, order):
    for number in order:
        status, headers, body = request(server, "GET", f"frame/{number}")
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        assert (status, headers["Content-Type"], image.shape) == (200, "image/jpeg", (48, 64, 3))
        assert abs(float(image.mean()) - 3 * number) < 2.0


def test_annotations_are_written_and_undone(server):
    assert put(server, 5, "left_knee", 10.5, 20, False) == (
        200, {"frame": 5, "joint": "left_knee", "annotations": {"left_knee": [10.5, 20.0, False]}},
    )  # fmt: skip
    put(server, 5, "neck", 30, 4)
    assert read_annotations(server.annotations.path).at(5)[1].sum() == 1
    assert list(Annotations(server.annotations.path, N, (64, 48)).by_frame()[5]) == ["neck", "left_knee"]
    status, _, body = request(server, "POST", "undo", {})
    assert (status, json.loads(body)["joint"]) == (200, "neck")
    put(server, 5, "left_knee", None, None)
    state = json.loads(request(server, "GET", "state")[2])
    assert state["annotations"] == {}
    assert (state["n_frames"], state["size"], len(state["joints"])) == (N, [64, 48], 14)
    for _ in range(2):
        request(server, "POST", "undo", {})
    assert json.loads(request(server, "POST", "undo", {})[2])["frame"] is None


def test_the_page_loads_no_external_resource(server):
    status, headers, body = request(server, "GET", "")
    assert (status, headers["Content-Type"]) == (200, "text/html")
    assert b"http" not in body
    assert b"src=" not in body.replace(b".src =", b"")


@pytest.mark.parametrize("token", ["", "x" * 32, ".."])
def test_a_wrong_token_is_rejected(server, token):
    for method, path, body in (("GET", "state", None), ("GET", "frame/0", None), ("POST", "annotate", {})):
        assert request(server, method, path, body, token)[0] == 403
    assert not server.annotations.values


@pytest.mark.parametrize(
    ("method", "path", "body", "status"), [
        ("GET", "other", None, 404), ("GET", "frame/70", None, 400), ("GET", "frame/-1", None, 400),
        ("GET", "frame/../page.html", None, 404), ("GET", "frame/one", None, 400), ("GET", "annotate", None, 404),
        ("POST", "state", {}, 404), ("POST", "annotate", "{", 400), ("POST", "annotate", "[" * 4000, 400),
        ("POST", "annotate", {"frame": 0}, 400), ("POST", "annotate", b"\xff", 400), ("PUT", "annotate", {}, 501),
    ],
)  # fmt: skip
def test_an_invalid_request_is_rejected(server, method, path, body, status):
    assert request(server, method, path, body)[0] == status
    assert not server.annotations.values


def test_the_server_listens_on_the_loopback_address(server):
    assert server.server_address[0] == "127.0.0.1"
    assert server.url.startswith("http://127.0.0.1:")
    assert len(server.token) >= 32


def test_a_port_in_use_is_an_error(server):
    with pytest.raises(InputError, match="cannot be used"):
        Server(server.frames, server.annotations, server.server_port)
