"""From a recipe to a sensor that answers. Each driver is loaded only where the recipe asks for it."""

from truestand.core.stand import Sensor
from truestand.devices.sensor import LineSensor
from truestand.devices.sensors.recipe import SensorRecipe


def open_sensor(recipe: SensorRecipe, sensor: Sensor) -> LineSensor:
    """The sensor of the recipe, connected, not yet streaming.

    Raises:
        BadRecipe: rate or points stated nowhere.
        DeviceLost: nobody answers.
        DeviceError: controlled by another program, or not the sensor of the recipe.
        UnreadableFile: a replay without its scan.
        MissingExtra: no GenICam on this platform.
    """
    if recipe.driver == "scancontrol":
        from truestand.devices.sensors.scancontrol import ScanControl

        return ScanControl(recipe, sensor)
    if recipe.driver == "range-camera":
        from truestand.devices.sensors.range_camera import RangeCamera

        return RangeCamera(recipe, sensor)
    from truestand.devices.sensors.replay import Replay

    return Replay(recipe, sensor)
