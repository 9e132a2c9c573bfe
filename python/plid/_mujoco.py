"""Simulators from MuJoCo models."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plid._arrays import Array
from plid._simulator import Parameter, Port, Simulator

# Kinds of MuJoCo's sensors by what they measure, for the names of outputs.
KINDS = {
    "JOINTPOS": "position",
    "ACTUATORPOS": "position",
    "TENDONPOS": "position",
    "FRAMEPOS": "position",
    "JOINTVEL": "velocity",
    "ACTUATORVEL": "velocity",
    "TENDONVEL": "velocity",
    "VELOCIMETER": "velocity",
    "GYRO": "velocity",
    "FRAMELINVEL": "velocity",
    "FRAMEANGVEL": "velocity",
    "ACCELEROMETER": "acceleration",
    "FRAMELINACC": "acceleration",
    "FRAMEANGACC": "acceleration",
    "FORCE": "force",
    "TORQUE": "force",
    "ACTUATORFRC": "force",
    "JOINTACTFRC": "force",
}


def from_mujoco(
    model: Any,
    *,
    rate: float,
    actuators: Sequence[str] | None = None,
    sensors: Sequence[str] | None = None,
    joints: Sequence[str] | None = None,
    parameters: Mapping[str, float | Parameter | None] | None = None,
) -> Simulator:
    """Make a simulator of a MuJoCo model.

    Parameters
    ----------
    model : path, str or mujoco.MjModel
        A file, the text of an XML model, or a model. It begins at its initial position `qpos0`.
    rate : float
        Samples per second, in Hz: a whole number of the model's time steps must make a sample.
    actuators : sequence of str, optional
        The actuators that are inputs; by default all. The others are held at zero.
    sensors : sequence of str, optional
        The sensors that are outputs; by default all. A sensor of several numbers gives "name.0", "name.1", ...
    joints : sequence of str, optional
        The hinges and slides that are ports; by default all.
    parameters : dict, optional
        Numbers of the model that may be wrong, named "attribute:element", as in "dof_damping:hinge",
        "jnt_stiffness:hinge", "body_mass:link" and "actuator_gainprm:motor". The value None, or a `Parameter` whose
        value is NaN, takes the model's own number. An attribute with several columns takes "body_inertia:link:0".

    Returns
    -------
    Simulator
        One that takes a step for each time step of the model.

    Examples
    --------
    >>> simulator = plid.gap.from_mujoco("arm.xml", rate=200.0, parameters={"dof_damping:hinge": None})
    """
    return _Arm(loaded(model), rate, actuators, sensors, joints, parameters or {}).simulator


def loaded(model: Any) -> Any:
    """Return the MjModel of a file, of XML or of itself."""
    import mujoco

    if isinstance(model, mujoco.MjModel):
        return model
    text = os.fspath(model)
    if text.lstrip().startswith("<"):
        return mujoco.MjModel.from_xml_string(text)
    return mujoco.MjModel.from_xml_path(text)


class _Arm:
    def __init__(
        self,
        model: Any,
        rate: float,
        actuators: Sequence[str] | None,
        sensors: Sequence[str] | None,
        joints: Sequence[str] | None,
        parameters: Mapping[str, float | Parameter | None],
    ) -> None:
        import mujoco

        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        steps = 1.0 / (rate * model.opt.timestep)
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            raise ValueError(f"a sample of {1 / rate:g} s is not a whole number of steps of {model.opt.timestep:g} s")
        kinds = mujoco.mjtObj
        actuators = self._chosen(actuators, kinds.mjOBJ_ACTUATOR, model.nu, "actuators")
        self.actuators = [self._id(kinds.mjOBJ_ACTUATOR, name, "actuator") for name in actuators]
        sensors = self._chosen(sensors, kinds.mjOBJ_SENSOR, model.nsensor, "sensors")
        outputs: dict[str, str | None] = {}
        self.seen: list[int] = []
        for name in sensors:
            sensor = self._id(kinds.mjOBJ_SENSOR, name, "sensor")
            at, size = int(model.sensor_adr[sensor]), int(model.sensor_dim[sensor])
            kind = KINDS.get(mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_"))
            outputs |= {name if size == 1 else f"{name}.{k}": kind for k in range(size)}
            self.seen += range(at, at + size)
        joints = self._joints() if joints is None else list(joints)
        ids = [self._id(kinds.mjOBJ_JOINT, name, "joint") for name in joints]
        for name, joint in zip(joints, ids, strict=True):
            if not self._moves_in_one_way(joint):
                raise ValueError(f"the joint {name!r} is neither a hinge nor a slide, so it is no port")
        self.positions = np.array([model.jnt_qposadr[joint] for joint in ids], dtype=int)
        self.velocities = np.array([model.jnt_dofadr[joint] for joint in ids], dtype=int)
        ports = [self._port(name, joint, actuators) for name, joint in zip(joints, ids, strict=True)]
        self.places = {name: self._place(name) for name in parameters}
        self.simulator = Simulator(
            self,
            rate=rate,
            inputs=actuators,
            outputs=outputs,
            parameters={name: self._parameter(name, given) for name, given in parameters.items()},
            ports=ports,
            steps_per_sample=round(steps),
            name="MuJoCo",
        )

    def start(self, parameters: dict[str, float]) -> Array:
        for name, value in parameters.items():
            array, at = self.places[name]
            array[at] = value
        # Masses and inertias have numbers that follow from them.
        self.mujoco.mj_setConst(self.model, self.data)
        self.mujoco.mj_resetData(self.model, self.data)
        return self._motions()

    def step(self, u: Array, forces: Array) -> Any:
        self.data.ctrl[self.actuators] = u
        self.data.qfrc_applied[self.velocities] = forces
        # The sensors that `mj_step` leaves are those of the start of the step.
        self.mujoco.mj_step(self.model, self.data)
        y = self.data.sensordata[self.seen].copy()
        return (y, self._motions()) if len(self.positions) else y

    def _motions(self) -> Array:
        start = self.model.qpos0[self.positions]
        return np.column_stack([self.data.qpos[self.positions] - start, self.data.qvel[self.velocities]])

    def _chosen(self, names: Sequence[str] | None, kind: Any, count: int, what: str) -> list[str]:
        every = (self.mujoco.mj_id2name(self.model, kind, k) for k in range(count))
        found = list(every if names is None else names)
        if None in found:
            raise ValueError(f"some {what} of the model have no name: name them, or choose with `{what}`")
        return found

    def _id(self, kind: Any, name: str, what: str) -> int:
        found = int(self.mujoco.mj_name2id(self.model, kind, name))
        if found < 0:
            raise ValueError(f"the model has no {what} {name!r}")
        return found

    def _moves_in_one_way(self, joint: int) -> bool:
        one_way = (self.mujoco.mjtJoint.mjJNT_HINGE, self.mujoco.mjtJoint.mjJNT_SLIDE)
        return self.model.jnt_type[joint] in [int(kind) for kind in one_way]

    def _joints(self) -> list[str]:
        every = ((joint, self.model.joint(joint).name) for joint in range(self.model.njnt))
        return [name for joint, name in every if name and self._moves_in_one_way(joint)]

    def _port(self, name: str, joint: int, actuators: list[str]) -> Port:
        joint_drive = int(self.mujoco.mjtTrn.mjTRN_JOINT)
        driven = (
            actuator
            for actuator, k in zip(actuators, self.actuators, strict=True)
            if self.model.actuator_trntype[k] == joint_drive and self.model.actuator_trnid[k, 0] == joint
        )
        hinge = self.model.jnt_type[joint] == int(self.mujoco.mjtJoint.mjJNT_HINGE)
        units = ("N m", "rad") if hinge else ("N", "m")
        return Port(name, next(driven, None), *units)

    def _place(self, name: str) -> tuple[Any, tuple[int, ...]]:
        attribute, _, rest = name.partition(":")
        element, _, column = rest.partition(":")
        array = getattr(self.model, attribute, None)
        if not isinstance(array, np.ndarray):
            raise ValueError(f"parameter {name!r}: the model has no attribute {attribute!r}")
        kinds = {"dof": "joint", "jnt": "joint", "geom": "geom", "body": "body", "actuator": "actuator"}
        kind = kinds.get(attribute.split("_")[0])
        if kind is None:
            raise ValueError(f"parameter {name!r}: known are attributes that begin with {', '.join(kinds)}")
        index = self._id(getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), element, kind)
        if attribute.startswith("dof"):
            index = int(self.model.jnt_dofadr[index])
        return array, (index, int(column or 0)) if array.ndim > 1 else (index,)

    def _parameter(self, name: str, given: float | Parameter | None) -> Parameter:
        array, at = self.places[name]
        own = float(array[at])
        if given is None:
            return Parameter(own, lower=0.0 if own >= 0.0 else None)
        if not isinstance(given, Parameter):
            return Parameter(float(given))
        return dataclasses.replace(given, value=own) if np.isnan(given.value) else given
