"""Drawn cases of MuJoCo models, whose simulation is a linearised model.json, diagnosed by the program."""

import os
import pathlib
import sys

import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")
PROGRAM = os.environ.get("PLID_PROGRAM")
if not PROGRAM:
    pytest.skip("PLID_PROGRAM is not set", allow_module_level=True)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "experiments" / "mujoco"))
linear = pytest.importorskip("linear")

# Each plant and each kind of cause: the command, the sensor, a number, a force, a loop, nothing.
CASES = [
    ("slider", "none"),
    ("motor", "friction"),
    ("servo", "lag"),
    ("light servo", "lag"),
    ("pendulum", "sine"),
    ("chain", "mass"),
    ("arm", "stiffening"),
    ("slider", "closed loop"),
    ("slider", "sensor delay"),
    ("slider", "damping"),
]


def test_causes_of_drawn_machines_are_named(tmp_path):
    for at, (plant, kind) in enumerate(CASES):
        records = linear.DRAWN._replace(rate=linear.RATES[at % 3])
        linear.draw(tmp_path, f"{at + 1:03}", plant, kind, at % 2 == 1, 9000 + at, records)
    rows = linear.score(tmp_path, PROGRAM)
    caused = [row for row in rows if row[4]["effects"]]
    nothing = [row for row in rows if not row[4]["effects"]]
    assert sum(row[0] for row in caused) >= 0.8 * len(caused), "main cause"
    assert sum(row[1] for row in caused) >= 0.75 * len(caused), "place"
    assert all(row[0] for row in nothing), "nothing is missing"
    assert not any(row[2] for row in rows), "confident and wrong"
    assert all(row[3] for row in rows), "the gap on a new record"
