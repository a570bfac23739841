"""The way from the sensor to the disk at full rate, as the bench measures it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[2] / "bench" / "stream.py"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes can't be held on one core here")
def test_ten_thousand_profiles_a_second_reach_the_disk_on_one_core():
    done = subprocess.run(
        [sys.executable, str(BENCH), "--check", "--packet", "1500", "9000"], capture_output=True, text=True, check=False
    )
    if done.returncode == 2:
        pytest.skip(f"this machine is too busy to send at full rate: {done.stdout}")
    assert done.returncode == 0, done.stdout + done.stderr
