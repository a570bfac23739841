"""The report of an inspection: one file, complete, escaped, honest about what was not seen, always the same."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from math import radians
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from solids import Wheel, calibration, extruded, noisy, scanned
from truestand.core.calibration import Contribution
from truestand.core.inspection import Characteristic, Defect, Inspection
from truestand.core.message import RECIPE_CHANGED, Message
from truestand.core.surface import apply_calibration
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.parts.cad import CadEvidence
from truestand.parts.turned import SectionEvidence, TurnedEvidence
from truestand.report.gear_traces import _names_beneath
from truestand.report.inspection import inspection_report

DENT = Defect(5, "left", 8.0, 15.0, 0.0547, 1.19, "dent", 42.0, 0.998)
GONE = Defect(12, None, None, 15.0, 4.5, 19.6, "missing tooth", 300.0)


@cache
def gear():
    """A coarse but whole scan of an exact wheel."""
    own, known = Wheel(), calibration()
    mesh = extruded(own.outline(40), own.bottom, own.top)
    scan = noisy(scanned(mesh, known, None, radians(0.7), profiles=2400, points=80), 0.002)
    return inspect_gear(
        apply_calibration(scan, known), Gear(24, 2.0, 20.0, 5.0, 52.0, 43.0, accuracy_class=8, name="wheel 7")
    )


@cache
def page():
    """The whole page, with a dent."""
    return inspection_report(replace(gear(), defects=(DENT,)), calibration())


def tables():
    """The gear without evidence: its page has tables and no figures but one."""
    return replace(gear(), evidence=None)


def changed(value=0.0234, U=0.0017, verdict="does_not_conform", name="f_p"):
    """The gear's inspection with one left line that says what a test wants to find."""
    inspection = tables()
    lines = tuple(
        replace(c, value=value, U=U, verdict=verdict) if (c.name, c.flank, c.tooth) == (name, "left", None) else c
        for c in inspection.characteristics
    )
    return replace(inspection, characteristics=lines)


def without(side):
    """The gear with the flanks of one side hidden."""
    inspection = gear()
    e = inspection.evidence
    index = 0 if side == "left" else 1
    hidden = np.zeros(2, dtype=bool)
    hidden[index] = True

    def blind(a):
        return np.where(hidden.reshape(2, *[1] * (a.ndim - 1)), np.nan, a)

    fields = ("position", "profile", "helix", "index", "pitch")
    of_flank = {name: blind(values) for name, values in e.measures.of_flank.items()}
    blinded = {f: blind(getattr(e.measures, f)) for f in fields}
    measures = replace(e.measures, **blinded, of_flank=of_flank, runout=np.full(24, np.nan))
    grid = replace(e.grid, delta=blind(e.grid.delta), count=np.nan_to_num(blind(e.grid.count)))
    lines = tuple(
        replace(c, value=None, U=None, grade=None, coverage=0.0, status="not_measurable", budget=(), verdict=None)
        if c.flank == side
        else c
        for c in inspection.characteristics
    )
    found = replace(e.defect_map, residual=blind(e.defect_map.residual), score=blind(e.defect_map.score))
    evidence = replace(e, measures=measures, grid=grid, defect_map=found)
    return replace(inspection, characteristics=lines, evidence=evidence, published={})


def turned():
    a = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    wave = 0.004 * np.cos(3 * a) + np.zeros((4, 1))
    wave[0] = np.nan
    section = SectionEvidence("<i>hub</i> $", 20.0, a, np.arange(4.0), wave, wave, np.zeros((4, 2)), 0.0005)
    lines = (
        Characteristic("d", 40.0123, 0.0045, section=section.name, size=True, limits=(39.98, 40.02), verdict="conforms",
                       budget=(Contribution("linearity of the sensor", 0.0044),)),
        Characteristic("roundness", 0.0087, 0.0012, section=section.name, limits=(None, 0.006),
                       verdict="does_not_conform"),
        Characteristic("d", None, None, section="neck", size=True, status="not_measurable", coverage=0.0),
    )  # fmt: skip
    return Inspection("turned", "hub", lines, evidence=TurnedEvidence((section,)), settings={"filter": "50 UPR"})


def cad():
    a = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    deviation = 0.01 * np.sin(a) + np.zeros((6, 1))
    evidence = CadEvidence(a, np.arange(6.0), deviation, np.eye(4), 0.0, 0.61)
    lines = (
        Characteristic("deviation_max", 0.0101, 0.0042, limits=(None, 0.03), verdict="conforms"),
        Characteristic("deviation_min", -0.0102, 0.0042, limits=(-0.03, None), verdict="conforms"),
    )
    return Inspection("cad", "bracket", lines, evidence=evidence)


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


def told(text):
    """Rows of the page's tables as plain text, without figures and style."""
    text = re.sub(r"<style>.*?</style>|<svg.*?</svg>", "", text, flags=re.DOTALL)
    return [re.sub(r"<[^>]*>", " ", row) for row in re.findall(r"<tr.*?</tr>", text, flags=re.DOTALL)]


@pytest.mark.parametrize("make", [page, lambda: inspection_report(turned()), lambda: inspection_report(cad())])
def test_it_is_one_well_formed_file_without_scripts(make):
    text = make()
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.seen.count("svg") >= 2
    assert not {"script", "link", "iframe"} & set(tags.seen)
    assert not re.search(r"(src|href)=\"(?!#|data:)", text)
    assert len(text) < 3e6


def test_a_gear_has_every_section():
    text = page()
    for heading in (
        "Results", "Worst tooth", "Every tooth", "Profile", "Helix", "Pitch and run-out", "Flanks", "Defects",
        "Uncertainty", "How it was evaluated", "sensor front", "24 teeth", "What the published compensation",
    ):  # fmt: skip
        assert heading in text
    assert "Klarák et al., Sensors 2022, 22, 5306" in text


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes():
    assert inspection_report(replace(gear(), defects=(DENT,)), calibration()) == page()


def test_the_numbers_are_the_record_s():
    text = inspection_report(changed())
    row = next(r for r in told(text) if "largest single pitch" in r)
    assert "23.4" in row
    assert "1.7" in row
    assert "does not conform" in row
    assert "Does not conform" in text
    assert "limit 17" in text


def test_what_can_not_be_shown_is_said():
    inspection = changed(0.001, 0.05, "undecided", "f_Halpha")
    lines = tuple(replace(c, capable=c.name != "f_Halpha") for c in inspection.characteristics)
    assert "Not capable" in inspection_report(replace(inspection, characteristics=lines))


@pytest.mark.more
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hidden_flank_is_not_measurable_and_shows_no_number(side):
    inspection = without(side)
    text = inspection_report(inspection if side == "left" else replace(inspection, evidence=None))
    assert "Not measurable in this scan" in text
    assert f"{side} flanks:" in text
    row = next(r for r in told(text) if "largest single pitch" in r)
    assert "not measurable" in row
    first, second = row.split("not measurable")
    own = first.split("deviation", 1)[1] if side == "left" else second
    assert len(re.findall(r"\d+", own)) <= 1  # the limit


@pytest.mark.more
def test_a_missing_tooth_leaves_gaps():
    inspection = gear()
    e = inspection.evidence
    fields = ("position", "index", "pitch", "profile", "helix")
    measures = {f: np.array(getattr(e.measures, f)) for f in fields}
    for values in measures.values():
        values[:, 11] = np.nan
    delta = np.array(e.grid.delta)
    delta[:, 11] = np.nan
    evidence = replace(e, measures=replace(e.measures, **measures), grid=replace(e.grid, delta=delta))
    lines = tuple(
        replace(c, value=None, status="not_measurable") if c.tooth == 12 else c for c in inspection.characteristics
    )
    text = inspection_report(replace(inspection, evidence=evidence, characteristics=lines, defects=(GONE, DENT)))
    assert "missing tooth" in text
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL).lower()
    dent = next(r for r in told(text) if "dent" in r)
    assert all(part in dent for part in ("8.00", "15.00", "54.7", "1.19", "42.0", "0.998"))


def test_no_defect_is_said():
    assert "None found." in inspection_report(replace(tables(), defects=()))


def test_a_long_list_of_defects_is_folded():
    assert "10 more, less striking" in inspection_report(replace(tables(), defects=(DENT,) * 30))


def test_errors_stand_there_only_with_a_truth():
    truth = {"part": {"kind": "gear", "f_p_left_um": 23.11, "F_r_um": None, "profile": {}, "helix": {}}}
    row = next(r for r in told(inspection_report(changed(), None, truth)) if "largest single pitch" in r)
    assert "23.1 " in row
    assert "0.3" in row
    assert '<th class="n">true</th>' not in inspection_report(changed(), None, {"part": {"kind": "cad"}})


def test_texts_from_files_are_escaped():
    evil = "<script>alert(1)</script>"
    inspection = replace(tables(), name=evil, reasons=(evil,), remarks=(evil,), settings={evil: evil}, created=evil)
    inspection = replace(inspection, defects=(replace(DENT, kind=evil),))
    text = inspection_report(inspection)
    assert "<script>" not in text
    assert "nothing may be decided" in text


def test_remarks_write_micrometres_as_tables_do():
    text = inspection_report(replace(tables(), reasons=("5.1 um off",), remarks=("a wave of 3.0 um",)))
    assert "5.1 µm off" in text and "a wave of 3.0 µm" in text


def test_a_record_without_evidence_still_has_its_tables():
    text = inspection_report(tables())
    assert "Profile: mean of all teeth" in text
    assert "Topography" not in text


@pytest.mark.parametrize(
    ("limits", "told"), [((-0.006, 0.006), "(± 6)"), ((None, 0.006), "(6)"), ((-0.006, 0.009), "(−6 … 9)")]
)
def test_a_chart_shows_a_limit_as_its_line_has_it(limits, told):
    lines = {("C_alpha", "left", 1): Characteristic("C_alpha", 0.001, 0.0005, "left", 1, limits=limits)}
    axes = Figure().subplots()
    _names_beneath(axes, SimpleNamespace(names=("C_alpha",), lines=lines))
    assert axes.texts[0].get_text().endswith(f"{told} µm")


def test_a_turned_part_lists_its_sections():
    text = inspection_report(turned())
    assert "<i>hub</i> $" not in text
    rows = told(text)
    assert any("40.0123" in r and "0.0045" in r and "39.98 … 40.02" in r for r in rows)
    assert any("8.7" in r and "does not conform" in r for r in rows)
    assert any("not measurable" in r for r in rows)
    assert "RONt" in text


def test_a_comparison_with_a_model_shows_limits_and_visibility():
    text = inspection_report(cad())
    assert any("10.1" in r and "conforms" in r for r in told(text))
    assert "61 %" in text
    assert "patches" in text


def test_it_says_what_makes_u_of_the_main_characteristics():
    table = page().partition("What makes U, and how to make it smaller")[2].partition("</table>")[0]
    assert "incidence on the flanks<small>assumed: ± 20 µm</small>" in table
    assert "<code>incidence_U_um</code>" in table
    shares = [float(found) for found in re.findall(r"(\d+)\N{NO-BREAK SPACE}%", table)]
    assert shares and all(share <= 100 for share in shares)


def test_a_part_that_conforms_by_changed_recipes_is_not_shown_green():
    change = Message(RECIPE_CHANGED, "changed since the calibration: stand.toml: points is 320, was 640")
    conforms = replace(tables(), reasons=(), defects=(), characteristics=())
    assert '<section class="stamp conforms">' in inspection_report(conforms)
    page = inspection_report(replace(conforms, remarks=(change,)))
    assert '<section class="stamp undecided">' in page and "Conforms, in doubt" in page and change in page
