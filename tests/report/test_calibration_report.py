"""The report: one file, complete, escaped, and the same for the same input."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.evidence import gather
from truestand.report import drawing
from truestand.report.calibration import calibration_report
from truestand.report.terminal import summary_table
from truth import scan_of, shaft, truth_of


@cache
def made(name, method="stand"):
    scan = scan_of(name)
    calibration, paper = calibrate(scan, shaft(), method), calibrate(scan, shaft(), "paper")
    return calibration, paper, gather(scan, shaft(), calibration, paper)


@cache
def page(name, method="stand", truth=True):
    calibration, paper, evidence = made(name, method)
    return calibration_report(calibration, evidence, paper, truth_of(name) if truth else None)


def text(name, truth=True, **changes):
    """The page with other content of the calibration; its figures are drawn and not written, in half the time."""
    calibration, paper, evidence = made(name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "svg", lambda fig: "")
        return calibration_report(replace(calibration, **changes), evidence, paper, truth_of(name) if truth else None)


class Tags(HTMLParser):
    """Counts tags and checks that they close."""

    VOID = frozenset({"meta", "br", "img", "link", "hr", "input"})

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.seen.append(tag)

    def handle_endtag(self, tag):
        assert self.open
        assert self.open.pop() == tag


def test_it_is_one_well_formed_file_with_every_figure():
    text = page("from above")
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.seen.count("svg") >= 9
    assert not {"script", "link", "iframe"} & set(tags.seen)
    assert not re.search(r"(src|href)=\"(?!#|data:)", text)


@pytest.mark.more
def test_the_same_input_gives_the_same_bytes():
    assert page.__wrapped__("from above") == page("from above")


@pytest.mark.more
def test_what_is_not_identifiable_is_said():
    centred = text("centred")
    assert "laser_plane_offset_mm" in centred
    assert "Its doubt is carried on" in centred
    assert "Not identifiable: nothing. Every quantity of the stand was seen." in text("from above")


def test_what_is_not_identifiable_is_said_before_any_number():
    centred = text("centred")
    assert centred.index("Not identifiable from this scan") < centred.index('class="tiles"') < centred.index("<table")


def test_every_u_has_its_k():
    above = text("from above")
    assert above.index("<i>k</i> = 2") < above.index("<table")
    for head in re.findall(r"<thead>.*?</thead>", above):
        if "± U" in head:
            assert "k = 2" in head
    assert "It states no uncertainty" in above


def test_errors_against_the_truth_stand_there_only_with_a_truth():
    assert '<th class="n">truth' in text("from above")
    assert '<th class="n">truth' not in text("from above", truth=False)


@pytest.mark.more
def test_the_published_method_alone_has_its_report():
    text = page("from above", "paper")
    assert "Leakage" in text
    assert "does not ask for the laser plane" in text
    assert "None" not in re.sub(r"<style>.*</style>|data:[^\"]*", "", text)


def test_names_from_files_are_escaped():
    evil = replace(made("from above")[0].artefact, name="<script>alert(1)</script>")
    untrusted = text("from above", artefact=evil, reasons=("<b>x</b>",))
    assert "<script>" not in untrusted
    assert "<b>x</b>" not in untrusted
    assert "Untrusted" in untrusted


def test_a_calibration_without_form_or_checks_still_has_a_report():
    bare = {"harmonics": (), "checks": (), "static_profiles": (), "uncertainty": {}, "residuals": None, "scan": None}
    assert "What the sensor saw" in text("from above", **bare)


@pytest.mark.parametrize("method", ["stand", "paper"])
def test_the_terminal_table_has_a_row_a_quantity(method):
    calibration, paper, _ = made("from above", method)
    shown = summary_table(calibration, paper, truth_of("from above"))
    table = shown if method == "paper" else shown.renderables[0]
    assert table.row_count >= 5


def test_the_terminal_tells_what_makes_most_of_u_in_one_line():
    _, line = summary_table(made("from above")[0]).renderables
    assert re.fullmatch(
        r"U² of Angle φ is \d+% linearity of the sensor \((stated|assumed|as the scan .*)\): .+", line.plain
    )


def test_it_says_what_makes_u_and_how_to_make_it_smaller():
    sensor = replace(made("from above")[0].stand.sensor, linearity_U=None)
    page = text("from above", stand=replace(made("from above")[0].stand, sensors=(sensor,)))
    table = page.partition("What makes U, and how to make it smaller")[2].partition("</table>")[0]
    assert "linearity of the sensor" in table and "coaxiality of the steps" in table
    assert re.search(r"Laser plane, offset \d+\N{NO-BREAK SPACE}%", table)
    assert "<code>--clamped-at-deg 0,180</code>" in table


def test_units_read_as_people_write_them():
    page = text("from above")
    assumed = page.partition("What was assumed")[2].partition("</table>")[0]
    assert "± 0.5 µm" in assumed and "11.5 ppm/K" in assumed and "± 41.3″" in assumed
    assert not re.search(r"\bum\b|\de[-+]\d", page.partition("<h2>What makes U")[2].partition("<h2>Checks")[0])
