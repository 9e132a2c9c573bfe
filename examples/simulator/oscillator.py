"""A mass on a spring and a damper, as a simulator for plid: `plid gap check-simulator -- python3 oscillator.py`."""

from plid_simulator import serve


class Oscillator:
    """m x'' = u + f - c x' - k x, by the symplectic Euler method with ten steps per sample."""

    STEPS = 10
    description = {
        "name": "oscillator",
        "rate_hz": 100.0,
        "steps_per_sample": STEPS,
        "states": True,
        "inputs": [{"name": "force", "unit": "N"}],
        "outputs": [{"name": "position", "kind": "position", "unit": "m"}],
        "ports": [{"name": "spring", "input": "force", "force_unit": "N", "displacement_unit": "m"}],
        "parameters": [
            {"name": "stiffness", "value": 800.0, "unit": "N/m", "lower": 0.0},
            {"name": "damping", "value": 4.0, "unit": "N s/m", "lower": 0.0},
        ],
    }

    def start(self, parameters):
        self.stiffness, self.damping = parameters
        self.x, self.v, self.kept = 0.0, 0.0, {}
        return [(self.x, self.v)]

    def save(self, slot):
        self.kept[slot] = self.x, self.v

    def restore(self, slot):
        self.x, self.v = self.kept[slot]
        return [(self.x, self.v)]

    def step(self, u, forces):
        y = [self.x]
        h, mass = 1.0 / (self.description["rate_hz"] * self.STEPS), 2.0
        self.v += h * (u[0] + forces[0] - self.damping * self.v - self.stiffness * self.x) / mass
        self.x += h * self.v
        return y, [(self.x, self.v)]


if __name__ == "__main__":
    serve(Oscillator())
