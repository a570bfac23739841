"""The command line as a user runs it."""

import os
import subprocess
import sys
from contextlib import chdir, nullcontext, redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from pathlib import Path

from truestand.cli.main import main

Done = subprocess.CompletedProcess[str]


def run(*arguments: object, cwd: Path | None = None) -> Done:
    """``truestand ...`` in this process: the same entry point, without a second of imports. Warnings are errors."""
    command = ["truestand", *map(str, arguments)]
    out, err = (TextIOWrapper(BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    before, sys.argv = sys.argv, command
    try:
        with redirect_stdout(out), redirect_stderr(err), nullcontext() if cwd is None else chdir(cwd):
            main()
    except SystemExit as ended:
        code = ended.code
    finally:
        sys.argv = before
    assert isinstance(code, int)
    return Done(command, code, *(stream.buffer.getvalue().decode() for stream in (out, err)))  # type: ignore[attr-defined]


def run_process(*arguments: object, cwd: Path | None = None) -> Done:
    """``truestand ...`` in a process of its own: for what only a process shows. Warnings are errors there too."""
    command = [sys.executable, "-W", "error", "-m", "truestand", *map(str, arguments)]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    return subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", cwd=cwd, env=environment, check=False
    )
