"""The characteristics as CSV: RFC 4180, the record's digits, and no cell that a spreadsheet would run."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.frames import Pose
from truestand.core.inspection import Characteristic, Inspection
from truestand.core.stand import Stand
from truestand.files.records.inspection_record import (
    CSV_COLUMNS,
    characteristics_csv,
    inspection_record,
    write_characteristics,
)

LINES = (
    Characteristic("f_p", 0.0123456789, 0.0017, "left", None, limits=(None, 0.012), grade=9, verdict="does_not_conform",
                   standard="ISO 1328-1:2013"),
    Characteristic("f_Halpha", -0.003, 0.02, "right", 7, limits=(-0.0095, 0.0095), verdict="undecided", coverage=0.5,
                   status="partial"),
    Characteristic("d", 40.0123, 0.0045, section='hub, "A"\nlower', size=True, limits=(39.98, 40.02),
                   verdict="conforms"),
    Characteristic("M_d", None, None, size=True, status="not_measurable", coverage=0.0),
)  # fmt: skip
STILL = Pose(np.eye(3), np.zeros(3))


def inspection(lines=LINES):
    return Inspection("gear", "wheel", lines)


def rows(text):
    return list(csv.DictReader(io.StringIO(text, newline="")))


def test_every_line_is_there_with_the_record_s_digits():
    found = rows(characteristics_csv(LINES))
    calibration = Calibration("stand", STILL, STILL, Stand(), "index", "home")
    record = inspection_record(inspection(), calibration, (ScanSummary("", 1, 1, 1.0, 1.0),), "", "")
    for row, line in zip(found, record["characteristics"], strict=True):
        size = "value_mm" in line
        value, U = (line["value_mm"], line["U_mm"]) if size else (line["value_um"], line["U_um"])
        assert row["name"] == line["name"]
        assert row["unit"] == ("mm" if size else "um")
        assert row["value"] == ("" if value is None else repr(value))
        assert row["U"] == ("" if U is None else repr(U))
        assert row["k"] == ("" if U is None else "2")
        assert row["status"] == line["status"]
    assert [r["tooth"] for r in found] == ["", "7", "", ""]
    assert [(r["lower_limit"], r["upper_limit"]) for r in found] == [
        ("", "12.0"),
        ("-9.5", "9.5"),
        ("39.98", "40.02"),
        ("", ""),
    ]
    assert found[2]["section"] == 'hub, "A"\nlower'


def test_it_is_rfc_4180(tmp_path):
    write_characteristics(tmp_path / "c.csv", inspection())
    content = (tmp_path / "c.csv").read_bytes()
    assert content.endswith(b"\r\n")
    assert content.split(b"\r\n")[0].decode() == ",".join(CSV_COLUMNS)
    assert b'"hub, ""A""\nlower"' in content
    assert len(set(map(len, csv.reader(io.StringIO(content.decode(), newline=""))))) == 1


@pytest.mark.parametrize("evil", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", " =1", "|cmd", "%0"])
def test_no_text_begins_like_a_formula(evil):
    lines = (replace(LINES[2], section=evil, name=evil, standard=evil),)
    (row,) = rows(characteristics_csv(lines))
    for key in ("name", "section", "standard"):
        assert row[key] == f"'{evil}"


def test_negative_numbers_stay_numbers():
    row = rows(characteristics_csv(LINES))[1]
    assert float(row["value"]) == -3.0
    assert float(row["lower_limit"]) == -9.5
