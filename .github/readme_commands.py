"""Run the README's commands that are marked "run" and "test", in this system's form of a virtual environment."""

import re
import subprocess
import sys
from pathlib import Path

text = Path("README.md").read_text(encoding="utf-8")
for marker in ("run", "test"):
    (command,) = re.findall(rf"<!-- {marker} -->\n```sh\n(.+?)\n```", text, re.DOTALL)
    if sys.platform == "win32":
        command = command.replace(".venv/bin/", ".venv/Scripts/").replace("python3 ", "python ")
    print("==", command, flush=True)
    subprocess.run(["bash", "-euo", "pipefail", "-c", command], check=True)
