"""Short jobs in a process of their own: ``python -m truestand.web.tasks NAME ...``, one JSON answer on standard output.

Neither the memory that they take nor a crash of theirs reaches the process that serves: they load CAD models of a
gigabyte, device libraries, clouds of seven million points.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from anyio import CapacityLimiter, to_thread

from truestand.core.errors import BadRecipe, TruestandError
from truestand.web.problem import Problem


async def run_task(*arguments: str, text: str = "", timeout_s: float = 30.0) -> Any:
    """The answer of a task; ``text``: its standard input.

    Raises:
        Problem: 409 it can't be done, and why; 504 it took too long.
    """
    started: list[subprocess.Popen[bytes]] = []
    work = partial(_run, started, arguments, text.encode("utf-8", "surrogatepass"), timeout_s)
    try:
        # A limiter of its own: an audit may take an hour, and none of the threads that answer.
        code, answer = await to_thread.run_sync(work, abandon_on_cancel=True, limiter=CapacityLimiter(1))
    except subprocess.TimeoutExpired:
        raise Problem(504, f"found no answer within {timeout_s:g} s; try again later") from None
    finally:
        for process in started:
            process.kill()  # where nobody waits for it any more
    if code != 0:
        raise Problem(500, f"found a task ending with code {code}; see what the server printed")
    payload = json.loads(answer)
    if "problem" in payload:
        raise Problem(409, str(payload["problem"]))
    return payload["answer"]


def _run(
    started: list[subprocess.Popen[bytes]], arguments: Sequence[str], text: bytes, timeout_s: float
) -> tuple[int, bytes]:
    """A thread's job: start a task and wait for it; its exit code and output.

    Raises:
        TimeoutExpired: it took too long, and was ended.
    """
    command = (sys.executable, "-m", "truestand.web.tasks", *arguments)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        started.append(process)
        try:
            answer, _ = process.communicate(text, timeout_s)
        finally:
            process.kill()
    return process.returncode, answer


def check(folder: str, name: str) -> str | None:
    """What is wrong with the recipe on standard input, were it saved as ``name``; null: nothing."""
    from truestand.web.recipes import RecipeFolder

    return RecipeFolder(Path(folder)).problem_of(name, sys.stdin.buffer.read().decode("utf-8", "surrogatepass"))


def devices(stand: str) -> list[dict[str, Any]]:
    """What table and sensors say; nothing moves."""
    from truestand.station.diagnostics import ask_devices
    from truestand.station.recipe import read_devices

    return [
        {"device": a.device, "name": a.name, "address": a.address, "answers": a.answers, "problem": a.problem or None,
         "told": {key: str(value) for key, value in a.details.items() if value}}
        for a in ask_devices(*read_devices(stand))
    ]  # fmt: skip


def reset(stand: str) -> str:
    """Clear a latched fault; its reason."""
    from truestand.station.diagnostics import reset_fault

    return reset_fault(Path(stand))


def audit(store: str) -> list[dict[str, str]]:
    """What isn't as it was written; every byte is read."""
    from truestand.store import Store

    return [
        {"what": f.what, "where": f"{f.where} ({f.detail})" if f.detail else f.where}
        for f in Store(Path(store)).audit().findings
    ]


def certificate(record: str, laboratory: str) -> str:
    """The Digital Calibration Certificate of a calibration's record; a draft where there is no laboratory.toml."""
    from truestand.files.json_text import parse_json
    from truestand.files.recipes.laboratory import read_laboratory
    from truestand.files.records.calibration_record import read_calibration
    from truestand.report.certificate import certificate_xml, refusals
    from truestand.report.certificate_administration import CertificateInput

    source, laboratory_file = Path(record).read_bytes(), Path(laboratory)
    calibration = parse_json(source.decode("utf-8-sig"), "calibration.json", "calibrate again")
    reasons = refusals(calibration)
    if reasons:
        raise BadRecipe(f"there can be no certificate: {'; '.join(reasons)}")
    issuer = read_laboratory(laboratory_file) if laboratory_file.exists() else None
    given = CertificateInput(calibration, read_calibration(record), source, "calibration.json", issuer)
    return certificate_xml(given).decode("utf-8")


def cloud(source: str, target: str, points: str) -> int:
    """A cloud made small enough to show; how many points it has."""
    from truestand.web.clouds import thin_out

    return thin_out(Path(source), Path(target), int(points))


TASKS: dict[str, Callable[..., Any]] = {
    "audit": audit, "certificate": certificate, "check": check, "cloud": cloud, "devices": devices, "reset": reset,
}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Do a task, and write its answer to standard output."""
    name, *rest = arguments
    try:
        payload = {"answer": TASKS[name](*rest)}
    except (TruestandError, OSError) as wrong:
        payload = {"problem": str(wrong)}
    sys.stdout.write(json.dumps(payload))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
