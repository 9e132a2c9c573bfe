"""Identification of linear plants from records of inputs and outputs.

`identify` makes a `Model` from two arrays. `Identifier` takes one sample at a time. `variants` lists the options
that are chosen by name, and `read` reads a record from a file. `plid.gap` finds what a simulator lacks.
"""

from plid import gap
from plid._identifier import Identifier
from plid._identify import identify, variants
from plid._model import FrequencyResponse, Mode, Model
from plid._plid import __version__
from plid._read import read

__all__ = [
    "FrequencyResponse",
    "Identifier",
    "Mode",
    "Model",
    "__version__",
    "gap",
    "identify",
    "read",
    "variants",
]
