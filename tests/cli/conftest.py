"""A small virtual stand's files, made once by the commands themselves."""

from pathlib import Path

import pytest

from command import run

SMALL = "profiles = 11000                       # 2.75 turns"


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recipes, scans k1.csv and k1.h5, their truth and a calibration."""
    folder = tmp_path_factory.mktemp("bench")
    assert run("init", folder).returncode == 0
    stand = folder / "stand.toml"
    text = stand.read_text(encoding="utf-8").replace(SMALL, "profiles = 2750").replace("= 200.0", "= 50.0")
    stand.write_text(text.replace("points = 640", "points = 320"), encoding="utf-8")
    truth = ("--truth", folder / "truth.json")
    assert run("simulate", stand, "--artefact", folder / "shaft.toml", "-o", folder / "k1.csv", *truth).returncode == 0
    imported = run("import", folder / "k1.csv", "--stand", stand, "-o", folder / "k1.h5")
    assert imported.returncode == 0, imported.stderr
    done = run(
        "calibrate", folder / "k1.h5", "--artefact", folder / "shaft.toml", "-o", folder / "calibration.json", *truth,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder
