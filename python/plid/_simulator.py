"""Simulators: a function from inputs to outputs, or an object that takes steps."""

from __future__ import annotations

import dataclasses
import inspect
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plid import _plid
from plid._arrays import Array, positive


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number of a simulator that may be wrong.

    Attributes
    ----------
    value : float
        Its value in the simulator as given.
    lower, upper : float, optional
        Bounds of the values that the simulator accepts.
    limit : float, optional
        Largest expected error (two standard deviations). A smaller error is not named as a cause. Without a limit, any
        material error is a cause.
    unit : str, optional
        The unit of the value.
    """

    value: float
    lower: float | None = None
    upper: float | None = None
    limit: float | None = None
    unit: str | None = None


@dataclasses.dataclass(frozen=True)
class Port:
    """A place of a simulator that has a displacement and a velocity and takes a force.

    Attributes
    ----------
    name : str
        Its name.
    input : str, optional
        The input that acts at the same place.
    force_unit, displacement_unit : str, optional
        Units of forces and displacements.
    """

    name: str
    input: str | None = None
    force_unit: str | None = None
    displacement_unit: str | None = None


class Simulator:
    """A simulator for `plid.gap.diagnose`.

    Parameters
    ----------
    simulator : callable or object
        Either a function `u -> y` of arrays (samples, m) and (samples, p), or an object that takes steps. A function
        with parameters is called as `simulator(u, parameters)` with a dict by name. An object has a method
        `start(parameters)`, which goes to rest and returns the motion at each port, and a method `step(u, forces)`,
        which holds the inputs (m,) and the forces at the ports over a step. `step` returns the outputs (p,) at the
        start of the step, and displacement and velocity of each port, shape (ports, 2), at its end. Without ports, it
        returns only the outputs. Arrays, tuples and lists are accepted, and each call may return the same object. The
        object may also have a method `save()`, which returns its state between two steps, and a method
        `restore(state)`, which returns to that state and gives the motions there.
    rate : float
        Samples per second, in Hz.
    inputs, outputs : sequence of str
        Names of the channels. For `outputs`, a dict gives each output's kind, or None: "position", "velocity",
        "acceleration", "force", "other".
    parameters : dict, optional
        The parameters that may be wrong, by name. Each is a number or a `Parameter`.
    ports : sequence of str or Port, optional
        Places that take a force, for an object with steps.
    steps_per_sample : int, default 1
        Number of steps in a sample.
    name : str, optional
        The name of the simulator in messages.
    patience : float, default 600.0
        Longest time of a call (a run, or a step), in s. A call that takes longer fails with `TimeoutError`. Native code
        is not interrupted: the exception is raised once it returns to Python.

    Examples
    --------
    >>> simulator = plid.gap.Simulator(my_function, rate=200.0, inputs=["torque"], outputs={"angle": "position"})
    """

    def __init__(
        self,
        simulator: Any,
        *,
        rate: float,
        inputs: Sequence[str],
        outputs: Sequence[str] | Mapping[str, str | None],
        parameters: Mapping[str, float | Parameter] | None = None,
        ports: Sequence[str | Port] = (),
        steps_per_sample: int = 1,
        name: str | None = None,
        patience: float = 600.0,
    ) -> None:
        # The compiled module calls this `step` itself.
        step = getattr(simulator, "step", None)
        self.own_step = step if callable(step) else None
        if self.own_step is None and not callable(simulator):
            raise TypeError(f"simulator is a {type(simulator).__name__}: neither a function nor an object with `step`")
        if ports and self.own_step is None:
            raise TypeError("only a simulator with `step` has ports")
        self.states = self.own_step is not None and all(hasattr(simulator, name) for name in ("save", "restore"))
        self._kept: dict[int, Any] = {}
        self._simulator = simulator
        self.rate = positive(rate, "rate")
        self.patience = positive(patience, "patience")
        self.inputs = list(inputs)
        kinds = outputs if isinstance(outputs, Mapping) else dict.fromkeys(outputs)
        self.outputs = list(kinds)
        given = (parameters or {}).items()
        self.parameters = {key: p if isinstance(p, Parameter) else Parameter(float(p)) for key, p in given}
        self.ports = [port if isinstance(port, Port) else Port(port) for port in ports]
        self.steps_per_sample = 0 if self.own_step is None else int(steps_per_sample)
        self.name = name or getattr(simulator, "__name__", type(simulator).__name__)
        self._kinds = dict(kinds)

    def description(self) -> str:
        """Return the description as JSON, as `plid gap check-simulator` reads it."""
        return json.dumps(
            {
                "name": self.name,
                "rate_hz": self.rate,
                "inputs": [{"name": name} for name in self.inputs],
                "outputs": [known({"name": name, "kind": kind}) for name, kind in self._kinds.items()],
                "ports": [known(dataclasses.asdict(port)) for port in self.ports],
                "parameters": [{"name": n} | known(dataclasses.asdict(p)) for n, p in self.parameters.items()],
                "steps_per_sample": self.steps_per_sample,
                "states": self.states,
            }
        )

    def run(self, parameters: Array, u: Array) -> Array:
        """Simulate from rest: inputs (samples, m) to outputs (samples, p)."""
        if self.own_step is not None:
            given = np.asarray(parameters, dtype=np.float64), np.asarray(u, dtype=np.float64)
            return _plid.run(self, self.description(), *given)
        arguments = (u, self._named(parameters)) if self.parameters else (u,)
        y = np.asarray(self._simulator(*arguments), dtype=np.float64)
        if y.ndim == 1:
            y = y[:, np.newaxis]
        if y.shape != (len(u), len(self.outputs)):
            raise ValueError(f"{self.name} returned the shape {y.shape}, expected {(len(u), len(self.outputs))}")
        return y

    def start(self, parameters: Array) -> Array:
        """Go to rest, and return displacement and velocity of each port, shape (ports, 2)."""
        self._kept.clear()
        start = self._simulator.start
        takes = len(inspect.signature(start).parameters) > 0
        found = start(self._named(parameters)) if takes else start()
        return self._motions(np.zeros((len(self.ports), 2)) if found is None else found)

    def save(self, slot: int) -> None:
        """Store the present state in a slot until the next start."""
        self._kept[slot] = self._simulator.save()

    def restore(self, slot: int) -> Array:
        """Return to the state in a slot, and return displacement and velocity of each port, shape (ports, 2)."""
        if slot not in self._kept:
            raise KeyError(f"slot {slot} holds no state")
        return self._motions(self._simulator.restore(self._kept[slot]))

    def step(self, u: Array, forces: Array) -> Any:
        """Advance by one step, and return what the simulator's own `step` returns."""
        return self._simulator.step(u, forces)

    def _motions(self, found: Any) -> Array:
        empty = found is None or np.size(found) == 0
        motions = np.zeros((0, 2)) if empty else np.asarray(found, dtype=np.float64).reshape(-1, 2)
        if motions.shape != (len(self.ports), 2):
            raise ValueError(f"{self.name} returned motions of shape {motions.shape}, expected ({len(self.ports)}, 2)")
        return motions

    def _named(self, parameters: Array) -> dict[str, float]:
        return dict(zip(self.parameters, parameters.tolist(), strict=True))


@dataclasses.dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes
    ----------
    what : str
        What was checked, in a few words.
    required : bool
        Whether a diagnosis needs it.
    holds : bool
        Whether the simulator honours it.
    found : str
        What was found, in a sentence.
    """

    what: str
    required: bool
    holds: bool
    found: str


def check(simulator: Simulator, *, size: float = 1.0) -> list[Finding]:
    """Check which rules a simulator violates, before it is used in a diagnosis.

    Parameters
    ----------
    simulator : Simulator
        The simulator to check.
    size : float, default 1.0
        Size of the trial inputs.

    Returns
    -------
    list of Finding
        The results of the checks: equal runs, steps against a run, parameters and their bounds, motions and forces at
        ports, and stored states.

    Examples
    --------
    >>> [finding.found for finding in plid.gap.check(simulator) if not finding.holds]
    """
    found = _plid.check(simulator, simulator.description(), positive(size, "size"))
    return [Finding(**finding) for finding in json.loads(found)]


def serve(simulator: Simulator) -> None:
    """Serve a simulator to the program `plid` over standard input and output, until standard input ends.

    A script that ends with this call is a command for `[simulator]` in a case. Its later standard output goes to
    plid's log.

    Parameters
    ----------
    simulator : Simulator
        The simulator to serve.

    Examples
    --------
    >>> plid.gap.serve(plid.gap.from_mujoco("arm.xml", rate=200.0))
    """
    _plid.serve(simulator, simulator.description())


def by_name(parameters: Mapping[str, Any] | Sequence[str]) -> Mapping[str, Any]:
    """Return the value given for each parameter, or None for a name without a value."""
    if isinstance(parameters, str):
        raise TypeError("parameters is a str: give a sequence of names or a dict")
    return parameters if isinstance(parameters, Mapping) else dict.fromkeys(parameters)


def known(entries: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that are not None."""
    return {key: value for key, value in entries.items() if value is not None}
