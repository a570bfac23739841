"""``[company]`` of stand.toml: whose name and logo stand at the head of the reports."""

import base64
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from truestand.core.errors import BadRecipe
from truestand.files.checking import checked
from truestand.files.recipes.recipes import CompanyRecipe, StandRecipe, read_toml

MOST_BYTES = 1_000_000
PNG = b"\x89PNG\r\n\x1a\n"
SVG = "{http://www.w3.org/2000/svg}svg"


@dataclass(frozen=True, slots=True)
class Company:
    """Who hands out the reports."""

    name: str = ""
    address: str = ""
    logo: str | None = None
    """A data URI, so that a report stays one file."""


def read_company(stand: Path | str) -> Company | None:
    """The company of a stand.toml; None where it has no ``[company]``.

    Raises:
        BadRecipe: a wrong or unknown key, or a logo that is missing, too large, or neither PNG nor SVG.
    """
    stand = Path(stand)
    recipe = checked(StandRecipe, read_toml(stand), str(stand)).company
    return None if recipe is None else _company(recipe, stand)


def _company(recipe: CompanyRecipe, stand: Path) -> Company:
    logo = None if recipe.logo is None else _data_uri(stand.parent / recipe.logo, f"{stand}: [company] logo")
    return Company(recipe.name, recipe.address, logo)


def _data_uri(path: Path, where: str) -> str:
    """A picture as text; what it is, is told by its content."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as wrong:
        raise BadRecipe(f"{where}: {path} can't be read ({wrong.strerror or wrong}); give a PNG or SVG file") from wrong
    if len(content) > MOST_BYTES:
        raise BadRecipe(f"{where}: {path} has more than {MOST_BYTES // 1_000_000} MB; save it smaller")
    kind = "png" if content.startswith(PNG) else "svg+xml" if _is_svg(content) else None
    if kind is None:
        raise BadRecipe(f"{where}: {path} is neither PNG nor SVG; save it as one of them")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _is_svg(content: bytes) -> bool:
    """Whether it is an SVG document; entities are not followed, no address is opened."""
    try:
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False))
    except (etree.XMLSyntaxError, ValueError):
        return False
    return bool(root.tag == SVG)
