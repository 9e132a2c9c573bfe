"""Measure what a step of a Python simulator costs in addition to the simulator's own work.

    python python/bench/step.py

The first column is a loop of Python that calls `step` itself with arrays that exist already. The second is the loop of
the diagnosis, which makes the arrays and reads the answer.
"""

import statistics
import time
from typing import Any

import numpy as np

from plid import gap

SAMPLES, ROUNDS = 100_000, 9


class Tuples:
    """The least that a simulator can do."""

    def start(self) -> list[tuple[float, float]]:
        return [(0.0, 0.0)]

    def step(self, u: Any, forces: Any) -> Any:
        return (0.0,), ((0.0, 0.0),)


class Arrays:
    """The same with arrays."""

    def start(self) -> Any:
        self.y, self.motions = np.zeros(1), np.zeros((1, 2))
        return self.motions

    def step(self, u: Any, forces: Any) -> Any:
        return self.y, self.motions


def median(work: Any) -> float:
    """Return the median time of a step in µs."""
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return 1e6 * statistics.median(times) / SAMPLES


def main() -> None:
    print(f"{'answers':10}{'own loop':>12}{'diagnosis':>12}{'overhead':>12}   µs a step, median of {ROUNDS}")
    for plant in (Tuples(), Arrays()):
        simulator = gap.Simulator(
            plant, rate=100.0, inputs=["u"], outputs=["y"], ports=["joint"], name=type(plant).__name__
        )
        u, forces = np.zeros((SAMPLES, 1)), np.zeros(1)

        def alone(plant: Any = plant, u: Any = u, forces: Any = forces) -> None:
            plant.start()
            step = plant.step
            for now in u:
                step(now, forces)

        own = median(alone)
        looped = median(lambda simulator=simulator, u=u: simulator.run(np.zeros(0), u))
        print(f"{simulator.name:10}{own:12.2f}{looped:12.2f}{looped - own:12.2f}")


if __name__ == "__main__":
    main()
