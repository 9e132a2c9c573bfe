"""Find why an FMU disagrees with measured records.

    pip install "./python[fmu]"
    python examples/python/why_does_my_fmu_disagree.py

The FMU is a stage of 2 kg on a spring. The real stage is heavier, and its guide has friction. The cells can be run in a
notebook unchanged.
"""

# %% Build the FMU. Yours comes from Simulink, Dymola, OpenModelica, ...
import sys
import tempfile
from pathlib import Path

import numpy as np

from plid import gap

try:
    from pythonfmu.builder import FmuBuilder
except ImportError:
    print("SKIPPED: pythonfmu is not installed, so there is no FMU: pip install pythonfmu")
    sys.exit()

RATE = 100.0  # samples per second
STAGE = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Stage(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.force = self.position = self.velocity = 0.0
        self.mass, self.stiffness = 2.0, 400.0
        self.register_variable(Real("force", causality=Fmi2Causality.input))
        self.register_variable(Real("position", causality=Fmi2Causality.output))
        self.register_variable(Real("velocity", causality=Fmi2Causality.local))
        number = dict(causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        self.register_variable(Real("mass", **number))
        self.register_variable(Real("stiffness", **number))

    def do_step(self, time, step):
        self.velocity += step * (self.force - self.stiffness * self.position - 8.0 * self.velocity) / self.mass
        self.position += step * self.velocity
        return True
'''
folder = Path(tempfile.mkdtemp())
(folder / "stage.py").write_text(STAGE)
FmuBuilder.build_FMU(folder / "stage.py", dest=folder)

# %% Open it, and name the parameters that may be wrong and the place where a force may act.
# ANCHOR: open
port = gap.FmuPort("guide", force="force", displacement="position", velocity="velocity")
simulator = gap.from_fmu(
    folder / "Stage.fmu",
    rate=RATE,
    parameters={"mass": gap.Parameter(np.nan, lower=0.1), "stiffness": None},
    ports=[port],
    steps_per_sample=4,
)
# ANCHOR_END: open


# %% Measure. Here the real stage is simulated, with a mass of 2.3 kg and a friction of 1 N.
def record(seed: int, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the command and the measured position."""
    random = np.random.default_rng(seed)
    u = level * np.repeat(random.standard_normal((60, 1)), 8, axis=0)
    position, velocity, dt = 0.0, 0.0, 0.025 / RATE
    y = np.empty_like(u)
    for k, force in enumerate(u[:, 0]):
        y[k] = position
        for _ in range(40):
            friction = np.tanh(velocity / 1e-3)
            velocity += dt * (force - friction - 400.0 * position - 8.0 * velocity) / 2.3
            position += dt * velocity
    return u, y + 2e-5 * random.standard_normal(y.shape)


records = [record(1, 4.0), record(2, 8.0), record(3, 8.0), record(4, 0.0)]

# %% Ask why they disagree.
# ANCHOR: diagnose
diagnosis = gap.diagnose(records, simulator=simulator, rate=RATE)
print(diagnosis)
# ANCHOR_END: diagnose

# %% Predict a record that the diagnosis has not seen.
u, y = record(5, 8.0)
as_given = simulator.run(np.array([p.value for p in simulator.parameters.values()]), u)
for name, simulated in (("as given", as_given), ("with what was found", diagnosis.predict(u))):
    print(f"gap on a new record, {name}: {100 * (simulated - y).std() / y.std():.1f} %")
