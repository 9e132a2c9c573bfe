"""Simulators from the systems of SciPy and python-control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plid._arrays import Array
from plid._simulator import Simulator


def from_system(
    system: Any,
    *,
    rate: float,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | Mapping[str, str | None] | None = None,
) -> Simulator:
    """Make a simulator from a linear system.

    Parameters
    ----------
    system : scipy.signal system, control system, or plid.Model
        A system in discrete time must have the sample rate of the records. A system in continuous time is converted
        with its inputs held over each sample.
    rate : float
        Samples per second, in Hz.
    inputs, outputs : sequence of str, optional
        Names of the channels. By default those of the system, or u1, u2, ... and y1, y2, ...

    Returns
    -------
    Simulator
        The simulator, without parameters and ports. For these, write a function or an object with steps.

    Examples
    --------
    >>> simulator = plid.gap.from_system(control.tf([1], [1, 0.2, 1]), rate=50.0)
    """
    a, b, c, d = matrices(system, rate)
    m, p = b.shape[1], c.shape[0]
    own_inputs = getattr(system, "input_labels", getattr(system, "inputs", None))
    own_outputs = getattr(system, "output_labels", getattr(system, "outputs", None))

    def linear(u: Array) -> Array:
        x, y = np.zeros(len(a)), np.empty((len(u), p))
        for k, held in enumerate(u):
            y[k] = c @ x + d @ held
            x = a @ x + b @ held
        return y

    return Simulator(
        linear,
        rate=rate,
        inputs=inputs or names(own_inputs, "u", m),
        outputs=outputs or names(own_outputs, "y", p),
        name=type(system).__name__,
    )


def matrices(system: Any, rate: float) -> tuple[Array, Array, Array, Array]:
    """Return A, B, C, D at this sample rate."""
    from scipy.signal import cont2discrete

    if hasattr(system, "rate") and hasattr(system, "A"):
        dt: float | None = 1.0 / system.rate
    else:
        dt = system.dt
        if hasattr(system, "to_ss"):
            system = system.to_ss()
        elif not hasattr(system, "A"):
            from control import ss

            system = ss(system)
    found = tuple(np.atleast_2d(np.asarray(x, dtype=float)) for x in (system.A, system.B, system.C, system.D))
    if not dt:
        return tuple(np.asarray(x) for x in cont2discrete(found, 1.0 / rate)[:4])  # type: ignore[return-value]
    if dt is not True and abs(dt * rate - 1.0) > 1e-6:
        raise ValueError(f"the system has a sample rate of {1.0 / dt:g} Hz, the records {rate:g} Hz")
    return found  # type: ignore[return-value]


def names(own: Any, letter: str, count: int) -> list[str]:
    """Return a system's names, or u1, u2, ..."""
    given = list(own) if isinstance(own, (list, tuple)) and len(own) == count else []
    return given or [f"{letter}{k + 1}" for k in range(count)]
