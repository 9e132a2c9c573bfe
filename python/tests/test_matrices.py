"""examples/model_from_matrices.py, with a robot, a table and a chain of masses whose matrices are known."""

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


def made(path, kind, *source):
    """Calls the script. Returns how it ended, and the model if it made one."""
    out = path / "sim.json"
    command = [sys.executable, SCRIPT, *source, "--rate", "200", "--kind", kind, "--out", out]
    ended = subprocess.run(command, capture_output=True, text=True)
    return ended, json.loads(out.read_text()) if ended.returncode == 0 else None


def test_a_robot_has_a_motor_at_each_joint(tmp_path):
    robot = tmp_path / "pendulum.urdf"
    robot.write_text(PENDULUM)
    ended, model = made(tmp_path, "position", "--urdf", robot)
    assert ended.returncode == 0, ended.stderr
    # A file of records cannot have two columns of one name.
    assert (model["inputs"], model["outputs"]) == (["shoulder_command"], ["shoulder"])
    assert [port["name"] for port in model["ports"]] == ["shoulder"]
    inertia, damper, spring = 0.04 + 2.0 * 0.3**2, 0.5, 2.0 * 9.81 * 0.3
    expected = [[0.0, 1.0], [-spring / inertia, -damper / inertia]]
    np.testing.assert_allclose(model["continuous"]["A"], expected, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(model["continuous"]["B"], [[0.0], [1 / inertia]], rtol=1e-6, atol=1e-9)


# A table on a cart, each on a rail along x.
TABLE = """<mujoco><worldbody>
  <body><joint name="rail" type="slide" axis="1 0 0" damping="4"/><geom type="sphere" size=".1" mass="3"/>
    <body><joint name="table" type="slide" axis="1 0 0" stiffness="200"/><geom type="sphere" size=".1" mass="2"/></body>
  </body></worldbody>
  <actuator><motor name="force" joint="rail" gear="5"/></actuator></mujoco>
"""


def test_ports_of_a_mujoco_model_are_columns_of_the_inverse_mass(tmp_path):
    source = tmp_path / "table.xml"
    source.write_text(TABLE)
    ended, model = made(tmp_path, "velocity", "--mujoco", source)
    assert ended.returncode == 0, ended.stderr
    assert (model["inputs"], model["outputs"]) == (["force"], ["rail", "table"])
    inverse = np.linalg.inv([[3.0 + 2.0, 2.0], [2.0, 2.0]])
    np.testing.assert_allclose(np.array(model["continuous"]["B"])[2:, 0], 5 * inverse[:, 0], rtol=1e-6)
    for k, port in enumerate(model["ports"]):
        assert port["name"] == ["rail", "table"][k]
        np.testing.assert_allclose(port["force"], [0, 0, *inverse[:, k]], rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(port["displacement"], np.eye(4)[k])
        np.testing.assert_array_equal(port["velocity"], np.eye(4)[2 + k])


def chain(path, **arguments):
    """The model of three masses between springs, the port a joint between the last two."""
    matrices = path / "chain.npz"
    stiffness = 100.0 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    mass = np.diag([1.0, 2.0, 3.0])
    port = np.array([[0.0], [-1], [1]])
    np.savez(
        matrices, M=mass, C=0.001 * stiffness, K=stiffness, inputs=np.eye(3)[:, :1], outputs=np.eye(3), ports=port
    )
    words = [word for key, value in arguments.items() for word in (f"--{key}", str(value))]
    return *made(path, "position", matrices, *words), np.linalg.eigvals(np.linalg.solve(mass, stiffness))


def test_a_joint_between_two_masses_pushes_both(tmp_path):
    _, model, _ = chain(tmp_path)
    np.testing.assert_allclose(model["ports"][0]["force"], [0, 0, 0, 0, -1 / 2, 1 / 3])


def test_the_lowest_modes_are_kept(tmp_path):
    _, whole, squares = chain(tmp_path)
    _, model, _ = chain(tmp_path, modes=2)
    poles = np.linalg.eigvals(model["continuous"]["A"])
    np.testing.assert_allclose(np.sort(np.abs(poles))[::2], np.sqrt(np.sort(squares)[:2]), rtol=1e-9)

    def compliance(model, hz):
        """The stretch of the joint under a force of one at the joint."""
        a, port = np.array(model["continuous"]["A"]), model["ports"][0]
        at = np.linalg.solve(2j * np.pi * hz * np.eye(len(a)) - a, port["force"])
        return port["displacement"] @ at

    slowest = np.sqrt(squares.min()) / (2 * np.pi)
    assert abs(compliance(model, slowest) / compliance(whole, slowest) - 1) < 0.05
    ended, _, _ = chain(tmp_path, modes=4)
    assert ended.returncode == 1 and "the matrices have 3 modes" in ended.stderr


def test_one_source_is_needed(tmp_path):
    ended, _ = made(tmp_path, "position")
    assert ended.returncode == 2 and "give one of" in ended.stderr
