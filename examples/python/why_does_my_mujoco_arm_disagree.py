"""Find why a MuJoCo arm disagrees with measured records.

    pip install "./python[mujoco]" matplotlib
    python examples/python/why_does_my_mujoco_arm_disagree.py out/arm

A motor drives a link through an elastic joint. The bearing of the real motor has friction, which the model
lacks. The cells can be run in a notebook unchanged.
"""

# %% The model, which you would load from a file.
import sys
from pathlib import Path

import numpy as np

from plid import gap

try:
    import mujoco
except ImportError:
    print("SKIPPED: mujoco is not installed: pip install mujoco")
    sys.exit()

RATE = 200.0  # samples per second
ARM = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast"/>
  <worldbody>
    <body name="motor">
      <joint name="drive" type="hinge" axis="0 1 0" damping="0.2" armature="0.02" frictionloss="{friction}"/>
      <geom type="sphere" size="0.03" mass="0.3"/>
      <body name="link">
        <joint name="elastic" type="hinge" axis="0 1 0" stiffness="25" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.02" mass="0.6"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="drive"/></actuator>
  <sensor><jointpos name="drive" joint="drive"/><jointpos name="elastic" joint="elastic"/></sensor>
</mujoco>
"""


# %% Measure. Here the real arm is a finer model, whose bearing has a friction of 0.1 N m.
def record(seed: int, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque in N m, and the angles of both joints in rad."""
    random = np.random.default_rng(seed)
    u = level * np.repeat(random.standard_normal((50, 1)), 16, axis=0)
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.00025, friction=0.1))
    data = mujoco.MjData(model)
    y = np.empty((len(u), 2))
    for k, torque in enumerate(u):
        y[k] = data.qpos
        data.ctrl[:] = torque
        mujoco.mj_step(model, data, 20)
    return u, y + 1e-3 * random.standard_normal(y.shape)


records = [record(1, 1.0), record(2, 2.0), record(3, 2.0), record(4, 0.0)]

# %% Ask why they disagree. It may be a number of the model, or something that the model lacks.
# ANCHOR: diagnose
simulator = gap.from_mujoco(
    ARM.format(step=0.0005, friction=0),
    rate=RATE,
    parameters=["joint.drive.damping", "joint.elastic.stiffness", "body.link.mass"],
)
diagnosis = gap.diagnose(records, simulator=simulator, rate=RATE)
print(diagnosis)
# ANCHOR_END: diagnose

# %% Predict a record that the diagnosis has not seen.
u, y = record(5, 2.0)
given = np.array([parameter.value for parameter in simulator.parameters.values()])
simulated = {"model as given": simulator.run(given, u), "with what was found": diagnosis.predict(u)}
for name, of in simulated.items():
    print(f"gap on a new record, {name}: {100 * np.sqrt(np.mean((of - y) ** 2) / np.mean(y**2)):.1f} %")

# %% Plot the result.
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "arm")
print("report:", diagnosis.report(folder))
try:
    import matplotlib.pyplot as plt
except ImportError:
    print("SKIPPED: matplotlib is not installed, so there is no picture: pip install matplotlib")
    sys.exit()
time = np.arange(len(u)) / RATE
figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
axis.plot(time, np.degrees(y[:, 0]), color="black", linewidth=2.5, alpha=0.35, label="measured")
for (name, of), style in zip(simulated.items(), ("--", "-"), strict=True):
    axis.plot(time, np.degrees(of[:, 0]), style, linewidth=1.1, label=name)
axis.set(xlabel="time in s", ylabel="angle of the drive in °", xlim=(0, time[-1]))
figure.legend(frameon=False, ncols=3, loc="outside upper center")
figure.savefig(folder / "arm.svg", metadata={"Date": None})
print("picture:", folder / "arm.svg")
