"""From a recipe to a table that answers. Each driver's library is loaded only where the recipe asks for it."""

from contextlib import ExitStack

from truestand.devices.axis import Drive, RotaryTable
from truestand.devices.tables.recipe import TableRecipe


def open_table(recipe: TableRecipe) -> RotaryTable:
    """The table of ``[devices.table]``, connected, its state read once; nothing moves.

    Raises:
        DeviceLost: nobody answers at the address.
        DeviceError: what answers isn't such a table.
    """
    drive = _drive(recipe)
    with ExitStack() as on_failure:
        on_failure.callback(drive.close)
        drive.state()
        on_failure.pop_all()
    return RotaryTable(drive, recipe.limits)


def _drive(recipe: TableRecipe) -> Drive:
    if recipe.protocol == "modbus":
        from truestand.devices.tables.modbus import ModbusTable

        return ModbusTable(recipe.address, recipe.modbus, recipe.timeout_s)
    if recipe.protocol == "opcua":
        from truestand.devices.tables.opcua import OpcUaTable

        return OpcUaTable(recipe.address, recipe.opcua, recipe.timeout_s)
    if recipe.protocol == "zaber":
        from truestand.devices.tables.zaber import ZaberTable

        return ZaberTable(recipe.address, recipe.zaber, recipe.timeout_s)
    from truestand.devices.tables.grbl import GrblTable

    return GrblTable(recipe.address, recipe.grbl, recipe.timeout_s)
