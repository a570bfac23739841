"""The page about tables names every key of the recipe, and its recipes are recipes."""

import re
import tomllib
from pathlib import Path

from truestand.devices.tables import recipe
from truestand.files.checking import checked

PAGE = (Path(__file__).parents[2] / "docs" / "protocols-tables.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_every_key_is_in_an_example():
    for model in (recipe.TableRecipe, recipe.ModbusRecipe, recipe.OpcUaRecipe, recipe.ZaberRecipe, recipe.GrblRecipe):
        for key in set(model.model_fields) - {"modbus", "opcua", "zaber", "grbl"}:
            assert any(re.search(rf"^{key} = ", block, re.MULTILINE) for block in BLOCKS), key


def test_every_example_is_a_recipe():
    assert len(BLOCKS) == 5
    for block in BLOCKS:
        checked(recipe.TableRecipe, tomllib.loads(block)["devices"]["table"], "protocols-tables.md")


def test_the_defaults_are_those_of_the_page():
    for name, model in (("modbus", recipe.ModbusRecipe), ("opcua", recipe.OpcUaRecipe), ("zaber", recipe.ZaberRecipe)):
        (told,) = (t for b in BLOCKS if (t := tomllib.loads(b)["devices"]["table"].get(name)))
        told.pop("heartbeat", None)
        assert told == {k: v for k, v in model().model_dump().items() if k != "heartbeat"}
