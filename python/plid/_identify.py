"""Identification of a model from two arrays."""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable
from typing import Any

from plid import _plid
from plid._arrays import channels, positive
from plid._model import Model


def variants() -> dict[str, list[str]]:
    """List the names of all variants.

    Returns
    -------
    dict of str to list of str
        The options `covariance`, `expectations`, `backend` and `scalar`, each with the names that it accepts.

    Examples
    --------
    >>> plid.variants()["scalar"]
    ['f32', 'f64', 'double-double']
    """
    return dict(_plid.variants())


def identify(
    u: Any,
    y: Any,
    *,
    rate: float,
    states: int | None = None,
    covariance: str | None = None,
    expectations: str | None = None,
    backend: str | None = None,
    scalar: str | None = None,
    missing: bool = False,
    predictor: bool = True,
    progress: Callable[[str], object] | bool | None = None,
) -> Model:
    """Identify a linear plant from a record.

    The operating point is identified together with the plant, so means need not be removed. Ctrl-C stops the
    computation.

    Parameters
    ----------
    u : array_like, shape (samples, m) or (samples,)
        Inputs, one row per sample. The columns of a pandas data frame name the channels.
    y : array_like, shape (samples, p) or (samples,)
        Outputs at the same samples.
    rate : float
        Samples per second, in Hz.
    states : int, optional
        Number of states. By default, several numbers are compared, and the smallest sufficient one is chosen.
    covariance, expectations, backend, scalar : str, optional
        The variant of the recursion by name; `variants` lists them. The default is the recommended one.
    missing : bool, default False
        Whether NaN among the outputs is a missing sample. Otherwise it is an error.
    predictor : bool, default True
        Whether to fit also the gain of the one-step predictor, as `Model.with_predictor` describes. The model has no
        gain if no gain keeps its predictor bounded.
    progress : callable or bool, optional
        Receives lines of text. By default they go to standard error if it is a terminal; False turns them off.

    Returns
    -------
    Model
        x(k+1) = A x(k) + B u(k), y(k) = C x(k) about the operating point, with the covariance of its parameters.

    Raises
    ------
    ValueError
        If the arrays do not match, a channel is constant, the record is too short, or a name is unknown.
    TypeError
        If an array does not hold real numbers.

    Examples
    --------
    >>> model = plid.identify(u, y, rate=100.0, covariance="array-sqrt")
    >>> [round(mode.hz, 1) for mode in model.modes()]
    [6.3, 11.9]
    """
    inputs, outputs = channels(u, "u"), channels(y, "y", missing)
    if len(inputs.samples) != len(outputs.samples):
        raise ValueError(
            f"u has the shape {inputs.samples.shape} and y {outputs.samples.shape}: "
            "each sample needs a row of both"
        )
    if states is not None and (states := operator.index(states)) < 1:
        raise ValueError(f"states = {states} is not positive")
    variant = dict(covariance=covariance, expectations=expectations, backend=backend, scalar=scalar)
    with listener(progress) as listen:
        core = _plid.identify(
            inputs.samples,
            outputs.samples,
            positive(rate, "rate"),
            (inputs.names, outputs.names),
            variant,
            states,
            missing,
            listen,
        )
    model = Model(core)
    if not predictor:
        return model
    u_0, y_0 = model.operating_point
    found = core.with_predictor(inputs.samples - u_0, outputs.samples - y_0)
    return model if found is None else Model(found)


class listener:
    """Return the receiver of progress: a callable, a line on a terminal, or None."""

    def __init__(self, progress: Callable[[str], object] | bool | None) -> None:
        on_terminal = progress is True or (progress is None and sys.stderr is not None and sys.stderr.isatty())
        self.line = on_terminal and not callable(progress)
        self.listen = progress if callable(progress) else self.show if self.line else None

    def show(self, text: str) -> None:
        """Replace the line on the terminal."""
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()

    def __enter__(self) -> Callable[[str], object] | None:
        return self.listen

    def __exit__(self, *error: object) -> None:
        if self.line:
            self.show("")
