"""Each limit is recorded two-sided or one-sided, and read so; what 0.1 wrote keeps its meaning."""

import json

import jsonschema
import numpy as np
import pytest

from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.frames import Pose
from truestand.core.inspection import Characteristic, Inspection
from truestand.core.stand import Stand
from truestand.files.records.inspection_record import characteristics_from, inspection_record, limits_of, with_limits
from truestand.files.records.schemas import schema_text

STILL = Pose(np.eye(3), np.zeros(3))


def record_of(kind, *lines):
    calibration = Calibration("stand", STILL, STILL, Stand(), "index", "home")
    found = inspection_record(Inspection(kind, "part", lines), calibration, (ScanSummary("", 1, 1, 1.0, 1.0),), "", "")
    jsonschema.validate(found, json.loads(schema_text("inspection")))
    return found


BOTH = [(None, 0.012), (-0.012, 0.012), (-0.012, 0.03), (-0.03, None), (0.0, None), None]


@pytest.mark.parametrize("limits", BOTH)
@pytest.mark.parametrize(("kind", "name"), [("gear", "C_alpha"), ("gear", "F_alpha"), ("turned", "runout")])
def test_a_limit_is_recorded_as_it_is_whatever_it_is_a_limit_of(kind, name, limits):
    record = record_of(kind, Characteristic(name, 0.001, 0.0005, limits=limits))
    (line,) = record["characteristics"]
    assert line["limits_um"] == (None if limits is None else [v if v is None else 1000.0 * v for v in limits])
    (read,) = characteristics_from(record)
    assert read.limits == limits


OLD = [("gear", "f_Halpha", (-9.5, 9.5)), ("gear", "C_alpha", (-9.5, 9.5)), ("gear", "C_beta", (-9.5, 9.5)),
       ("gear", "F_p", (None, 9.5)), ("gear", "F_alpha", (None, 9.5)), ("turned", "roundness", (None, 9.5)),
       ("cad", "profile", (None, 9.5))]  # fmt: skip


@pytest.mark.parametrize(("kind", "name", "limits"), OLD)
def test_one_limit_alone_means_what_it_meant_in_0_1(kind, name, limits):
    line = {"name": name, "value_um": 1.0, "U_um": 0.5, "limit_um": 9.5}
    record = {"part": {"kind": kind}, "characteristics": [line]}
    assert limits_of(line, record) == limits
    (shown,) = with_limits(record)["characteristics"]
    assert shown == line | {"limits_um": limits}


def test_no_limit_stays_none():
    assert limits_of({"name": "F_r", "limit_um": None}, {}) is None
    assert limits_of({"name": "d", "value_mm": 1.0, "limits_mm": None}, {}) is None
    assert with_limits({"verdict": "undecided"}) == {"verdict": "undecided"}
