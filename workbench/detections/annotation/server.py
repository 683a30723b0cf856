"""The web server of the annotation page: bound to 127.0.0.1, with a random token in its address."""

import json
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Lock
from typing import Any

from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES
from workbench.detections.annotation.annotations import Annotations, parse_annotation
from workbench.detections.annotation.frames import Frames
from workbench.utils.errors import InputError

HOST = "127.0.0.1"
BONES = (
    ("head_centre", "neck"), ("neck", "left_shoulder"), ("neck", "right_shoulder"), ("left_hip", "right_hip"),
    ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"),
    ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
)  # fmt: skip
"""Lines that the page draws between annotated joints."""


class Server(ThreadingHTTPServer):
    """Server of one video and its annotations at a port of 127.0.0.1; 0 selects a free port."""

    def __init__(self, frames: Frames, annotations: Annotations, port: int = 0) -> None:
        """Raise InputError for a port that is in use."""
        self.frames, self.annotations = frames, annotations
        self.token, self.lock = secrets.token_urlsafe(24), Lock()
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise InputError(f"port {port}: cannot be used: {error}; choose another --port") from None

    @property
    def url(self) -> str:
        """The address to open."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"


class _Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        """Answer GET with the page, the state of all annotations, or a frame; or POST, which sets or removes an
        annotation or undoes the latest change, with the annotations of its frame."""
        token, _, path = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._send({"error": "expected the address that workbench annotate prints"}, HTTPStatus.FORBIDDEN)
            return
        try:
            match self.command, path.split("/"):
                case "GET", [""]:
                    page = files("workbench.detections.annotation").joinpath("page.html")
                    self._send(page.read_bytes(), kind="text/html")
                case "GET", ["state"]:
                    self._send(self._state())
                case "GET", ["frame", number]:
                    self._send(self.server.frames.jpeg(int(number)), kind="image/jpeg")
                case "POST", ["annotate" | "undo" as action]:
                    body = self.rfile.read(max(int(self.headers.get("Content-Length", 0)), 0))
                    self._send(self._change(action, json.loads(body)))
                case _:
                    self._send({"error": "no such page"}, HTTPStatus.NOT_FOUND)
        except (ValueError, RecursionError) as error:
            self._send({"error": str(error)}, HTTPStatus.BAD_REQUEST)

    do_POST = do_GET  # noqa: N815 (the name is the library's)

    def _change(self, action: str, values: Any) -> dict[str, Any]:
        annotations = self.server.annotations
        with self.server.lock:
            if action == "undo":
                frame, joint = annotations.undo() or (None, None)
            else:
                (frame, joint), annotation = parse_annotation(values)
                annotations.put((frame, joint), annotation)
            here = {} if frame is None else annotations.by_frame().get(frame, {})
        return {"frame": frame, "joint": joint, "annotations": here}

    def _state(self) -> dict[str, Any]:
        frames, annotations = self.server.frames, self.server.annotations
        with self.server.lock:
            by_frame = annotations.by_frame()
        extra = {joint for joints in by_frame.values() for joint in joints} - set(ERROR_JOINTS)
        return {
            "name": frames.source.name, "file": annotations.path.name, "n_frames": frames.n_frames,
            "size": frames.size, "joints": [*ERROR_JOINTS, *sorted(extra, key=JOINT_NAMES.index)], "bones": BONES,
            "annotations": by_frame,
        }  # fmt: skip

    def _send(self, value: Any, status: HTTPStatus = HTTPStatus.OK, kind: str = "application/json") -> None:
        body = value if isinstance(value, bytes) else json.dumps(value).encode()
        self.send_response(status)
        for name, text in {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store"}.items():
            self.send_header(name, text)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Print no line for each request."""
