"""A report on disk: HTML, or PDF where the file is called so. PDF is an extra, laid out by weasyprint."""

from pathlib import Path
from typing import Any

from truestand.core.errors import MissingExtra
from truestand.files.atomic import write_bytes_atomic, write_text_atomic

MISSING_PACKAGE = "PDF needs an extra package; install it with: pip install 'truestand[pdf]'"
MISSING_LIBRARIES = (
    "PDF needs system libraries that are missing ({}); Debian: apt install libpango-1.0-0 libpangoft2-1.0-0 "
    "libharfbuzz-subset0; or write HTML and print it with a browser"
)


def is_pdf(path: Path) -> bool:
    """Whether a report of that name is to be a PDF."""
    return path.suffix.lower() == ".pdf"


def check_report(path: Path | None) -> None:
    """Refuse a report that can't be written, before the work is done.

    Raises:
        MissingExtra: a PDF without its extra or its system libraries.
    """
    if path is not None and is_pdf(path):
        _weasyprint()


def write_report(path: Path, html: str) -> None:
    """The report, as a whole or not at all; PDF where the suffix says so.

    Raises:
        MissingExtra: as ``check_report``.
    """
    if is_pdf(path):
        write_bytes_atomic(path, pdf(html))
    else:
        write_text_atomic(path, html)


def pdf(html: str) -> bytes:
    """The pages of a report; no address is opened, a report brings all of its own."""
    weasyprint = _weasyprint()
    embedded_only = weasyprint.urls.URLFetcher(allowed_protocols=("data",))
    return bytes(weasyprint.HTML(string=html, url_fetcher=embedded_only).write_pdf())


def _weasyprint() -> Any:
    """The library, if it and what it loads are there."""
    try:
        import weasyprint
    except ImportError as wrong:
        raise MissingExtra(MISSING_PACKAGE) from wrong
    except OSError as wrong:
        raise MissingExtra(MISSING_LIBRARIES.format(str(wrong).split(":")[0][:120])) from wrong
    return weasyprint
