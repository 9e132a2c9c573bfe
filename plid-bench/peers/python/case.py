"""The truss's record and what the filters start from, as `plid-peers export` writes them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class Case:
    n: int
    """States of the plant."""
    p: int
    """Outputs."""
    m: int
    """Inputs."""
    size: int
    """Joint states N = (p + m + 1) n."""
    rows: np.ndarray
    """For each output the state that it reads."""
    J: np.ndarray
    """The shift, n x n."""
    H: np.ndarray
    """p x N."""
    R: np.ndarray
    Q: np.ndarray
    Sigma: np.ndarray
    s0: np.ndarray
    P0: np.ndarray
    z: np.ndarray
    """Outputs, samples x p."""
    u: np.ndarray
    """Inputs, samples x m."""

    @staticmethod
    def read(directory: Path) -> "Case":
        case = json.loads((directory / "case.json").read_text())
        n, size, p = case["states"], case["joint_states"], case["outputs"]
        J = np.zeros((n, n))
        for i, source in enumerate(case["shift_source"]):
            if source is not None:
                J[i, source] = 1.0
        H = np.zeros((p, size))
        H[np.arange(p), case["output_states"]] = 1.0
        return Case(
            n=n,
            p=p,
            m=case["inputs"],
            size=size,
            rows=np.array(case["output_states"]),
            J=J,
            H=H,
            R=np.diag(case["sensor"]),
            Q=np.diag(case["actuator"]),
            Sigma=np.diag(case["state"]),
            s0=np.array(case["initial_estimate"]),
            P0=np.diag(case["initial_variances"]),
            z=np.load(directory / "outputs.npy"),
            u=np.load(directory / "inputs.npy"),
        )

    def span(self, first, count):
        """`count` samples from `first`, counted on over the record's end."""
        k = np.arange(first, first + count) % len(self.z)
        return self.z[k], self.u[k]
