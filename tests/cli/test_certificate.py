"""``truestand certificate`` from outside: files, exit codes, and that nothing is written where there can be none."""

import json
import os
from pathlib import Path

import pytest

from command import run

SCHEMAS = Path(os.environ.get("TRUESTAND_DCC_SCHEMAS", Path(__file__).parents[2] / "../shared/schemas/dcc"))


def test_a_draft_is_written_and_says_what_is_missing(bench, tmp_path):
    done = run("certificate", bench / "calibration.json", "-o", tmp_path / "dcc.xml")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "dcc.xml").read_bytes().startswith(b"<?xml")
    assert "a draft: nobody stated [laboratory] name, city, country" in done.stderr
    printed = json.loads(
        run("certificate", bench / "calibration.json", "-o", tmp_path / "d.xml", "--json", "-q").stdout
    )
    assert printed["draft"] and not printed["validated"] and "[stand] serial (laboratory.toml)" in printed["not_stated"]
    assert (tmp_path / "d.xml").read_bytes() == (tmp_path / "dcc.xml").read_bytes()


@pytest.mark.skipif(not SCHEMAS.is_dir(), reason="no schemas of the DCC in the folder shared beside the project")
def test_the_certificate_is_validated_by_the_schemas(bench, tmp_path):
    out = tmp_path / "dcc.xml"
    done = run("certificate", bench / "calibration.json", "-o", out, "--schema-dir", SCHEMAS, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["validated"]
    for file in SCHEMAS.iterdir():
        text = file.read_text(encoding="utf-8")
        (tmp_path / file.name).write_text(text.replace(r"3\.3\.0", r"3\.2\.0"), encoding="utf-8")
    out.unlink()
    done = run("certificate", bench / "calibration.json", "-o", out, "--schema-dir", tmp_path)
    assert done.returncode == 2
    assert "not valid by this schema: line 2" in done.stderr
    assert not out.exists()


def test_an_untrusted_calibration_gets_no_certificate(bench, tmp_path):
    record = json.loads((bench / "calibration.json").read_text(encoding="utf-8"))
    record |= {"status": "untrusted", "reasons": ["the shaft was dirty"]}
    (tmp_path / "c.json").write_text(json.dumps(record), encoding="utf-8")
    done = run("certificate", tmp_path / "c.json", "-o", tmp_path / "dcc.xml")
    assert done.returncode == 3
    assert "no certificate: the shaft was dirty" in done.stderr
    assert not (tmp_path / "dcc.xml").exists()


def test_missing_keys_of_a_laboratory_are_named(bench, tmp_path):
    (tmp_path / "laboratory.toml").write_text('[laboratory]\nname = "M"\n', encoding="utf-8")
    done = run(
        "certificate",
        bench / "calibration.json",
        "--laboratory",
        tmp_path / "laboratory.toml",
        "-o",
        tmp_path / "x.xml",
    )
    assert done.returncode == 2
    assert "lacks [laboratory] city, country (laboratory.toml); [[responsible]] name" in done.stderr
    assert not (tmp_path / "x.xml").exists()


@pytest.mark.parametrize("content", ["", "{}", "[]", "not json"])
def test_a_file_that_is_no_calibration_is_refused(tmp_path, content):
    (tmp_path / "c.json").write_text(content, encoding="utf-8")
    done = run("certificate", tmp_path / "c.json", "-o", tmp_path / "dcc.xml")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1
