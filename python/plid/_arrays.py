"""Records from arrays and data frames, checked before any work begins."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Channels(NamedTuple):
    """Samples of named channels."""

    samples: Array
    names: list[str]


def channels(data: Any, name: str, missing: bool = False, letter: str | None = None) -> Channels:
    """Return an array or a data frame as samples x channels.

    `name` is the name of the argument. Channels without a name are called `letter`, or otherwise `name`, with a number:
    u1, u2, ... NaN is accepted if `missing` is true.
    """
    array = numbers(data, name)
    if array.ndim == 1:
        array = array[:, np.newaxis]
    if array.ndim != 2:
        raise ValueError(f"{name} has the shape {array.shape}, expected (samples, channels) or (samples,)")
    samples, count = array.shape
    if samples == 0 or count == 0:
        raise ValueError(f"{name} has the shape {array.shape}: it is empty")
    names = names_of(data, letter or name, count)
    repeated = next((one for one in names if names.count(one) > 1), None)
    if repeated is not None:
        raise ValueError(f"{name} has two channels named {repeated!r}")
    bad = np.isinf(array) if missing else ~np.isfinite(array)
    if bad.any():
        sample, channel = np.argwhere(bad)[0]
        hint = "; with missing=True a NaN output is a missing sample" if np.isnan(array[sample, channel]) else ""
        raise ValueError(
            f"{name}: channel {names[channel]!r} is {array[sample, channel]} at sample {sample} (from 0){hint}"
        )
    return Channels(np.ascontiguousarray(array), names)


def numbers(data: Any, name: str) -> Array:
    """Return data as float64. Other data raise an error that names their type."""
    array = np.asarray(data)
    if array.dtype.kind not in "fiub":
        columns = zip(getattr(data, "columns", ()), getattr(data, "dtypes", ()))
        wrong = [f"; column {column!r} has dtype {kind}" for column, kind in columns if kind.kind not in "fiub"]
        raise TypeError(f"{name} holds {array.dtype}, expected real numbers{''.join(wrong[:1])}")
    return np.asarray(array, dtype=np.float64)


def names_of(data: Any, letter: str, count: int) -> list[str]:
    """Return the names of the columns of a data frame, the name of a series, or u1, u2, ..."""
    if hasattr(data, "columns"):
        return [str(column) for column in data.columns]
    if hasattr(data, "index") and isinstance(getattr(data, "name", None), str):
        return [data.name]
    return [f"{letter}{k + 1}" for k in range(count)]


def vector(data: Any, name: str, length: int) -> Array:
    """Return numbers as a vector of this length."""
    array = np.atleast_1d(numbers(data, name))
    if array.shape != (length,):
        raise ValueError(f"{name} has the shape {array.shape}, expected ({length},)")
    return np.ascontiguousarray(array)


def positive(value: Any, name: str) -> float:
    """Return a number after a check that it is positive and finite."""
    number = float(value)
    if not (np.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} = {value!r} is not positive and finite")
    return number
