"""Rotary tables: one driver a protocol, opened by the recipe in stand.toml."""

from truestand.devices.tables.opening import open_table
from truestand.devices.tables.recipe import TableRecipe

__all__ = ["TableRecipe", "open_table"]
