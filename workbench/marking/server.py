"""The page's server: this machine alone reaches it, and only who has its address, in which a token is drawn at random.

Another page in the same browser can send requests here, but neither knows the token nor can it name this host: a
request whose Host or Origin is another one is refused, as is one that is not JSON. Every answer forbids the page to
load or send anything elsewhere.
"""

import hmac
import json
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Lock
from typing import Any

from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES
from workbench.errors import InputError
from workbench.marking.frames import Frames
from workbench.marking.table import Table, mark_of

HOST = "127.0.0.1"
MOST_BYTES = 4096
"""Of a request's body; a mark has about a hundred."""
PATIENCE_S = 30.0
"""After which a connection that says nothing is closed."""
POLICY = "default-src 'none'; img-src 'self'; connect-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
BONES = (
    ("head_centre", "neck"), ("neck", "left_shoulder"), ("neck", "right_shoulder"), ("left_hip", "right_hip"),
    ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"), ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"),
    ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
)  # fmt: skip
"""Lines that the page draws between marks."""


class Server(ThreadingHTTPServer):
    """Serves one video and one table of marks at a port of 127.0.0.1, 0 for a free one, until it is shut down."""

    daemon_threads = True

    def __init__(self, frames: Frames, table: Table, port: int = 0) -> None:
        """Raise InputError for a port that is taken."""
        self.frames, self.table, self.token, self.changing = frames, table, secrets.token_urlsafe(24), Lock()
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise InputError(f"port {port}: cannot be listened at: {error}") from None

    @property
    def url(self) -> str:
        """The address to open."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = PATIENCE_S
    server_version, sys_version = "workbench-mark", ""

    def do_GET(self) -> None:
        """Answer with the page, its style or script, all marks, or a frame."""
        if (path := self._path()) is None:
            return
        if path == "":
            self._send(HTTPStatus.OK, "text/html; charset=utf-8", _page())
        elif path == "state":
            self._json(HTTPStatus.OK, self._state())
        elif path.startswith("frame/") and path.endswith(".jpg") and path[6:-4].isascii() and path[6:-4].isdigit():
            self._frame(path[6:-4])
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")

    def do_POST(self) -> None:
        """Set or remove a mark, or undo the latest change; answer with the marks of its frame."""
        if (path := self._path()) is None:
            return
        if path not in ("mark", "undo"):
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")
        elif (body := self._body()) is not None:
            try:
                values = json.loads(body)
            except (ValueError, RecursionError):
                self._refuse(HTTPStatus.BAD_REQUEST, "expected JSON")
                return
            try:
                self._change(path, values)
            except InputError as error:
                self._refuse(HTTPStatus.BAD_REQUEST, str(error))

    def _change(self, path: str, values: Any) -> None:
        table = self.server.table
        with self.server.changing:
            if path == "undo":
                place = table.undo()
            else:
                frame, joint, mark = mark_of(values)
                table.put(frame, joint, mark)
                place = (frame, joint)
            changed = dict(zip(("frame", "joint"), place or (None, None), strict=True))
            marks = {} if place is None else table.by_frame().get(place[0], {})
            self._json(HTTPStatus.OK, {**changed, "marks": marks})

    def _state(self) -> dict[str, Any]:
        frames, table = self.server.frames, self.server.table
        with self.server.changing:
            marks = table.by_frame()
        extra = sorted(
            {joint for joints in marks.values() for joint in joints} - set(ERROR_JOINTS), key=JOINT_NAMES.index
        )
        return {
            "name": frames.source.name, "file": table.path.name, "n_frames": frames.n_frames, "size": frames.size,
            "joints": [*ERROR_JOINTS, *extra], "bones": BONES, "marks": marks,
        }  # fmt: skip

    def _frame(self, digits: str) -> None:
        try:
            self._send(HTTPStatus.OK, "image/jpeg", self.server.frames.jpeg(int(digits[:12])))
        except InputError as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))

    def _path(self) -> str | None:
        """Return what of the path follows the token; None for a request that has been refused."""
        own = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in own or (origin is not None and origin.removeprefix("http://") not in own):
            self._refuse(HTTPStatus.FORBIDDEN, "this is for the page at its own address alone")
            return None
        token, _, path = self.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN, "expected the address that workbench-mark said")
            return None
        return path

    def _body(self) -> bytes | None:
        """Return the body; None for a request that has been refused."""
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()):
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "expected Content-Length")
        elif len(length) > 9 or int(length) > MOST_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MOST_BYTES} bytes")
        elif self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
        else:
            return self.rfile.read(int(length))
        return None

    def _json(self, status: HTTPStatus, value: Any) -> None:
        self._send(status, "application/json", json.dumps(value).encode())

    def _refuse(self, status: HTTPStatus, sentence: str) -> None:
        self.close_connection = True  # whatever was sent beside it is not read
        self._json(status, {"error": sentence})

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
            "Content-Security-Policy": f"{POLICY}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
            "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
        }.items():  # fmt: skip
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing: the terminal is for what the person is told."""


def _page() -> bytes:
    return files("workbench.marking").joinpath("page.html").read_bytes()
