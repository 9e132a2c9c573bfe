"""Files of models: model.json, and the same keys in .npz and .mat."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np

from plid import _plid

# Keys of model.json that hold numbers. All others are kept as text in `more`.
MATRICES = ("A", "B", "C", "D", "predictor_gain", "parameter_covariance")
VECTORS = ("observability_indices", "initial_state")


def provenance(core: _plid.Model) -> dict[str, Any]:
    """Return the origin of a model."""
    return json.loads(core.to_json()).get("provenance") or {}


def save(core: _plid.Model, path: str) -> None:
    """Write a model in the format of the file's ending."""
    ending = ending_of(path)
    if ending == ".json":
        core.write(path)
    elif ending == ".npz":
        with open(path, "wb") as file:
            np.savez(file, **arrays(core))
    else:
        from scipy.io import savemat

        savemat(path, arrays(core), appendmat=False)


def load(path: str) -> _plid.Model:
    """Read a model in the format of the file's ending."""
    ending = ending_of(path)
    if ending == ".json":
        return _plid.Model.read(path)
    if ending == ".npz":
        with np.load(path, allow_pickle=False) as file:
            found = dict(file)
    else:
        from scipy.io import loadmat

        found = loadmat(path, appendmat=False)
    return of_arrays(found, path)


def ending_of(path: str) -> str:
    """Return the ending of a file after a check that it is known."""
    ending = os.path.splitext(path)[1].lower()
    if ending not in (".json", ".npz", ".mat"):
        raise ValueError(f"{path}: the ending {ending!r} is none of .json, .npz, .mat")
    return ending


def arrays(core: _plid.Model) -> dict[str, Any]:
    """Return the keys of model.json as arrays, and the others as text."""
    keys = json.loads(core.to_json())
    found: dict[str, Any] = {key: np.asarray(keys.pop(key)) for key in (*MATRICES, *VECTORS) if key in keys}
    found["sample_rate_hz"] = np.asarray(keys.pop("sample_rate_hz"))
    found["more"] = json.dumps(keys)
    return found


def of_arrays(found: dict[str, Any], path: str) -> _plid.Model:
    """Return the model from such arrays. MATLAB turns vectors and numbers into matrices."""
    for key in ("A", "B", "C", "sample_rate_hz"):
        if key not in found:
            raise ValueError(f"{path}: there is no {key!r}, so it is not a model of plid")
    keys = json.loads(str(np.ravel(found["more"])[0])) if "more" in found else {}
    n = np.atleast_2d(found["A"]).shape[0]
    keys.setdefault("format", "state-space")
    keys["sample_rate_hz"] = float(np.ravel(found["sample_rate_hz"])[0])
    keys |= {key: np.atleast_2d(found[key]).tolist() for key in MATRICES if key in found}
    # MATLAB stores all numbers as floating-point numbers, even indices.
    of = {"observability_indices": int}
    keys |= {key: np.ravel(found[key]).astype(of.get(key, float)).tolist() for key in VECTORS if key in found}
    keys.setdefault("inputs", [f"u{k + 1}" for k in range(np.size(found["B"]) // n)])
    keys.setdefault("outputs", [f"y{k + 1}" for k in range(np.size(found["C"]) // n)])
    return _plid.Model.of_json(json.dumps(keys), path)
