"""Identify a small truss from noisy records and draw its frequency response with its uncertainty.

    pip install ./python matplotlib
    python examples/python/identify_a_truss.py truss.png

A chain of four masses represents the truss. It is shaken at both ends, and a sensor at each end shows the velocity.
"""

import sys

import numpy as np

import plid

RATE = 200.0  # samples per second


def truss() -> plid.Model:
    """Return the truth: four masses between springs, and the velocities of its ends at the samples."""
    from scipy.signal import cont2discrete

    n, mass, spring, damping = 4, 1.0, 8000.0, 2.0
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    drive = np.eye(n)[:, [0, n - 1]] / mass
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-spring / mass * chain, -damping / mass * chain]])
    b = np.vstack([np.zeros((n, 2)), drive])
    # Sensors measure the velocity of the ends, so there is no direct feedthrough.
    c = np.hstack([np.zeros((2, n)), np.eye(n)[[0, n - 1]]])
    matrices = cont2discrete((a, b, c, np.zeros((2, 2))), 1.0 / RATE)[:4]
    return plid.Model.of_matrices(*matrices, rate=RATE)


def main(picture: str) -> None:
    """Measure, identify, print and draw."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    random = np.random.default_rng(1)
    truth = truss()
    u = random.standard_normal((4000, 2))
    clean = truth.simulate(u)
    y = clean + 0.02 * clean.std() * random.standard_normal(clean.shape)

    # ANCHOR: identify
    model = plid.identify(u, y, rate=RATE)
    print(model)
    for found, true in zip(model.modes(), truth.modes(), strict=True):
        print(f"{found.hz:8.4f} ± {found.hz_std:.4f} Hz (true {true.hz:8.4f}), damping {found.damping:.4f}")
    # ANCHOR_END: identify

    hz = np.linspace(1.0, 0.5 * RATE, 600)
    found, true = model.frequency_response(hz), truth.frequency_response(hz)
    size, std = abs(found.response[:, 0, 0]), found.magnitude_std[:, 0, 0]
    _, axes = pyplot.subplots(figsize=(8, 4), layout="constrained")
    axes.fill_between(hz, np.maximum(size - 2 * std, 1e-9), size + 2 * std, alpha=0.3, label="± 2 standard deviations")
    axes.semilogy(hz, size, label="identified")
    axes.semilogy(hz, abs(true.response[:, 0, 0]), "--", label="true")
    axes.set(xlabel="frequency, Hz", ylabel="first sensor over first shaker", ylim=(1e-4, None))
    axes.legend()
    pyplot.savefig(picture)
    print(f"wrote {picture}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "truss.png")
