"""The report: one file, complete, escaped, and the same for the same input."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.evidence import gather
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


def test_what_is_not_identifiable_is_said():
    text = page("centred")
    assert "laser_plane_offset_mm" in text
    assert "Its doubt is carried on" in text
    assert "Not identifiable: nothing. Every quantity of the stand was seen." in page("from above")


def test_what_is_not_identifiable_is_said_before_any_number():
    text = page("centred")
    assert text.index("Not identifiable from this scan") < text.index('class="tiles"') < text.index("<table")


def test_every_u_has_its_k():
    text = page("from above")
    assert text.index("<i>k</i> = 2") < text.index("<table")
    for head in re.findall(r"<thead>.*?</thead>", text):
        if "± U" in head:
            assert "k = 2" in head
    assert "It states no uncertainty" in text


def test_errors_against_the_truth_stand_there_only_with_a_truth():
    assert "truth" in page("from above").lower()
    assert "<th>truth" not in page("from above", truth=False).lower()


def test_the_published_method_alone_has_its_report():
    text = page("from above", "paper")
    assert "Leakage" in text
    assert "does not ask for the laser plane" in text
    assert "None" not in re.sub(r"<style>.*</style>|data:[^\"]*", "", text)


def test_names_from_files_are_escaped():
    calibration, paper, evidence = made("from above")
    evil = replace(calibration.artefact, name="<script>alert(1)</script>")
    text = calibration_report(replace(calibration, artefact=evil, reasons=("<b>x</b>",)), evidence, paper)
    assert "<script>" not in text
    assert "<b>x</b>" not in text
    assert "Untrusted" in text


def test_a_calibration_without_form_or_checks_still_has_a_report():
    calibration, paper, evidence = made("from above")
    bare = replace(calibration, harmonics=(), checks=(), static_profiles=(), uncertainty={}, residuals=None, scan=None)
    assert "What the sensor saw" in calibration_report(bare, evidence, paper)


@pytest.mark.parametrize("method", ["stand", "paper"])
def test_the_terminal_table_has_a_row_a_quantity(method):
    calibration, paper, _ = made("from above", method)
    table = summary_table(calibration, paper, truth_of("from above"))
    assert table.row_count >= 5
