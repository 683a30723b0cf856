"""Whether a viewer is there to watch a run."""

import socket

HOST, PORT = "127.0.0.1", 9876  # where `rerun` listens unless told otherwise
URL = f"rerun+http://{HOST}:{PORT}/proxy"


def listens(timeout_s: float = 0.5) -> bool:
    """Tell whether something accepts connections there; asked first, since sending to nobody blocks for seconds."""
    try:
        socket.create_connection((HOST, PORT), timeout_s).close()
    except OSError:
        return False
    return True
