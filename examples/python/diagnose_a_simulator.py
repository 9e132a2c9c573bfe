"""Find what a simulator lacks, with the simulator in the loop.

    pip install ./python
    python examples/python/diagnose_a_simulator.py out/gap

The simulator is a function that simulates a stage on a spring. It lacks the limit of the amplifier, which the records
of the real stage show.
"""

import sys

import numpy as np

from plid import gap

RATE = 100.0  # samples per second


# ANCHOR: simulator
def stage(u: np.ndarray) -> np.ndarray:
    """Simulate the position of 2 kg on a spring (400 N/m) with a damper (8 N s/m), from the force."""
    dt, position, velocity = 1.0 / RATE, 0.0, 0.0
    y = np.empty((len(u), 1))
    for k, force in enumerate(u[:, 0]):
        y[k] = position
        for _ in range(10):
            velocity += 0.1 * dt * (force - 400.0 * position - 8.0 * velocity) / 2.0
            position += 0.1 * dt * velocity
    return y
# ANCHOR_END: simulator


def record(seed: int, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Measure the real stage, whose amplifier gives no more than about 6 N."""
    random = np.random.default_rng(seed)
    u = level * np.repeat(random.standard_normal((150, 1)), 8, axis=0)
    y = stage(6.0 * np.tanh(u / 6.0))
    return u, y + 1e-4 * random.standard_normal(y.shape)


def main(folder: str) -> None:
    """Diagnose, print, predict and report."""
    # ANCHOR: diagnose
    records = [record(1, 4.0), record(2, 8.0), record(3, 8.0), record(4, 0.0)]
    diagnosis = gap.diagnose(records, simulator=stage, rate=RATE)
    print(diagnosis)
    u, y = record(5, 8.0)
    for name, simulated in (("as given", stage(u)), ("with the effect", diagnosis.predict(u))):
        print(f"gap on a new record, {name}: {100 * (simulated - y).std() / y.std():.1f} %")
    print("report:", diagnosis.report(folder))
    # ANCHOR_END: diagnose


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "gap")
