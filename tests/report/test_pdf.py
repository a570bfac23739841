"""PDF reports: an extra that is missed in clear words, and pages where it is there."""

import sys
from pathlib import Path

import pytest

from truestand.core.errors import MissingExtra
from truestand.core.inspection import Characteristic, Inspection
from truestand.report.inspection import inspection_report
from truestand.report.pdf import check_report, write_report


def inspection():
    line = Characteristic("deviation_max", 0.0101, 0.0042, limits=(None, 0.03), verdict="conforms")
    return Inspection("cad", "bracket", (line,))


@pytest.fixture
def absent(monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)


def test_without_the_extra_it_says_what_to_install(absent, tmp_path):
    with pytest.raises(MissingExtra, match=r"pip install 'truestand\[pdf\]'"):
        check_report(tmp_path / "r.PDF")
    with pytest.raises(MissingExtra):
        write_report(tmp_path / "r.pdf", "<p>x</p>")
    assert list(tmp_path.iterdir()) == []


def test_without_its_system_libraries_it_names_them(monkeypatch, tmp_path):
    (tmp_path / "weasyprint.py").write_text("raise OSError('cannot load library libpango-1.0-0: no such file')")
    monkeypatch.delitem(sys.modules, "weasyprint", raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingExtra, match=r"apt install libpango-1\.0-0"):
        check_report(tmp_path / "r.pdf")


def test_html_needs_no_extra(absent, tmp_path):
    check_report(None)
    check_report(Path("r.html"))
    write_report(tmp_path / "r.html", "<p>x</p>")
    assert (tmp_path / "r.html").read_text() == "<p>x</p>"


def weasyprint():
    try:
        return pytest.importorskip("weasyprint", reason="the extra pdf is not installed")
    except OSError:
        pytest.skip("weasyprint lacks its system libraries")


def test_a_report_becomes_pages(tmp_path):
    weasyprint()
    write_report(tmp_path / "r.pdf", inspection_report(inspection()))
    content = (tmp_path / "r.pdf").read_bytes()
    assert content.startswith(b"%PDF-")
    assert content.rstrip().endswith(b"%%EOF")


def test_a_report_opens_no_address(tmp_path, caplog):
    weasyprint()
    (tmp_path / "secret.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>')
    for address in ((tmp_path / "secret.svg").as_uri(), "http://127.0.0.1:9/x.png"):
        caplog.clear()
        write_report(tmp_path / "r.pdf", f'<img src="{address}">')
        assert "disallowed protocol" in caplog.text
