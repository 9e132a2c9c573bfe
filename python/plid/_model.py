"""A linear model: its matrices, modes and responses, and its files."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plid import _files, _plid
from plid._arrays import Array, channels, numbers, positive, vector


class Mode(NamedTuple):
    """A mode: a pair of complex poles, or a real pole.

    Attributes
    ----------
    hz : float
        Natural frequency in Hz.
    damping : float
        Damping ratio.
    hz_std, damping_std : float or None
        Their standard deviations. They are None if the model has no covariance or the mode has no
        first-order expansion.
    pole : complex
        The pole in discrete time. For a pair, it is the one with the positive imaginary part.
    oscillatory : bool
        Whether the mode is a pair of poles.
    """

    hz: float
    damping: float
    hz_std: float | None
    damping_std: float | None
    pole: complex
    oscillatory: bool


class FrequencyResponse(NamedTuple):
    """A frequency response.

    Attributes
    ----------
    hz : ndarray, shape (k,)
        Frequencies in Hz.
    response : complex ndarray, shape (k, p, m)
        Response of each output to each input, in output units per input unit.
    magnitude_std : ndarray, shape (k, p, m), or None
        Standard deviation of its magnitude; None if the model has no covariance of its parameters.
    """

    hz: Array
    response: NDArray[np.complex128]
    magnitude_std: Array | None


class Model:
    """A linear model in discrete time: x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k).

    `plid.identify` makes models, `Model.load` reads them, and `Model.of_matrices` takes your own. The inputs and
    outputs of an identified model are deviations from its operating point. `simulate` takes and returns the channels as
    they were recorded.

    Examples
    --------
    >>> model = plid.identify(u, y, rate=100.0)
    >>> model.A.shape
    (4, 4)
    >>> model.save("model.json")
    """

    def __init__(self, core: _plid.Model) -> None:
        self._core = core
        self._record: dict[str, Any] = _files.provenance(core)

    @classmethod
    def of_matrices(cls, A: Any, B: Any, C: Any, D: Any = None, *, rate: float) -> Model:  # noqa: N803
        """Make a model from matrices.

        Parameters
        ----------
        A, B, C, D : array_like, shapes (n, n), (n, m), (p, n), (p, m)
            The matrices in discrete time. D is zero by default.
        rate : float
            Samples per second, in Hz.

        Returns
        -------
        Model
            The model with inputs u1, u2, ... and outputs y1, y2, ...
        """
        a, b, c = (matrix(x, name) for x, name in ((A, "A"), (B, "B"), (C, "C")))
        d = np.zeros((c.shape[0], b.shape[1])) if D is None else matrix(D, "D")
        return cls(_plid.Model.of_matrices(positive(rate, "rate"), a, b, c, d))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Model:
        """Read a model from a .json (model.json), .npz or .mat file, as `save` writes it."""
        return cls(_files.load(os.fspath(path)))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a .json (model.json), .npz or .mat file. Numbers are read back exactly.

        Parameters
        ----------
        path : path
            The ending selects the format. A .mat file requires SciPy; MATLAB can read it, too.
        """
        _files.save(self._core, os.fspath(path))

    @property
    def A(self) -> Array:  # noqa: N802
        """State matrix, shape (n, n)."""
        return self._core.a

    @property
    def B(self) -> Array:  # noqa: N802
        """Input matrix, shape (n, m)."""
        return self._core.b

    @property
    def C(self) -> Array:  # noqa: N802
        """Output matrix, shape (p, n)."""
        return self._core.c

    @property
    def D(self) -> Array:  # noqa: N802
        """Feedthrough matrix, shape (p, m)."""
        return self._core.d

    @property
    def predictor_gain(self) -> Array | None:
        """Gain K of the one-step predictor x(k+1) = A x(k) + B u(k) + K e(k), shape (n, p).

        It is None if the model has none. `plid.identify`, `plid run` and `with_predictor` fit a gain.
        """
        return self._core.predictor_gain

    @property
    def parameter_covariance(self) -> Array | None:
        """Covariance of the parameters, a square of size (p + m) n, if it is known."""
        return self._core.parameter_covariance

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs (m)."""
        return self._core.inputs

    @property
    def outputs(self) -> list[str]:
        """Names of the outputs (p)."""
        return self._core.outputs

    @property
    def rate(self) -> float:
        """Samples per second, in Hz."""
        return self._core.rate

    @property
    def provenance(self) -> dict[str, Any]:
        """Origin of the model: the program, the variant, the orders compared, the operating point."""
        return dict(self._record)

    @property
    def operating_point(self) -> tuple[Array, Array]:
        """Inputs (m) and outputs (p) at which the plant is at rest. They are zero unless `identify` made the model."""
        point = self._record.get("operating_point", {})
        inputs = point.get("inputs", np.zeros(len(self.inputs)))
        return np.asarray(inputs, dtype=float), np.asarray(
            point.get("outputs", np.zeros(len(self.outputs))), dtype=float
        )

    def modes(self) -> list[Mode]:
        """Return the modes in order of frequency, with standard deviations where the covariance is known."""
        return [Mode(*mode) for mode in self._core.modes()]

    def frequency_response(self, hz: Any) -> FrequencyResponse:
        """Return the frequency response.

        Parameters
        ----------
        hz : array_like, shape (k,) or scalar
            Frequencies in Hz, from 0 to half the sample rate.

        Returns
        -------
        FrequencyResponse
            The response, shape (k, p, m), with the standard deviation of its magnitude.

        Examples
        --------
        >>> found = model.frequency_response([5.0, 10.0])
        >>> abs(found.response[:, 0, 0]), found.magnitude_std[:, 0, 0]
        """
        frequencies = np.atleast_1d(numbers(hz, "hz"))
        if frequencies.ndim != 1:
            raise ValueError(f"hz has the shape {frequencies.shape}, expected (k,)")
        response, std = self._core.frequency_response(frequencies.tolist())
        return FrequencyResponse(frequencies, response, std)

    def simulate(self, u: Any, state: Any = None) -> Array:
        """Simulate the outputs.

        Parameters
        ----------
        u : array_like, shape (samples, m) or (samples,)
            Inputs as recorded. The operating point is subtracted from them and added to the outputs.
        state : array_like, shape (n,), optional
            State at the first sample, as a deviation. By default, the plant begins at rest at its operating point.

        Returns
        -------
        ndarray, shape (samples, p)
            Outputs at the same samples.
        """
        inputs, outputs = self.operating_point
        given = self._input(u) - inputs
        return self._core.simulate(given, self._state(state)) + outputs

    def predict(self, u: Any, y: Any, state: Any = None) -> Array:
        """Predict each output from the samples before it, with the predictor gain.

        `with_predictor` fits the gain.

        Parameters
        ----------
        u, y : array_like, shapes (samples, m), (samples, p)
            Inputs and outputs as recorded. NaN among the outputs is a missing sample.
        state : array_like, shape (n,), optional
            State at the first sample, as a deviation. The default is zero.

        Returns
        -------
        ndarray, shape (samples, p)
            The predictions.
        """
        inputs, outputs = self.operating_point
        measured = channels(y, "y", missing=True).samples - outputs
        return self._core.predict(self._input(u) - inputs, measured, self._state(state)) + outputs

    def with_predictor(self, u: Any, y: Any) -> Model:
        """Fit the gain of the one-step predictor, and return the model with it.

        The gain is fitted to one-step errors over the first three quarters of the record, of which at most 30 000
        samples are used. The last quarter decides among a steady-state Kalman gain, its refinement and no feedback.
        Outputs count relative to their size. The time grows with the samples, the outputs and the cube of the states.
        Ctrl-C takes effect only at the end.

        Parameters
        ----------
        u, y : array_like, shapes (samples, m), (samples, p)
            Inputs and outputs as recorded, beginning at rest at the operating point. NaN among the outputs is a
            missing sample.

        Returns
        -------
        Model
            The same model with a `predictor_gain`. Its `provenance` states the origin of the gain under "predictor".

        Raises
        ------
        ValueError
            If the record does not fit the model, is too short, or no gain keeps the predictor bounded.

        Examples
        --------
        >>> predictor = model.with_predictor(u, y)
        >>> error = y - predictor.predict(u, y)
        """
        inputs, outputs = self.operating_point
        measured = channels(y, "y", missing=True).samples
        if measured.shape[1] != len(self.outputs):
            raise ValueError(
                f"y has the shape {measured.shape}, expected (samples, {len(self.outputs)}): {self.outputs}"
            )
        found = self._core.with_predictor(self._input(u) - inputs, measured - outputs)
        if found is None:
            raise ValueError("no gain keeps the predictor bounded on this record")
        return Model(found)

    def to_scipy(self) -> Any:
        """Return the model as a `scipy.signal.StateSpace` in discrete time, about the operating point."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D, dt=1.0 / self.rate)

    def to_control(self) -> Any:
        """Return the model as a `control.StateSpace` with the names of its channels, about the operating point.

        It requires the package `control` (python-control).
        """
        from control import ss

        return ss(self.A, self.B, self.C, self.D, 1.0 / self.rate, inputs=self.inputs, outputs=self.outputs)

    def __repr__(self) -> str:
        n, m, p = self.A.shape[0], len(self.inputs), len(self.outputs)
        return f"<plid.Model: {n} states, {m} inputs, {p} outputs at {self.rate:g} Hz>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self._core.to_json(),)

    def _input(self, u: Any) -> Array:
        given = channels(u, "u").samples
        if given.shape[1] != len(self.inputs):
            raise ValueError(f"u has the shape {given.shape}, expected (samples, {len(self.inputs)}): {self.inputs}")
        return given

    def _state(self, state: Any) -> Array | None:
        return None if state is None else vector(state, "state", self.A.shape[0])


def matrix(data: Any, name: str) -> Array:
    """Return a matrix. Other data raise an error that names their type."""
    array = numbers(data, name)
    if array.ndim != 2:
        raise ValueError(f"{name} has the shape {array.shape}, expected a matrix")
    return array


def _unpickled(text: str) -> Model:
    return Model(_plid.Model.of_json(text, "a pickled model"))
