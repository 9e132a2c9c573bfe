"""Records from files."""

from __future__ import annotations

import os
from collections.abc import Sequence

from plid import _plid
from plid._arrays import Array


def read(path: str | os.PathLike[str], *, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[Array, Array]:
    """Read the inputs and outputs of a record from a file.

    Parameters
    ----------
    path : path
        Text with or without a header (comma, semicolon, tab or blanks), MATLAB .mat (v4 or v5), or NumPy .npz or .npy.
    inputs, outputs : sequence of str
        Names of the channels. Columns without a name are "1", "2", ...; those of an array `y` among several arrays are
        "y1", "y2", ...

    Returns
    -------
    u, y : ndarray, shapes (samples, m), (samples, p)
        Inputs and outputs. A missing output is NaN.

    Raises
    ------
    ValueError
        If the file is not a table or lacks a channel.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> u, y = plid.read("slow.csv", inputs=["torque"], outputs=["angle"])
    >>> model = plid.identify(u, y, rate=200.0)
    """
    return _plid.read(os.fspath(path), list(inputs), list(outputs))
