"""Whether a calibration can be used on this stand: what it was made with, held against stand.toml.

A record that doesn't say what it was made with (an old one, one cut down by hand) contradicts nothing.
"""

from pathlib import Path

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand
from truestand.files.recipes.changes import Record, as_made
from truestand.files.recipes.recipes import read_stand, stand_from_recipe


def unusable_reason(record: Record, stand: Path) -> str | None:
    """Why nothing can be inspected with a calibration on the stand of a stand.toml; None: it can."""
    if record.get("method") == "paper":
        return "it is of the published method, which can inspect nothing"
    try:
        here = read_stand(stand)
    except BadRecipe:  # whoever starts a job is told
        return None
    name = (record.get("sensor") or {}).get("name")
    sensor = _sensor(here, name)
    if name and sensor is None:
        return f"it is of sensor {name!r}, {stand.name} has {', '.join(repr(s.name) for s in here.sensors)}"
    made = as_made(record, "stand", stand_from_recipe)
    return None if made is None else _contradiction(made, here, _sensor(made, name), sensor, stand.name)


def _contradiction(
    made: Stand, here: Stand, used: Sensor | None, sensor: Sensor | None, file: str
) -> str | None:  # fmt: skip
    """What the evaluation of a scan would refuse, and a sensor that is another one."""
    if made.table.direction != here.table.direction:
        return f"its table turns {made.table.direction}, that of {file} {here.table.direction}"
    if used is None or sensor is None:
        return None
    if used.mirrored != sensor.mirrored:
        was, now = ("mirrored", "is not") if used.mirrored else ("not mirrored", "is")
        return f"its sensor was {was}, that of {file} {now}"
    if used.serial and sensor.serial and used.serial != sensor.serial:
        return f"it is of the sensor with serial number {used.serial}, {file} has {sensor.serial}"
    return None


def _sensor(stand: Stand, name: str | None) -> Sensor | None:
    return next((s for s in stand.sensors if s.name == name), None)
