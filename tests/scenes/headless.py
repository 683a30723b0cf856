"""A viewer without a screen that reports the problems of its views; it listens on the loopback address only."""

import os
import socket
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import rerun_cli
from rerun.experimental import ViewerClient

RERUN = Path(rerun_cli.__file__).with_name("rerun")
LOOPBACK = "127.0.0.1"


@contextmanager
def viewer():
    """Yield a client of a viewer at a free port; skip if the machine cannot render."""
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        port = str(free.getsockname()[1])
    command = [RERUN, "--headless", "--bind", LOOPBACK, "--port", port, "--window-size", "800x600"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env={**os.environ, "RERUN_ANALYTICS": "false"}, **quiet) as process:
        try:
            yield _client(process, f"rerun+http://{LOOPBACK}:{port}/proxy")
        finally:
            process.terminate()


def _client(process, url):
    for _ in range(120):
        if process.poll() is not None:
            pytest.skip("no headless viewer: mesa-vulkan-drivers and libvulkan1 draw without a graphics card")
        try:
            client = ViewerClient.connect(url)
            client.get_state()
            return client
        except (RuntimeError, ConnectionError):
            time.sleep(0.5)
    pytest.fail("the headless viewer did not come up within a minute")


def state_of(client, path):
    """Return the viewer's state after it has loaded and drawn a recording."""
    client.open(str(path))
    deadline = time.monotonic() + 20.0
    while client.get_state().loading and time.monotonic() < deadline:
        time.sleep(0.1)
    client.take_screenshot()  # draws once more
    return client.get_state()


def view_problems(state):
    """Return a message for every warning and error of a view."""
    return [
        f"{view.name} {view.origin}: {report.severity}: {report.summary}"
        for view in state.views
        for report in view.reports
    ]
