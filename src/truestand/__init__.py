"""truestand: calibrate a rotary laser inspection stand from one scan, and know how well.

import truestand as ts

stand, shaft = ts.read_stand("stand.toml"), ts.read_shaft("shaft.toml")
calibration = ts.calibrate(ts.read_scan("k1.csv", stand), shaft)
surface = ts.roll(ts.read_scan("gear.csv", stand), calibration)
print(ts.inspect(surface, ts.read_part("gear.toml")).verdict)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from truestand._version import __version__

if TYPE_CHECKING:
    from truestand.apply.transfer import Transfer, roll, transfer
    from truestand.apply.verify import Verification, verify, verify_views
    from truestand.apply.views import roll_views
    from truestand.calibration.calibrate import calibrate
    from truestand.calibration.positions import calibrate_positions
    from truestand.calibration.views import calibrate_views
    from truestand.core.artefact import Artefact, Certificate, Cylinder
    from truestand.core.calibration import Calibration
    from truestand.core.errors import TruestandError
    from truestand.core.frames import Pose
    from truestand.core.inspection import Characteristic, Defect, Inspection
    from truestand.core.scan import Recording, Scan, interpret
    from truestand.core.stand import Sensor, Stand, Table
    from truestand.core.surface import Surface
    from truestand.files.recipes.parts import read_part
    from truestand.files.recipes.recipes import read_shaft, read_stand
    from truestand.files.records.calibration_record import read_calibration, write_calibration
    from truestand.files.scans.read import read_scan
    from truestand.files.shapes.clouds import write_cloud
    from truestand.gear.drawing import Gear
    from truestand.gear.match import identify
    from truestand.parts.inspect import inspect
    from truestand.planning.plan import plan

# Names are imported when first used, so that `truestand --help` doesn't wait for numpy.
_MODULES = {
    "Artefact": "core.artefact",
    "Calibration": "core.calibration",
    "Certificate": "core.artefact",
    "Characteristic": "core.inspection",
    "Cylinder": "core.artefact",
    "Defect": "core.inspection",
    "Gear": "gear.drawing",
    "Inspection": "core.inspection",
    "Pose": "core.frames",
    "Recording": "core.scan",
    "Scan": "core.scan",
    "Sensor": "core.stand",
    "Stand": "core.stand",
    "Surface": "core.surface",
    "Table": "core.stand",
    "Transfer": "apply.transfer",
    "TruestandError": "core.errors",
    "Verification": "apply.verify",
    "calibrate": "calibration.calibrate",
    "calibrate_positions": "calibration.positions",
    "calibrate_views": "calibration.views",
    "identify": "gear.match",
    "inspect": "parts.inspect",
    "interpret": "core.scan",
    "plan": "planning.plan",
    "read_calibration": "files.records.calibration_record",
    "read_part": "files.recipes.parts",
    "read_scan": "files.scans.read",
    "read_shaft": "files.recipes.recipes",
    "read_stand": "files.recipes.recipes",
    "roll": "apply.transfer",
    "roll_views": "apply.views",
    "transfer": "apply.transfer",
    "verify": "apply.verify",
    "verify_views": "apply.verify",
    "write_calibration": "files.records.calibration_record",
    "write_cloud": "files.shapes.clouds",
}

__all__ = [
    "Artefact",
    "Calibration",
    "Certificate",
    "Characteristic",
    "Cylinder",
    "Defect",
    "Gear",
    "Inspection",
    "Pose",
    "Recording",
    "Scan",
    "Sensor",
    "Stand",
    "Surface",
    "Table",
    "Transfer",
    "TruestandError",
    "Verification",
    "__version__",
    "calibrate",
    "calibrate_positions",
    "calibrate_views",
    "identify",
    "inspect",
    "interpret",
    "plan",
    "read_calibration",
    "read_part",
    "read_scan",
    "read_shaft",
    "read_stand",
    "roll",
    "roll_views",
    "transfer",
    "verify",
    "verify_views",
    "write_calibration",
    "write_cloud",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'truestand' has no attribute {name!r}")
    return getattr(import_module(f"truestand.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
