"""From a recipe to an axis that answers. Each driver's library is loaded only where the recipe asks for it."""

from contextlib import ExitStack

from truestand.devices.axis import Axis, Drive, Limits
from truestand.devices.tables.line import Lines
from truestand.devices.tables.recipe import ControllerRecipe, TableRecipe


def open_table(recipe: TableRecipe) -> Axis:
    """The table of ``[devices.table]``, connected, its state read once; nothing moves.

    Raises:
        DeviceLost: nobody answers at the address.
        DeviceError: what answers isn't such a table.
    """
    return open_axis(recipe, recipe.limits)


def open_axis(
    recipe: ControllerRecipe, limits: Limits, what: str = "table", unit: str = "deg", lines: Lines | None = None
) -> Axis:
    """An axis behind a controller, connected, its state read once; nothing moves. ``what`` and ``unit``: in messages;
    ``lines``: connections that it may share.

    Raises:
        DeviceLost, DeviceError: as ``open_table``.
    """
    drive = _drive(recipe, what, lines)
    with ExitStack() as on_failure:
        on_failure.callback(drive.close)
        drive.state()
        on_failure.pop_all()
    return Axis(drive, limits, what=what, unit=unit)


def _drive(recipe: ControllerRecipe, what: str, lines: Lines | None) -> Drive:
    if recipe.protocol == "modbus":
        from truestand.devices.tables.modbus import ModbusTable

        return ModbusTable(recipe.address, recipe.modbus, recipe.timeout_s, what)
    if recipe.protocol == "opcua":
        from truestand.devices.tables.opcua import OpcUaTable

        return OpcUaTable(recipe.address, recipe.opcua, recipe.timeout_s, what)
    if recipe.protocol == "zaber":
        from truestand.devices.tables.zaber import ZaberTable

        return ZaberTable(recipe.address, recipe.zaber, recipe.timeout_s, what, lines)
    from truestand.devices.tables.grbl import GrblTable

    return GrblTable(recipe.address, recipe.grbl, recipe.timeout_s, what, lines)
