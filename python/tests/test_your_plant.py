"""The examples of the chapter "Your plant", and the cases that the experiments write."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_friction_of_a_motor_on_a_bench_is_named(tmp_path):
    subprocess.run([sys.executable, ROOT / "examples/motor/record.py", tmp_path], check=True)
    records = {path.stem: np.loadtxt(path, delimiter=",", skiprows=1) for path in tmp_path.glob("*.csv")}
    assert set(records) == {"quiet", "low", "high", "check"}
    # Without a torque, there is only noise.
    assert not records["quiet"][:, 0].any() and 0.1 < records["quiet"][:, 1].std() < 0.2
    program = os.environ.get("PLID_PROGRAM")
    if program is None:
        pytest.skip("PLID_PROGRAM names no program")
    out = tmp_path / "gap"
    subprocess.run([program, "gap", "diagnose", tmp_path / "case.toml", "--out", out, "--quiet"], check=True)
    (found,) = json.loads((out / "diagnosis.json").read_text())["effects"]
    assert (found["effect"], found["location"]) == ("coulomb-friction", "input:torque")
    lowest, highest = found["parameters"]["F"]["ci95"]
    assert lowest < 0.02 < highest


def test_a_case_loses_its_simulation(tmp_path):
    case, out = tmp_path / "case.toml", tmp_path / "linear" / "case.toml"
    record = '[[record]]\nfile = "{}.csv"\n\n'
    head = 'sim = "model.json"\ninputs = ["u"]\n\n'
    case.write_text(head + record.format("a") + '[[record]]\nfile = "b.csv"\nuse = "sim"\n\n' + record.format("c"))
    subprocess.run([sys.executable, ROOT / "experiments/gap/best_linear.py", case, out], check=True)
    assert out.read_text() == 'inputs = ["u"]\n\n' + record.format("a") + record.format("c")
