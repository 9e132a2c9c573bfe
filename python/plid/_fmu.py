"""Simulators from FMUs."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plid import _plid
from plid._arrays import Array, positive
from plid._simulator import Parameter, Port, Simulator, by_name


@dataclasses.dataclass(frozen=True)
class FmuPort:
    """A place of an FMU that has a displacement and a velocity and takes a force.

    Attributes
    ----------
    name : str
        The name of the port.
    force : str
        The input that takes the force.
    displacement, velocity : str
        The variables that show its motion, outputs or local ones.
    """

    name: str
    force: str
    displacement: str
    velocity: str


def from_fmu(
    path: str | os.PathLike[str],
    *,
    rate: float | None = None,
    parameters: Mapping[str, float | Parameter | None] | Sequence[str] = (),
    ports: Sequence[FmuPort] = (),
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    steps_per_sample: int | None = None,
) -> Simulator:
    """Make a simulator from an FMU for co-simulation, FMI 2.0 or 3.0.

    The FMU runs in this process, and its steps do not go through Python. If it crashes, the process ends. The program
    `plid` runs it in a child process instead (`plid gap diagnose`).

    Parameters
    ----------
    path : path
        The FMU.
    rate : float, optional
        Samples per second, in Hz. By default a sample is one step of the FMU's default experiment.
    parameters : dict or sequence of str, optional
        Parameters of the FMU that may be wrong. The value None, or a `Parameter` whose value is NaN, takes the FMU's
        own value. Bounds and units that a `Parameter` does not have are those of the FMU.
    ports : sequence of FmuPort, optional
        Places that take a force.
    inputs : sequence of str, optional
        The inputs. By default, these are all real inputs except those that take the force of a port, or all real inputs
        if each of them takes one. An input that is left out keeps its start value.
    outputs : sequence of str, optional
        The outputs; by default all real outputs.
    steps_per_sample : int, optional
        Number of steps in a sample. The default is 1 without ports; with ports, it follows from the step size of the
        FMU's default experiment.

    Returns
    -------
    Simulator
        The simulator for `diagnose`.

    Raises
    ------
    ValueError
        If the FMU is of another kind or for another machine, or lacks a variable.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> port = plid.gap.FmuPort("joint", force="torque", displacement="angle", velocity="speed")
    >>> simulator = plid.gap.from_fmu("arm.fmu", rate=200.0, parameters={"damping": None}, ports=[port])
    """
    options: dict[str, Any] = {
        "parameters": [chosen(name, parameter) for name, parameter in by_name(parameters).items()],
        "ports": [dataclasses.asdict(port) for port in ports],
    }
    if rate is not None:
        options["rate_hz"] = positive(rate, "rate")
    for key, names in (("inputs", inputs), ("outputs", outputs)):
        if names is not None:
            options[key] = list(names)
    if steps_per_sample is not None:
        options["steps_per_sample"] = int(steps_per_sample)
    return _OfFmu(_plid.Fmu(os.fspath(path), json.dumps(options)))


def chosen(name: str, given: float | Parameter | None) -> dict[str, Any]:
    """Return a parameter for the compiled module. The FMU provides what is None."""
    if given is None:
        return {"name": name}
    fields = dataclasses.asdict(given) if isinstance(given, Parameter) else {"value": float(given)}
    if math.isnan(fields["value"]):
        fields["value"] = None
    return {"name": name} | fields


class _OfFmu(Simulator):
    def __init__(self, native: _plid.Fmu) -> None:
        # A diagnosis steps the native FMU itself.
        self.native = native
        known = json.loads(native.description())
        self.name: str = known["name"]
        self.rate: float = known["rate_hz"]
        self.inputs = [one["name"] for one in known["inputs"]]
        self.outputs = [one["name"] for one in known["outputs"]]
        self.ports = [Port(**one) for one in known["ports"]]
        self.parameters = {one.pop("name"): Parameter(**one) for one in known["parameters"]}
        self.steps_per_sample: int = known["steps_per_sample"]
        self.states: bool = known.get("states", False)

    def description(self) -> str:
        return self.native.description()

    def run(self, parameters: Array, u: Array) -> Array:
        return self.native.run(np.asarray(parameters, dtype=np.float64), np.asarray(u, dtype=np.float64))

    def start(self, parameters: Array) -> Array:
        return self.native.start(np.asarray(parameters, dtype=np.float64))

    def step(self, u: Array, forces: Array) -> tuple[Array, Array]:
        return self.native.step(np.asarray(u, dtype=np.float64), np.asarray(forces, dtype=np.float64))
