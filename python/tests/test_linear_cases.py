"""Cases of MuJoCo models with a linearised simulation: rates, sensors and ports."""

import json
import pathlib
import sys
import tomllib

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "experiments" / "mujoco"))
linear = pytest.importorskip("linear")


def drawn(out, plant, kind, with_ports, **seen):
    """The case, the simulation, and a record with its columns."""
    records = linear.DRAWN._replace(levels=[1.0, 1.0], **seen)
    linear.draw(out, "one", plant, kind, with_ports, 7, records)
    folder = out / "cases" / "one"
    case = tomllib.loads((folder / "case.toml").read_text())
    return case, json.loads((folder / "model.json").read_text()), np.loadtxt(
        folder / "r0.csv", delimiter=",", skiprows=1
    )


@pytest.mark.parametrize("rate", linear.RATES)
def test_a_case_has_its_rate_and_six_seconds(tmp_path, rate):
    case, model, record = drawn(tmp_path, "servo", "none", False, rate=rate)
    assert case["sample_rate_hz"] == model["sample_rate_hz"] == rate
    assert len(record) == 6 * rate
    # The plant is the same at each rate.
    poles = np.sort(np.linalg.eigvals(model["A"]) ** rate)
    given = linear.linearised(linear.PLANTS["servo"])[0]
    np.testing.assert_allclose(poles, np.sort(np.linalg.eigvals(given["A"]) ** given["sample_rate_hz"]), rtol=1e-6)


@pytest.mark.parametrize("sensor", linear.SENSORS)
def test_encoders_measure_positions_or_velocities(tmp_path, sensor):
    case, model, record = drawn(tmp_path, "slider", "none", True, rate=1000.0, sensor=sensor)
    (name,) = case["outputs"]
    assert (name, model["output_kinds"]) == (f"{sensor[0]}_rail", {name: sensor})
    # An encoder counts whole steps; records have nine digits.
    steps = np.diff(np.unique(record[:, 1]))
    np.testing.assert_allclose(steps / steps.min(), np.round(steps / steps.min()), rtol=1e-3)


def test_half_of_the_cases_declare_ports(tmp_path):
    for with_ports in (True, False):
        case, model, _ = drawn(tmp_path / str(with_ports), "arm", "none", with_ports)
        assert [port["name"] for port in model.get("ports", [])] == (["drive", "elastic"] if with_ports else [])


def test_rates_and_sensors_are_drawn():
    records = [linear.sampled(kind, 5000 + at) for at, (_, kind) in enumerate(linear.KINDS)]
    assert {one.rate for one in records} == set(linear.RATES)
    assert {one.sensor for one in records} == set(linear.SENSORS)
    # The controller of a loop needs the position.
    assert linear.sampled("closed loop", 5) == linear.sampled("closed loop", 5)
    assert {linear.sampled("closed loop", seed).sensor for seed in range(20)} == {"position"}
