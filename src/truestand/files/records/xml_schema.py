"""XML validated offline by the schemas of a folder: every import is taken from that folder by its file name.

Published schemas name each other by web address. None is ever opened: a file missing in the folder is an error.
"""

from pathlib import Path
from typing import Any

from lxml import etree

from truestand.core.errors import BadRecipe

MOST_LISTED = 3
"""Violations named in one message."""


class _Folder(etree.Resolver):  # type: ignore[misc]
    """Gives a schema's imports from one folder, by file name; remembers what it did not find."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.missing: list[str] = []

    def resolve(self, url: str, public_id: str | None, context: Any) -> Any:
        """The file of that name, whatever the address before it."""
        name = url.rstrip("/").rsplit("/", 1)[-1]
        if not (self.folder / name).is_file():
            self.missing.append(name)
            return self.resolve_empty(context)
        return self.resolve_file((self.folder / name).open("rb"), context, base_url=url)


def read_schema(folder: Path | str, name: str = "dcc.xsd") -> etree.XMLSchema:
    """The schema ``name`` of a folder, with what it imports.

    Raises:
        BadRecipe: the folder lacks one of its files, or one is no schema.
    """
    folder = Path(folder)
    if not (folder / name).is_file():
        raise BadRecipe(f"{folder}: found no {name}, need the schemas of the certificate; give their folder")
    resolver = _Folder(folder)
    parser = etree.XMLParser(no_network=True, load_dtd=False, huge_tree=False)
    parser.resolvers.add(resolver)
    try:
        return etree.XMLSchema(etree.parse(str(folder / name), parser))
    except (etree.XMLSyntaxError, etree.XMLSchemaParseError) as wrong:
        missing = f"found no {', '.join(resolver.missing)}, " if resolver.missing else ""
        raise BadRecipe(f"{folder / name}: {missing}no usable schema ({str(wrong)[:200]})") from wrong


def violations(text: bytes, schema: etree.XMLSchema) -> list[str]:
    """What in an XML text is not as the schema demands, each with its line; empty where it is valid."""
    document = etree.fromstring(text, etree.XMLParser(no_network=True, resolve_entities=False, huge_tree=True))
    if schema.validate(document):
        return []
    found = [f"line {e.line}: {e.message}" for e in schema.error_log]
    more = len(found) - MOST_LISTED
    return [*found[:MOST_LISTED], f"{more} more"] if more > 0 else found
