"""An FMU as a simulator. The FMUs are built by pythonfmu; FMPy is another importer of them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from plid import gap

builder = pytest.importorskip("pythonfmu.builder", reason="pythonfmu is not installed")

RATE = 100.0
STEPS = 2

# The arithmetic of the plant, for the FMU, for an object and for a program.
PLANT = """
class Plant:
    def begin(self, mass=2.0, stiffness=200.0):
        self.mass, self.stiffness, self.x, self.v = mass, stiffness, 0.0, 0.0

    def advance(self, force, h):
        self.v += h * (force - self.stiffness * self.x - 4.0 * self.v) / self.mass
        self.x += h * self.v
"""

FMU = PLANT + """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Stage(Fmi2Slave, Plant):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.begin()
        self.force = 0.0
        self.register_variable(Real("force", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Real("v", causality=Fmi2Causality.local))
        fixed = dict(causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        self.register_variable(Real("mass", **fixed))
        self.register_variable(Real("stiffness", **fixed))

    def do_step(self, time, step):
        if self.mass > 50.0:
            raise ValueError("the mass fell off")
        self.advance(self.force, step)
        return True
"""

PROGRAM = PLANT + f"""
from plid_simulator import serve

class Stage(Plant):
    description = {{
        "name": "stage", "rate_hz": {RATE}, "steps_per_sample": {STEPS}, "inputs": [{{"name": "force"}}],
        "outputs": [{{"name": "x"}}], "ports": [{{"name": "stage", "input": "force"}}],
        "parameters": [{{"name": "mass", "value": 2.0}}, {{"name": "stiffness", "value": 200.0}}],
    }}

    def start(self, parameters):
        self.begin(*parameters)
        return [(self.x, self.v)]

    def step(self, u, forces):
        y = [self.x]
        self.advance(u[0] + forces[0], 1.0 / {RATE * STEPS})
        return y, [(self.x, self.v)]

serve(Stage())
"""

PORT = gap.FmuPort("stage", force="force", displacement="x", velocity="v")

namespace = {}
exec(PLANT, namespace)  # the same lines, in this process


class Stage(namespace["Plant"]):
    """The plant as an object."""

    def start(self, parameters):
        self.begin(**parameters)
        return [(self.x, self.v)]

    def step(self, u, forces):
        y = self.x
        self.advance(u[0] + forces[0], 1.0 / (RATE * STEPS))
        return [y], [(self.x, self.v)]


def in_python():
    """Return the plant as an object."""
    return gap.Simulator(
        Stage(),
        rate=RATE,
        inputs=["force"],
        outputs=["x"],
        parameters={"mass": 2.0, "stiffness": 200.0},
        ports=[gap.Port("stage", "force")],
        steps_per_sample=STEPS,
    )


def measured(mass, friction, level, seed):
    """Return inputs and noisy outputs of a plant, by short steps."""
    random = np.random.default_rng(seed)
    u = level * np.repeat(random.standard_normal(60), 8)
    plant = namespace["Plant"]()
    plant.begin(mass=mass)
    y = np.empty_like(u)
    for k, force in enumerate(u):
        y[k] = plant.x
        for _ in range(40):
            plant.advance(force - friction * np.tanh(plant.v / 1e-3), 1.0 / (40 * RATE))
    return u[:, None], (y + 1e-4 * random.standard_normal(len(y)))[:, None]


def records(mass=2.0, friction=0.0):
    return [measured(mass, friction, level, seed) for seed, level in enumerate((4.0, 8.0, 8.0, 0.0))]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "stage.py").write_text(FMU)
    builder.FmuBuilder.build_FMU(folder / "stage.py", dest=folder)
    return folder / "Stage.fmu"


def opened(fmu, **options):
    options = {"parameters": ["mass", "stiffness"], "ports": [PORT], "steps_per_sample": STEPS} | options
    return gap.from_fmu(fmu, rate=RATE, **options)


def test_the_fmu_is_described(fmu):
    simulator = opened(fmu, parameters={"mass": gap.Parameter(np.nan, lower=0.1, limit=0.2), "stiffness": 210.0})
    assert (simulator.inputs, simulator.outputs, simulator.steps_per_sample) == (["force"], ["x"], STEPS)
    assert simulator.ports == [gap.Port("stage", "force")]
    assert simulator.parameters["mass"] == gap.Parameter(2.0, lower=0.1, limit=0.2)
    assert simulator.parameters["stiffness"].value == 210.0
    bare = gap.from_fmu(str(fmu), rate=RATE)
    assert (bare.steps_per_sample, bare.ports, bare.parameters) == (1, [], {})


def test_it_moves_as_the_plant_does(fmu):
    simulator, plant = opened(fmu), in_python()
    u = np.random.default_rng(3).standard_normal((50, 1))
    for values in ([2.0, 200.0], [3.0, 150.0], [2.0, 200.0]):
        assert_allclose(simulator.run(np.array(values), u), plant.run(np.array(values), u), rtol=0, atol=1e-15)
    # A force at the port does what the input does.
    for one in (simulator, plant):
        one.start(np.array([2.0, 200.0]))
    for force in u:
        (y, motion), (expected, moved) = (one.step(force, 2 * force) for one in (simulator, plant))
        assert_allclose(y, expected, rtol=0, atol=1e-15)
        assert_allclose(motion, moved, rtol=0, atol=1e-15)


def test_another_importer_finds_the_same(fmu):
    fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
    u = np.random.default_rng(4).standard_normal(80)
    time = np.arange(80) / RATE
    rows = np.array(list(zip(time, u, strict=True)), dtype=[("time", float), ("force", float)])
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=79 / RATE,
        step_size=1.0 / RATE,
        output_interval=1.0 / RATE,
        input=rows,
        start_values={"mass": 2.5},
        output=["x"],
        fmi_type="CoSimulation",
    )
    simulator = gap.from_fmu(fmu, rate=RATE, parameters=["mass"])
    assert_allclose(simulator.run(np.array([2.5]), u[:, None])[:, 0], found["x"], rtol=0, atol=1e-12)


def program(folder, data):
    """Diagnose by the program `plid`, with the plant as a command. Return diagnosis.json."""
    plid = os.environ.get("PLID_PROGRAM") or shutil.which("plid")
    if not plid:
        return None
    template = Path(__file__).parents[2] / "examples" / "simulator" / "plid_simulator.py"
    shutil.copy(template, folder)
    (folder / "stage.py").write_text(PROGRAM)
    lines = [f"sample_rate_hz = {RATE}", 'inputs = ["force"]', 'outputs = ["x"]', "[simulator]"]
    lines.append(f"command = {json.dumps([sys.executable, 'stage.py'])}")
    for k, both in enumerate(data):
        np.savetxt(folder / f"r{k}.csv", np.hstack(both), delimiter=",", header="force,x", comments="", fmt="%.17g")
        excitation = "random" if both[0].any() else "zero"
        lines += ["[[record]]", f'file = "r{k}.csv"', f'excitation = "{excitation}"']
    (folder / "case.toml").write_text("\n".join(lines))
    done = subprocess.run(
        [plid, "gap", "diagnose", "case.toml", "--out", "out", "--json"], capture_output=True, text=True, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def same(found, expected, place="diagnosis"):
    """Compare parts of two answers: numbers to 1e-6."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), place
        for key in expected:
            same(found[key], expected[key], f"{place}.{key}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), place
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            same(one, other, f"{place}[{k}]")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6), place
    else:
        assert found == expected, place


@pytest.mark.parametrize(("mass", "friction", "cause"), [(2.4, 0.0, "simulator-parameter"), (2.0, 1.0, "friction")])
def test_the_diagnosis_is_that_of_the_same_plant(fmu, tmp_path, mass, friction, cause):
    data = records(mass, friction)
    by_fmu = gap.diagnose(data, simulator=opened(fmu), rate=RATE, progress=False)
    assert by_fmu.effects and cause in by_fmu.effects[0].effect, by_fmu.sentence
    by_object = gap.diagnose(data, simulator=in_python(), rate=RATE, progress=False)
    for part in ("verdict", "effects", "candidates", "gap", "refit"):
        same(by_fmu.data[part], by_object.data[part], part)
    u, _ = measured(mass, friction, 6.0, 9)
    assert_allclose(by_fmu.predict(u), by_object.predict(u), rtol=0, atol=1e-9)
    by_program = program(tmp_path, data)
    if by_program is None:
        pytest.skip("the program `plid` is neither in PLID_PROGRAM nor on the path")
    assert by_program["verdict"] == by_fmu.verdict
    same(by_program["effects"], by_fmu.data["effects"])
    same(by_program["candidates"], by_fmu.data["candidates"])


def test_what_the_fmu_says_is_in_the_exception(fmu):
    simulator = opened(fmu)
    u = np.ones((10, 1))
    with pytest.raises(RuntimeError, match=r"Stage\.fmu: fmi2DoStep returned .* at 0 s") as raised:
        simulator.run(np.array([99.0, 200.0]), u)
    assert "the mass fell off" in str(raised.value)
    # The next run is sound.
    assert_allclose(simulator.run(np.array([2.0, 200.0]), u), in_python().run(np.array([2.0, 200.0]), u), atol=1e-15)


def test_what_the_fmu_lacks_is_named(fmu, tmp_path):
    with pytest.raises(ValueError, match=r'Stage\.fmu: variable "stifness".*did you mean "stiffness"\?'):
        opened(fmu, parameters=["stifness"])
    with pytest.raises(ValueError, match='variable "w".*would be x, v'):
        opened(fmu, ports=[gap.FmuPort("stage", "force", "x", "w")])
    with pytest.raises(TypeError, match="parameters is a str"):
        opened(fmu, parameters="mass")
    with pytest.raises(OSError, match=r"none\.fmu"):
        gap.from_fmu(tmp_path / "none.fmu", rate=RATE)
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(ValueError, match="not a valid ZIP archive"):
        gap.from_fmu(tmp_path / "text.fmu", rate=RATE)
    with pytest.raises(ValueError, match="1 parameters are given, expected 2"):
        opened(fmu).run(np.array([2.0]), np.ones((3, 1)))
    with pytest.raises(ValueError, match="u has 2 columns, expected 1"):
        opened(fmu).run(np.array([2.0, 200.0]), np.ones((3, 2)))
