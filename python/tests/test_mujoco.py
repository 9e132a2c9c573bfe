"""A MuJoCo model as a simulator."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from plid import gap

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")

RATE = 100.0
XML = """
<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" type="hinge" axis="0 1 0" damping="{damping}" frictionloss="{friction}" stiffness="4"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>
"""


def arm(damping=0.3, friction=0.0, **options):
    return gap.from_mujoco(XML.format(damping=damping, friction=friction), rate=RATE, **options)


def records(truth):
    found = []
    for k, level in enumerate((0.5, 1.0, 1.0, 0.0)):
        random = np.random.default_rng(k)
        u = level * np.repeat(random.standard_normal((100, 1)), 10, axis=0)
        y = truth.run(np.zeros(len(truth.parameters)), u)
        found.append((u, y - 0.0 + 2e-4 * random.standard_normal(y.shape)))
    return found


def test_the_model_is_described():
    simulator = arm(parameters=["joint.hinge.damping"])
    assert (simulator.inputs, simulator.outputs, simulator.steps_per_sample) == (["torque"], ["angle"], 2)
    assert simulator.ports == [gap.Port("hinge", "torque", "N m", "rad")]
    assert simulator.parameters["joint.hinge.damping"] == gap.Parameter(0.3, lower=0.0)
    assert '"kind": "position"' in simulator.description()


def test_the_checker_passes_it():
    findings = gap.check(arm(parameters=["joint.hinge.damping", "actuator.torque.gain"]), size=0.3)
    # Gravity pulls it down at once.
    assert [finding.what for finding in findings if not finding.holds] == ["rests"]
    assert {"repeats", "steps", "motion at hinge", "force at hinge", "states"} <= {one.what for one in findings}


def test_it_moves_as_mujoco_does():
    simulator = arm()
    model = mujoco.MjModel.from_xml_string(XML.format(damping=0.3, friction=0.0))
    data = mujoco.MjData(model)
    u = np.random.default_rng(3).standard_normal((50, 1))
    expected = []
    for torque in u[:, 0]:
        data.ctrl[0] = torque
        expected.append(data.qpos[0])
        mujoco.mj_step(model, data, 2)
    assert_allclose(simulator.run(np.zeros(0), u)[:, 0], expected, atol=1e-12)
    # A force at the port is a torque of the same size.
    simulator.start(np.zeros(0))
    pushed = [simulator.step(np.zeros(1), torque)[1][0, 0] for torque in u for _ in range(2)]
    assert_allclose(pushed[1:-1:2], expected[1:], atol=1e-12)


def test_a_parameter_changes_the_model():
    simulator, other = arm(parameters={"joint.hinge.damping": None}), arm(damping=0.6)
    u = np.ones((30, 1))
    assert_allclose(simulator.run(np.array([0.6]), u), other.run(np.zeros(0), u), atol=1e-12)


def test_the_inertia_follows_the_mass():
    # Twice the mass, the spring and the damping: the same motion under twice the torque.
    names = ["body.link.mass", "joint.hinge.damping", "joint.hinge.stiffness", "actuator.torque.gain"]
    simulator = arm(parameters=names)
    given = np.array([simulator.parameters[name].value for name in names])
    assert_allclose(given, [1.0, 0.3, 4.0, 1.0])
    u = np.ones((30, 1))
    assert_allclose(simulator.run(2.0 * given, u), simulator.run(given, u), rtol=1e-9)
    assert np.abs(simulator.run(given * [2.0, 1.0, 1.0, 1.0], u) - simulator.run(given, u)).max() > 1e-3


def test_any_number_of_the_model_may_be_named():
    simulator = arm(parameters={"body_inertia:link:1": 0.02, "geom_size:rod:0": None})
    assert simulator.parameters["geom_size:rod:0"].value == 0.02
    light = simulator.run(np.array([0.01, 0.02]), np.ones((30, 1)))
    assert np.abs(light - simulator.run(np.array([0.5, 0.02]), np.ones((30, 1)))).max() > 1e-3


def test_a_script_that_serves_it_is_a_command(tmp_path):
    program = os.environ.get("PLID_PROGRAM")
    if program is None:
        pytest.skip("PLID_PROGRAM names no program")
    (tmp_path / "arm.xml").write_text(XML.format(damping=0.3, friction=0.0))
    (tmp_path / "serve.py").write_text(
        "from plid import gap\n"
        "gap.serve(gap.from_mujoco('arm.xml', rate=100.0, parameters=['joint.hinge.damping']))\n"
    )
    checked = subprocess.run(
        [program, "gap", "check-simulator", "--", sys.executable, "serve.py"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "joint.hinge.damping" in checked.stdout, checked.stdout


def test_friction_of_the_joint_is_named():
    diagnosis = gap.diagnose(records(arm(friction=0.15)), simulator=arm(), rate=RATE, progress=False)
    assert diagnosis.effects and diagnosis.effects[0].effect == "coulomb-friction", diagnosis.sentence


def test_what_the_model_lacks_is_named():
    with pytest.raises(ValueError, match="no joint 'elbow'"):
        arm(joints=["elbow"])
    with pytest.raises(ValueError, match="'dof_dampin' is not an attribute"):
        arm(parameters=["dof_dampin:hinge"])
    with pytest.raises(ValueError, match="known are joint.NAME"):
        arm(parameters=["joint.hinge.dampin"])
    with pytest.raises(ValueError, match="3 columns, so there is no column 3"):
        arm(parameters=["body_inertia:link:3"])
    with pytest.raises(ValueError, match="whole number of steps"):
        gap.from_mujoco(XML.format(damping=0.3, friction=0), rate=150.0)
