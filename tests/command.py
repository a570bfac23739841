"""The command line as a user runs it."""

import os
import subprocess
import sys
from pathlib import Path


def run(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """``truestand ...`` in a process of its own; warnings are errors there too."""
    command = [sys.executable, "-W", "error", "-m", "truestand", *map(str, arguments)]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    return subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", cwd=cwd, env=environment, check=False
    )
