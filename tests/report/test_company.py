"""The company at the head of the reports: both alike, one file, nothing but a picture let in as logo."""

import base64
import re
import struct
import zlib
from functools import cache

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.evidence import gather
from truestand.core.errors import BadRecipe
from truestand.core.inspection import Characteristic, Inspection
from truestand.files.recipes.recipes import MOST_LOGO_BYTES, Company, read_company
from truestand.report import drawing
from truestand.report.calibration import calibration_report
from truestand.report.inspection import inspection_report
from truth import scan_of, shaft

STAND = '[company]\nname = "M & <b>"\naddress = """Street 1\nTown"""\n{}\n[[sensor]]\nname = "front"\n'
SVG = b'<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"><rect/></svg>'


def png():
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0\0")) + chunk(b"IEND", b"")


def stand(folder, logo=None, name="logo.any"):
    if logo is not None:
        (folder / name).write_bytes(logo)
    line = "" if logo is None else f'logo = "{name}"'
    (folder / "stand.toml").write_text(STAND.format(line), encoding="utf-8")
    return folder / "stand.toml"


@pytest.mark.parametrize(("content", "kind"), [(png(), "png"), (SVG, "svg+xml")])
def test_the_kind_of_a_logo_is_found_from_its_content(tmp_path, content, kind):
    company = read_company(stand(tmp_path, content))
    assert company.logo == f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
    assert company.name == "M & <b>"


def test_a_company_needs_no_logo_and_a_stand_no_company(tmp_path):
    assert read_company(stand(tmp_path)).logo is None
    (tmp_path / "stand.toml").write_text('[[sensor]]\nname = "front"\n')
    assert read_company(tmp_path / "stand.toml") is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "neither PNG nor SVG"),
        (b"GIF89a", "neither PNG nor SVG"),
        (b"<html><svg/></html>", "neither PNG nor SVG"),
        (b"<svg>", "neither PNG nor SVG"),
        (png() + b"\0" * MOST_LOGO_BYTES, "more than 1 MB"),
    ],
)
def test_what_is_no_logo_is_refused(tmp_path, content, message):
    with pytest.raises(BadRecipe, match=message):
        read_company(stand(tmp_path, content))


def test_a_logo_that_is_not_there_is_named(tmp_path):
    path = stand(tmp_path, b"")
    (tmp_path / "logo.any").unlink()
    with pytest.raises(BadRecipe, match=r"logo\.any can't be read"):
        read_company(path)


def test_an_entity_bomb_is_no_logo(tmp_path):
    rows = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE svg [<!ENTITY e0 "ha">{rows}]><svg xmlns="http://www.w3.org/2000/svg"><text>&e11;</text></svg>'
    with pytest.raises(BadRecipe, match="neither PNG nor SVG"):
        read_company(stand(tmp_path, bomb.encode()))


@cache
def calibrated():
    scan = scan_of("from above")
    calibration = calibrate(scan, shaft())
    return calibration, gather(scan, shaft(), calibration, None)


def inspection():
    line = Characteristic("deviation_max", 0.0101, 0.0042, limits=(None, 0.03), verdict="conforms")
    return Inspection("cad", "bracket", (line,))


def texts(company=None):
    """Both reports; their figures are drawn and not written, in half the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "svg", lambda fig: "")
        return (
            calibration_report(*calibrated(), None, None, company),
            inspection_report(inspection(), None, None, company),
        )


def heads(made):
    return [re.search(r"<header>.*?</header>", t)[0] for t in made]


def test_both_reports_have_one_look():
    made = texts(Company("M & <b>", "Street 1\n\n<i>Town", "data:image/png;base64,AA"))
    for text in heads(made):
        assert '<img src="data:image/png;base64,AA" alt="">' in text
        assert "M &amp; &lt;b&gt;" in text
        assert "Street 1<br>&lt;i&gt;Town" in text
    first, second = (re.sub(r">[^<]*<", "><", text) for text in heads(made))
    assert first == second
    first, second = (re.search(r"<style>.*?</style>", text, re.DOTALL)[0] for text in made)
    assert first == second
    assert all("<body>" in text for text in made)


def test_without_a_company_the_head_has_none():
    assert "company" not in "".join(heads(texts()))
