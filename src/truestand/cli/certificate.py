"""``truestand certificate``: the calibration as a Digital Calibration Certificate."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import UNDECIDED, JsonOption, QuietOption, output_option
from truestand.cli.terminal import hint, print_json
from truestand.core.errors import BadRecipe
from truestand.files.atomic import write_bytes_atomic
from truestand.files.json_text import parse_json
from truestand.files.recipes.laboratory import read_laboratory
from truestand.files.records.calibration_record import read_calibration
from truestand.files.records.xml_schema import read_schema, violations
from truestand.report.certificate import certificate_xml, missing_statements, refusals
from truestand.report.certificate_administration import CertificateInput


def certificate(
    calibration: Annotated[Path, typer.Argument(metavar="CALIBRATION.json", help="A valid calibration.")],
    output: Annotated[
        Path, output_option("--output", "-o", metavar="DCC.xml", help="The certificate to write.")
    ] = Path("dcc.xml"),
    schema_dir: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Hold it against dcc.xsd of this folder, offline.")
    ] = None,
    laboratory: Annotated[
        Path | None,
        typer.Option(metavar="LABORATORY.toml", help="Who issues it, for whom; without: a draft that says so."),
    ] = None,
    number: Annotated[
        str | None, typer.Option(help="The certificate's number; default: one out of date and content.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write the calibration as a Digital Calibration Certificate (DCC 3.3): 0 written, 3 there can be none.

    Example: truestand certificate calibration.json --laboratory laboratory.toml -o dcc.xml
    """
    schema = None if schema_dir is None else read_schema(schema_dir)
    stated = None if laboratory is None else read_laboratory(laboratory)
    known, source = read_calibration(calibration), calibration.read_bytes()
    record = parse_json(source.decode("utf-8-sig"), str(calibration), "give a calibration.json")
    reasons = refusals(record)
    for reason in reasons:
        hint(f"no certificate: {reason}", quiet)
    if reasons:
        raise typer.Exit(UNDECIDED)
    given = CertificateInput(record, known, source, calibration.name, stated, number)
    text = certificate_xml(given)
    if schema is not None and (wrong := violations(text, schema)):
        raise BadRecipe(f"{schema_dir}: the certificate is not valid by this schema: {'; '.join(wrong)}")
    write_bytes_atomic(output, text)
    missing = missing_statements(given)
    if as_json:
        print_json({"certificate": str(output), "identifier": given.identifier, "draft": given.draft,
                    "not_stated": missing, "validated": schema is not None})  # fmt: skip
    elif not quiet:
        typer.echo(output)
    if missing:
        hint(f"a draft: nobody stated {'; '.join(missing)}; see docs/certificate.md", quiet)
