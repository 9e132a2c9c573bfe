"""examples/model_from_matrices.py, with a robot whose matrices are known."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("scipy")
SCRIPT = Path(__file__).parents[2] / "examples" / "model_from_matrices.py"

# A pendulum: a hinge about y, a body of 2 kg 0.3 m below it, with an inertia of its own.
PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <link name="arm">
    <inertial>
      <origin xyz="0 0 -0.3"/>
      <mass value="2.0"/>
      <inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="shoulder" type="continuous">
    <parent link="base"/>
    <child link="arm"/>
    <axis xyz="0 1 0"/>
    <dynamics damping="0.5"/>
  </joint>
</robot>
"""


def test_a_robot_has_a_motor_at_each_joint(tmp_path):
    robot, out = tmp_path / "pendulum.urdf", tmp_path / "sim.json"
    robot.write_text(PENDULUM)
    command = [sys.executable, SCRIPT, "--urdf", robot, "--rate", "200", "--kind", "position", "--out", out]
    subprocess.run(command, check=True)
    model = json.loads(out.read_text())
    assert (model["inputs"], model["outputs"]) == (["shoulder"], ["shoulder"])
    assert [port["name"] for port in model["ports"]] == ["shoulder"]
    inertia, damper, spring = 0.04 + 2.0 * 0.3**2, 0.5, 2.0 * 9.81 * 0.3
    expected = [[0.0, 1.0], [-spring / inertia, -damper / inertia]]
    np.testing.assert_allclose(model["continuous"]["A"], expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(model["continuous"]["B"], [[0.0], [1 / inertia]], rtol=1e-6, atol=1e-9)


def test_one_source_is_needed(tmp_path):
    command = [sys.executable, SCRIPT, "--rate", "200", "--kind", "position", "--out", tmp_path / "sim.json"]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 2 and "give one of" in ended.stderr
