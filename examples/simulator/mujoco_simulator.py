"""A MuJoCo model as a simulator for plid, without a loop of your own.

    python3 mujoco_simulator.py MODEL.xml --rate 200 --port hinge --parameter joint.hinge.damping

The inputs are the model's actuators, the outputs its sensors, the ports the joints that are named (hinge or slide), and
the parameters numbers of the model:

    joint.NAME.damping | frictionloss | stiffness | armature
    body.NAME.mass          (its inertia follows)
    actuator.NAME.gain      (factor on the gain and, of a position actuator, on the stiffness)

Needs `pip install mujoco`.
"""

import argparse

import mujoco
import numpy as np

from plid_simulator import serve

KINDS = {
    mujoco.mjtSensor.mjSENS_JOINTPOS: "position",
    mujoco.mjtSensor.mjSENS_JOINTVEL: "velocity",
    mujoco.mjtSensor.mjSENS_FRAMEPOS: "position",
    mujoco.mjtSensor.mjSENS_ACCELEROMETER: "acceleration",
    mujoco.mjtSensor.mjSENS_VELOCIMETER: "velocity",
    mujoco.mjtSensor.mjSENS_ACTUATORFRC: "force",
    mujoco.mjtSensor.mjSENS_JOINTACTFRC: "force",
}


class MujocoSimulator:
    """Steps a model of MuJoCo; `rate` must divide one over its time step."""

    def __init__(self, model, rate, ports=(), parameters=(), name="mujoco"):
        self.model, self.data = model, mujoco.MjData(model)
        steps = 1.0 / (rate * model.opt.timestep)
        if abs(steps - round(steps)) > 1e-6:
            raise SystemExit(f"a rate of {rate} Hz is no multiple of the time step of {model.opt.timestep} s")
        # Views of the arrays: asking for them in each step would take longer than the step.
        data = self.data
        self.ctrl, self.applied, self.sensors = data.ctrl, data.qfrc_applied, data.sensordata
        self.qpos, self.qvel = data.qpos, data.qvel
        self.joints = [_number(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in ports]
        self.ports = [(int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])) for j in self.joints]
        self.numbers = [_Number(model, path) for path in parameters]
        self.description = {
            "name": name,
            "rate_hz": rate,
            "steps_per_sample": round(steps),
            "inputs": [{"name": model.actuator(k).name} for k in range(model.nu)],
            "outputs": _outputs(model),
            "ports": [self._port(joint, name) for joint, name in zip(self.joints, ports)],
            "parameters": [
                {"name": path, "value": float(number.value), "lower": 0.0}
                for path, number in zip(parameters, self.numbers)
            ],
        }

    def _port(self, joint, name):
        """A joint, with the actuator that drives it."""
        model = self.model
        drives = [
            model.actuator(k).name
            for k in range(model.nu)
            if model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_trnid[k, 0] == joint
        ]
        hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        units = {"force_unit": "N m", "displacement_unit": "rad"} if hinge else {"force_unit": "N", "displacement_unit": "m"}
        return {"name": name, **units, **({"input": drives[0]} if drives else {})}

    def start(self, parameters):
        for number, value in zip(self.numbers, parameters):
            number.set(value)
        mujoco.mj_resetData(self.model, self.data)
        return self._motions()

    def step(self, u, forces):
        self.ctrl[:] = u
        for (_, dof), force in zip(self.ports, forces):
            self.applied[dof] = force
        # The sensors show the state before the step, with these inputs and forces.
        mujoco.mj_step(self.model, self.data)
        return self.sensors.tolist(), self._motions()

    def _motions(self):
        return [(self.qpos[at], self.qvel[dof]) for at, dof in self.ports]


class _Number:
    """A number of a model that may be wrong."""

    def __init__(self, model, path):
        kind, name, field = path.split(".")
        self.model = model
        if kind == "joint":
            joint = _number(model, mujoco.mjtObj.mjOBJ_JOINT, name)
            of_dof = {"damping": model.dof_damping, "frictionloss": model.dof_frictionloss, "armature": model.dof_armature}
            array, at = (model.jnt_stiffness, joint) if field == "stiffness" else (of_dof[field], model.jnt_dofadr[joint])
            # Newer versions of MuJoCo keep the coefficients of a polynomial.
            self.value = np.ravel(array[at])[0]
            self.put = lambda value: array.__setitem__((at, *(0,) * (array.ndim - 1)), value)
        elif (kind, field) == ("body", "mass"):
            body = _number(model, mujoco.mjtObj.mjOBJ_BODY, name)
            self.value = float(model.body_mass[body])
            inertia = model.body_inertia[body].copy()

            def put(value, whole=self.value):
                model.body_mass[body] = value
                model.body_inertia[body] = inertia * value / whole
                # Constants that follow from masses.
                mujoco.mj_setConst(model, mujoco.MjData(model))

            self.put = put
        elif (kind, field) == ("actuator", "gain"):
            actuator = _number(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
            gain, bias = model.actuator_gainprm[actuator].copy(), model.actuator_biasprm[actuator].copy()
            self.value = 1.0

            def put(value):
                model.actuator_gainprm[actuator] = gain * value
                model.actuator_biasprm[actuator] = bias * value

            self.put = put
        else:
            raise SystemExit(f"{path}: there is no such number; see --help")
        self.now = self.value

    def set(self, value):
        if value != self.now:
            self.put(value)
            self.now = value


def _outputs(model):
    outputs = []
    for k in range(model.nsensor):
        name, parts = model.sensor(k).name, int(model.sensor_dim[k])
        kind = KINDS.get(mujoco.mjtSensor(model.sensor_type[k]), "other")
        names = [name] if parts == 1 else [f"{name}{axis}" for axis in range(parts)]
        outputs.extend({"name": each, "kind": kind} for each in names)
    return outputs


def _number(model, kind, name):
    found = mujoco.mj_name2id(model, kind, name)
    if found < 0:
        raise SystemExit(f"the model has no {kind.name[6:].lower()} {name!r}")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--rate", type=float, required=True, help="samples per second")
    parser.add_argument("--port", action="append", default=[], help="a joint that takes a force")
    parser.add_argument("--parameter", action="append", default=[], help="a number that may be wrong")
    given = parser.parse_args()
    model = mujoco.MjModel.from_xml_path(given.model)
    serve(MujocoSimulator(model, given.rate, given.port, given.parameter, name=given.model))


if __name__ == "__main__":
    main()
