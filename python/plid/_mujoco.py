"""Simulators from MuJoCo models."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plid._arrays import Array
from plid._simulator import Parameter, Port, Simulator, by_name

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

# MuJoCo's elements by the prefix of their attributes, and the parameters of joints.
ELEMENTS = {"dof_": "joint", "jnt_": "joint", "geom_": "geom", "body_": "body", "actuator_": "actuator"}
JOINT = {
    "damping": "dof_damping",
    "frictionloss": "dof_frictionloss",
    "stiffness": "jnt_stiffness",
    "armature": "dof_armature",
}


def from_mujoco(
    model: Any,
    *,
    rate: float,
    actuators: Sequence[str] | None = None,
    sensors: Sequence[str] | None = None,
    joints: Sequence[str] | None = None,
    parameters: Mapping[str, float | Parameter | None] | Sequence[str] = (),
) -> Simulator:
    """Make a simulator from a MuJoCo model.

    Parameters
    ----------
    model : path, str or mujoco.MjModel
        A file, the text of an XML model, or a model. It begins at its initial position `qpos0`.
    rate : float
        Samples per second, in Hz. A sample must be a whole number of the model's time steps.
    actuators : sequence of str, optional
        The actuators that are inputs. The default is all actuators. The others are held at zero.
    sensors : sequence of str, optional
        The sensors that are outputs. The default is all sensors. A sensor with several numbers gives "name.0",
        "name.1", ...
    joints : sequence of str, optional
        The hinges and slides that are ports. The default is all of them.
    parameters : dict or sequence of str, optional
        Numbers of the model that may be wrong: "joint.NAME.damping", "joint.NAME.frictionloss",
        "joint.NAME.stiffness", "joint.NAME.armature", "body.NAME.mass" (its inertia follows), and "actuator.NAME.gain"
        (a factor, also on the stiffness of a position actuator). Any other number is named as in MjModel,
        "attribute:element" or, with several columns, "attribute:element:column", as in "geom_friction:floor:0". The
        value None, or a `Parameter` whose value is NaN, takes the model's own value.

    Returns
    -------
    Simulator
        The simulator, which takes a step for each time step of the model.

    Examples
    --------
    >>> simulator = plid.gap.from_mujoco("arm.xml", rate=200.0, parameters=["joint.hinge.damping", "body.link.mass"])
    """
    return _Arm(loaded(model), rate, actuators, sensors, joints, by_name(parameters)).simulator


def loaded(model: Any) -> Any:
    """Return the MjModel of a file, of XML text or of an MjModel."""
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
                raise ValueError(f"the joint {name!r} is neither a hinge nor a slide, so it cannot be a port")
        self.positions = np.array([model.jnt_qposadr[joint] for joint in ids], dtype=int)
        self.velocities = np.array([model.jnt_dofadr[joint] for joint in ids], dtype=int)
        self.rest = model.qpos0[self.positions]
        # Views of the arrays: asking MuJoCo for them in each step would take longer than the step.
        data = self.data
        self.ctrl, self.applied, self.sensed = data.ctrl, data.qfrc_applied, data.sensordata
        self.qpos, self.qvel = data.qpos, data.qvel
        self.moved = np.zeros((len(ids), 2))
        ports = [self._port(name, joint, actuators) for name, joint in zip(joints, ids, strict=True)]
        self.numbers = {name: self._number(name) for name in parameters}
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
            self.numbers[name].put(value)
        if parameters:
            # Other numbers of the model follow from masses and inertias.
            self.mujoco.mj_setConst(self.model, self.data)
        self.mujoco.mj_resetData(self.model, self.data)
        return self._motions()

    def step(self, u: Array, forces: Array) -> Any:
        self.ctrl[self.actuators] = u
        self.applied[self.velocities] = forces
        # After `mj_step`, the sensors hold the values at the start of the step.
        self.mujoco.mj_step(self.model, self.data)
        y = self.sensed[self.seen]
        return (y, self._motions()) if len(self.moved) else y

    def save(self) -> Array:
        state = np.empty(self.mujoco.mj_stateSize(self.model, self.mujoco.mjtState.mjSTATE_INTEGRATION))
        self.mujoco.mj_getState(self.model, self.data, state, self.mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def restore(self, state: Array) -> Array:
        self.mujoco.mj_setState(self.model, self.data, state, self.mujoco.mjtState.mjSTATE_INTEGRATION)
        return self._motions()

    def _motions(self) -> Array:
        self.moved[:, 0] = self.qpos[self.positions] - self.rest
        self.moved[:, 1] = self.qvel[self.velocities]
        return self.moved

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

    def _number(self, name: str) -> _Number:
        if ":" in name:
            attribute, _, rest = name.partition(":")
            element, _, column = rest.partition(":")
            kind = next((kind for start, kind in ELEMENTS.items() if attribute.startswith(start)), None)
            if kind is None or not isinstance(getattr(self.model, attribute, None), np.ndarray):
                starts = ", ".join(ELEMENTS)
                raise ValueError(f"parameter {name!r}: {attribute!r} is not an attribute of MjModel with {starts}")
            return self._entry(attribute, kind, element, int(column or 0))
        kind, _, rest = name.partition(".")
        element, _, field = rest.rpartition(".")
        if kind == "joint" and field in JOINT:
            return self._entry(JOINT[field], "joint", element)
        if (kind, field) == ("body", "mass"):
            mass = self._entry("body_mass", "body", element)
            return _Number(mass.value, [*mass.of, *self._row("body_inertia", "body", element, mass.value).of])
        if (kind, field) == ("actuator", "gain"):
            parts = (self._row(f"actuator_{part}prm", "actuator", element, 1.0) for part in ("gain", "bias"))
            return _Number(1.0, [of for part in parts for of in part.of])
        raise ValueError(
            f"parameter {name!r}: known are joint.NAME.{{{', '.join(JOINT)}}}, body.NAME.mass, actuator.NAME.gain and "
            "attribute:element[:column]"
        )

    def _entry(self, attribute: str, kind: str, element: str, column: int = 0) -> _Number:
        array, at = self._at(attribute, kind, element)
        row = array[at].reshape(-1)
        if not 0 <= column < row.size:
            raise ValueError(f"{attribute}:{element} has {row.size} columns, so there is no column {column}")
        # The value itself, as a factor on 1.
        return _Number(float(row[column]), [(row[column : column + 1], np.ones(1))])

    def _row(self, attribute: str, kind: str, element: str, value: float) -> _Number:
        """Return a number with this value. All entries of an element change in proportion to it."""
        array, at = self._at(attribute, kind, element)
        row = array[at].reshape(-1)
        return _Number(value, [(row, row / value)])

    def _at(self, attribute: str, kind: str, element: str) -> tuple[Any, slice]:
        index = self._id(getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), element, kind)
        if attribute.startswith("dof"):
            index = int(self.model.jnt_dofadr[index])
        # A slice is a view, even of an array with one dimension.
        return getattr(self.model, attribute), slice(index, index + 1)

    def _parameter(self, name: str, given: float | Parameter | None) -> Parameter:
        own = self.numbers[name].value
        if given is None:
            return Parameter(own, lower=0.0 if own >= 0.0 else None)
        if not isinstance(given, Parameter):
            return Parameter(float(given))
        return dataclasses.replace(given, value=own) if np.isnan(given.value) else given


@dataclasses.dataclass
class _Number:
    """A number of a model: its value, and the views of the model that are multiples of it."""

    value: float
    of: list[tuple[Array, Array]]

    def put(self, value: float) -> None:
        for view, factor in self.of:
            view[:] = value * factor
