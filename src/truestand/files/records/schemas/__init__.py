"""JSON Schemas of the records, as they ship in the package."""

from importlib.resources import files

from truestand.core.errors import BadRecipe

NAMES = ("calibration", "verification", "inspection", "info", "truth", "form", "comparison", "plan")


def schema_text(name: str) -> str:
    """The JSON Schema of the record ``name``, as text.

    Raises:
        BadRecipe: no such record.
    """
    if name not in NAMES:
        raise BadRecipe(f"found no schema {name!r}, need one of {', '.join(NAMES)}")
    return files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8")
