"""A viewer without a screen that says what its views complain about. It listens to this machine alone."""

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
def viewer(*places):
    """A client of a viewer at a free port, which opens these places; skips where nothing can draw.

    What this process serves is to be given here: `open` would wait for it for ever.
    """
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        port = str(free.getsockname()[1])
    command = [RERUN, "--headless", "--bind", LOOPBACK, "--port", port, "--window-size", "1200x800", *places]
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
    """What the viewer shows of a recording once it has loaded and drawn it."""
    client.open(str(path))
    return settled(client)


def settled(client):
    """What the viewer shows once nothing is loading any more."""
    give_up = time.monotonic() + 20.0
    while client.get_state().loading and time.monotonic() < give_up:
        time.sleep(0.1)
    client.take_screenshot()  # draws once more
    return client.get_state()


def complaints(state):
    """A sentence for every warning and error of a view."""
    return [
        f"{view.name} {view.origin}: {each.severity}: {each.summary}" for view in state.views for each in view.reports
    ]
