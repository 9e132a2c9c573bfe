"""Identification of linear plants from records of inputs and outputs.

`identify` makes a `Model` of two arrays. `Identifier` takes one sample at a time. `variants` lists what can be chosen
by name, `read` reads a record from a file. `plid.gap` finds what a simulator misses.
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
