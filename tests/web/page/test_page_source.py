"""What the source shows: every text in the table, nothing parsed as HTML, nothing inline, nothing from elsewhere."""

import json
import re

from truestand.web.routes.files import STATIC

TEXTS = json.loads((STATIC / "texts" / "en.json").read_text(encoding="utf-8"))
SCRIPTS = {p: p.read_text(encoding="utf-8") for p in sorted(STATIC.rglob("*.js"))}
SOURCE = "\n".join(SCRIPTS.values())
PLURALS = ("one", "other")
GIVEN = re.compile(r"""(?:\bt|known)\(\s*(?:[^()"`]*\?\s*)?["`]([^"`]+)["`]""")
ANY_KEY = re.compile(r"""["`]([a-z_]+(?:\.[^"`\s]+)+)["`]""")


def asked():
    """Keys that the code names, and the beginnings of those that it puts together."""
    named = set(ANY_KEY.findall(SOURCE))
    whole = {key for key in named if "${" not in key}
    begun = {key.split("${")[0] for key in named if "${" in key}
    return whole, begun


def test_every_text_key_of_the_code_is_in_the_table():
    keys = {key for key in GIVEN.findall(SOURCE) if "${" not in key}
    assert keys and not {key for key in keys if key not in TEXTS and not any(f"{key}.{p}" in TEXTS for p in PLURALS)}


def test_every_text_of_the_table_is_used():
    whole, begun = asked()
    plain = {re.sub(rf"\.({'|'.join(PLURALS)})$", "", key) for key in TEXTS}
    assert not {key for key in plain if key not in whole and not any(key.startswith(b) for b in begun)}


def test_text_keys_are_unique():
    pairs = json.loads((STATIC / "texts" / "en.json").read_text(encoding="utf-8"), object_pairs_hook=list)
    keys = [key for key, _ in pairs]
    assert len(keys) == len(set(keys))


def test_every_word_of_the_server_has_a_text():
    for prefix, words in {
        "calibration": ("valid", "untrusted", "does_not_hold", "expired", "undecided", "changed", "none"),
        "home": (), "part": ("gear", "turned", "cad"),
        "kind": ("inspection", "calibration", "verification"), "role": ("operator", "engineer"),
        "verdict": ("conforms", "does_not_conform", "undecided", "valid", "untrusted", "holds", "does_not_hold"),
        "recipes.kind": ("stand", "artefact", "part"), "step.state": ("waiting", "running", "done", "failed"),
    }.items():  # fmt: skip
        assert not {word for word in words if f"{prefix}.{word}" not in TEXTS}


def test_nothing_is_parsed_as_html():
    bad = re.compile(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|createContextualFragment|DOMParser|\beval\(|"
        r"new Function"
    )
    assert not {p.name: bad.findall(text) for p, text in SCRIPTS.items() if bad.search(text)}


def test_nothing_is_inline_or_from_elsewhere():
    html = (STATIC / "index.html").read_text(encoding="utf-8")
    assert "<style" not in html and not re.search(r"\sstyle=|\son\w+=", html)
    assert not re.search(r"<script(?![^>]*\ssrc=)", html)
    everything = html + SOURCE + "".join(p.read_text(encoding="utf-8") for p in STATIC.rglob("*.css"))
    assert set(re.findall(r"(?:https?:)?//[a-z][\w.-]+\.\w+[^\s\"']*", everything)) <= {"http://www.w3.org/2000/svg"}


def test_preloaded_modules_exist():
    html = (STATIC / "index.html").read_text(encoding="utf-8")
    names = [n for n in re.findall(r'href="([^"]+)"', html) if not n.startswith("api/")]
    assert names and not [name for name in names if not (STATIC / name).is_file()]


def test_modules_are_short():
    assert not {p.name: n for p, text in SCRIPTS.items() if (n := text.count("\n")) > 400}
