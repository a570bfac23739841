"""Virtual scans on disk, each made once for what it shows and for the code that makes it."""

import pickle
import shutil
import zlib
from functools import cache
from hashlib import sha256
from pathlib import Path

import truestand
from truestand.core.artefact import Artefact
from truestand.core.stand import Stand
from truestand.files.atomic import write_bytes_atomic
from truestand.sim import Simulated, Simulation, VirtualPart, simulate

FOLDER = Path(__file__).parent.parent / ".pytest_cache" / "virtual-scans"


def simulated(
    stand: Stand, simulation: Simulation, artefact: Artefact, seed: int, part: VirtualPart | None = None
) -> Simulated:
    """The virtual scan of these, from disk where it is there."""
    key = sha256(repr((stand, simulation, artefact, seed, part)).encode()).hexdigest()
    path = FOLDER / _code() / key
    if not path.exists():
        made = simulate(stand, simulation, artefact, seed, None, part)
        write_bytes_atomic(path, zlib.compress(pickle.dumps(made), 1))
    return pickle.loads(zlib.decompress(path.read_bytes()))


@cache
def _code() -> str:
    """Hash of all code that a virtual scan may depend on; scans by other code are removed."""
    source = Path(truestand.__file__).parent
    files = sorted(file for room in ("core", "gear", "parts", "sim") for file in (source / room).glob("*.py"))
    code = sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    for other in FOLDER.glob("*"):
        if other.name != code:
            shutil.rmtree(other, ignore_errors=True)
    return code
