"""One sample at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from plid import _plid
from plid._arrays import Array, positive, vector
from plid._model import Model


class Identifier:
    """The recursion, which takes one sample at a time.

    The estimate holds the n states and then all parameters, (1 + p + m) n numbers in total. Inputs and outputs are
    deviations from an operating point, so means should be removed.

    Parameters
    ----------
    inputs, outputs : int
        Numbers of channels, m and p.
    states : int or sequence of int
        Number of states n, which are divided evenly among the outputs, or one observability index per output.
    rate : float
        Samples per second, in Hz.
    sensor_noise : float or array_like, shape (p,)
        Variance of the noise of the outputs, in their units squared.
    actuator_noise : float or array_like, shape (m,), default 0
        Variance of the noise of the inputs, in their units squared.
    state_noise : float or array_like, shape (n,), default 1e-6
        Variance of the noise that drives the states.
    initial_state_variance, initial_parameter_variance : float, default 1
        Variances of the initial estimate, which is zero.
    parameter_noise : float, default 0
        Variance added to each parameter at each step, for plants that change.
    forgetting : float, default 1
        The covariance is divided by this at each step.
    covariance, expectations, backend, scalar : str, optional
        The variant by name; `plid.variants` lists them. The covariance is "bierman-ud" by default.
    missing : bool, default False
        Whether NaN among the outputs is a missing sample. Otherwise it is an error.

    Examples
    --------
    >>> identifier = plid.Identifier(1, 1, states=2, rate=100.0, sensor_noise=1e-4)
    >>> for u_k, y_k in zip(u, y):
    ...     innovation = identifier.step(u_k, y_k)
    >>> model = identifier.model()
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        *,
        states: int | Sequence[int],
        rate: float,
        sensor_noise: Any,
        actuator_noise: Any = 0.0,
        state_noise: Any = 1e-6,
        initial_state_variance: float = 1.0,
        initial_parameter_variance: float = 1.0,
        parameter_noise: float = 0.0,
        forgetting: float = 1.0,
        covariance: str | None = None,
        expectations: str | None = None,
        backend: str | None = None,
        scalar: str | None = None,
        missing: bool = False,
    ) -> None:
        self._inputs, self._outputs = inputs, outputs
        indices = shared_out(states, outputs) if isinstance(states, (int, np.integer)) else [int(n) for n in states]
        if len(indices) != outputs:
            raise ValueError(f"states has {len(indices)} indices, expected one for each of {outputs} outputs")
        noise = (
            spread(sensor_noise, "sensor_noise", outputs),
            spread(actuator_noise, "actuator_noise", inputs),
            spread(state_noise, "state_noise", sum(indices)),
        )
        self._core = _plid.Recursion(
            indices,
            noise,
            (
                positive(initial_state_variance, "initial_state_variance"),
                positive(initial_parameter_variance, "initial_parameter_variance"),
            ),
            float(parameter_noise),
            positive(forgetting, "forgetting"),
            positive(rate, "rate"),
            dict(covariance=covariance, expectations=expectations, backend=backend, scalar=scalar),
            missing,
        )
        self._steps = 0

    def step(self, u: Any, y: Any) -> Array:
        """Process one sample.

        Parameters
        ----------
        u : array_like, shape (m,) or scalar
            Inputs of the sample.
        y : array_like, shape (p,) or scalar
            Outputs of the same sample.

        Returns
        -------
        ndarray, shape (p,)
            The innovation: the outputs minus their prediction from the samples before. It is NaN for a missing output.
        """
        innovation = self._core.step(vector(u, "u", self._inputs), vector(y, "y", self._outputs))
        self._steps += 1
        return innovation

    @property
    def steps(self) -> int:
        """Number of samples processed."""
        return self._steps

    @property
    def estimate(self) -> Array:
        """Estimate of states and parameters, shape ((1 + p + m) n,)."""
        return self._core.estimate

    @property
    def variances(self) -> Array:
        """Diagonal of the covariance of the estimate, shape ((1 + p + m) n,)."""
        return self._core.variances

    @property
    def state(self) -> Array:
        """Estimate of the state, shape (n,)."""
        return self._core.estimate[: self._core.states]

    def model(self) -> Model:
        """Return the present model with the covariance of its parameters."""
        return Model(self._core.model())


def shared_out(states: int, outputs: int) -> list[int]:
    """Divide states among outputs as evenly as possible."""
    return [states // outputs + (k < states % outputs) for k in range(outputs)]


def spread(value: Any, name: str, length: int) -> list[float]:
    """Return one variance for each channel."""
    array = np.asarray(value, dtype=np.float64)
    return list(vector(np.full(length, array) if array.ndim == 0 else array, name, length))
