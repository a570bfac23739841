"""The page's own files, and plotly.js out of the installed package."""

from importlib.util import find_spec
from pathlib import Path

from starlette.responses import FileResponse

from truestand.web.problem import Problem
from truestand.web.routing import ANYONE, Routes

STATIC = Path(__file__).parent.parent / "static"
TYPES = {
    ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json",
    ".svg": "image/svg+xml", ".png": "image/png", ".woff2": "font/woff2", ".ico": "image/x-icon",
}  # fmt: skip
"""Served with these types only; mimetypes would ask the machine."""


routes = Routes()
"""Served after all others, because any other name is looked for here."""


@routes.add("GET", "/", ANYONE, "The page", include_in_schema=False)
def index() -> FileResponse:
    """The one HTML file."""
    return static("index.html")


@routes.add("GET", "/vendor/plotly.min.js", ANYONE, "plotly.js", (404,), include_in_schema=False)
def plotly() -> FileResponse:
    """The script of the installed plotly; it changes with the package only."""
    spec = find_spec("plotly")
    path = Path(spec.origin).parent / "package_data" / "plotly.min.js" if spec and spec.origin else None
    if path is None or not path.exists():
        raise Problem(404, "found no plotly package, charts need it; install it with: pip install plotly")
    return FileResponse(path, media_type=TYPES[".js"], headers={"cache-control": "private, max-age=86400"})


@routes.add("GET", "/{name:path}", ANYONE, "A file of the page", (404,), include_in_schema=False)
def static(name: str) -> FileResponse:
    """One of the files that are there: a name is looked up, never resolved."""
    path = _files().get(name)
    if path is None:
        raise Problem(404, "found no such file; load the page again")
    return FileResponse(path, media_type=TYPES[path.suffix], headers={"cache-control": "no-cache"})


def _files() -> dict[str, Path]:
    """By their name under static/."""
    files = (p for p in STATIC.rglob("*") if p.suffix in TYPES and p.is_file() and not p.is_symlink())
    return {p.relative_to(STATIC).as_posix(): p for p in files}
