"""Diagnoses with simulators of Python in the loop. The truths have effects that the simulators lack."""

import re
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import StateSpace, cont2discrete, lfilter

import plid
from plid import gap

RATE = 100.0
# A stage of 2 kg with a spring and a damper: force in N to position in m, held over each sample.
A, B = np.array([[0.0, 1.0], [-200.0, -4.0]]), np.array([[0.0], [0.5]])
STEP = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), 1.0 / RATE)[:2]


def command(seed, level, samples=1200):
    random = np.random.default_rng(seed)
    steps = np.repeat(random.standard_normal(samples // 8), 8)
    return level * lfilter([0.4], [1.0, -0.6], steps)


def stage(u, gain=1.0):
    """Simulate the stage without friction."""
    a, b = STEP
    x, y = np.zeros(2), np.empty((len(u), 1))
    for k, force in enumerate(np.ravel(u)):
        y[k] = x[0]
        x = a @ x + b[:, 0] * gain * force
    return y


class Stage:
    """The same, step by step, with a port at the stage."""

    def start(self):
        self.x = np.zeros(2)

    def step(self, u, forces):
        a, b = STEP
        y = self.x[:1]
        self.x = a @ self.x + b[:, 0] * (u[0] + forces[0])
        return y, self.x


def measured(truth, levels=(4.0, 8.0, 8.0, 0.0)):
    """Return records of a truth with noise."""
    records = []
    for k, level in enumerate(levels):
        u = command(k, level)[:, None]
        y = truth(u)
        records.append((u, y + 1e-4 * np.random.default_rng(50 + k).standard_normal(y.shape)))
    return records


def first(diagnosis):
    return (diagnosis.effects[0].effect, diagnosis.effects[0].location) if diagnosis.effects else None


@pytest.fixture(scope="module")
def saturated():
    return gap.diagnose(measured(lambda u: stage(6.0 * np.tanh(u / 6.0))), simulator=stage, rate=RATE, progress=False)


def test_a_saturated_command_is_named(saturated):
    assert first(saturated) == ("actuator-saturation", "input:u1")
    assert saturated.verdict == "effects" and saturated.gap["shrink"] > 0.8
    assert "actuator-saturation" in str(saturated) and saturated.sentence in repr(saturated)
    assert sum(one["probability"] for one in saturated.candidates) == pytest.approx(1.0, abs=1e-6)


def test_a_prediction_has_the_effect(saturated):
    u = command(9, 8.0)[:, None]
    truth = stage(6.0 * np.tanh(u / 6.0))
    found = saturated.predict(u)
    assert np.std(found - truth) < 0.2 * np.std(stage(u) - truth)
    with pytest.raises(ValueError, match=r"u has the shape \(5, 2\)"):
        saturated.predict(np.zeros((5, 2)))


def test_a_prediction_beyond_what_was_fitted_warns(saturated):
    u = command(9, 8.0)[:, None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        saturated.predict(0.5 * u)
    with pytest.warns(UserWarning, match=r"extrapolation: input `u1` is \d+\.\d times that of the fitted"):
        saturated.predict(4.0 * u)


def test_a_report_is_written(saturated, tmp_path):
    page = saturated.report(tmp_path / "out")
    assert saturated.sentence[:30] in page.read_text()
    assert {path.name for path in page.parent.iterdir()} == {"report.html", "diagnosis.json", "sim-with-effect.json"}


def test_a_report_may_be_one_page(saturated, tmp_path):
    page = saturated.report(tmp_path / "gap.html")
    assert page == tmp_path / "gap.html" and list(tmp_path.iterdir()) == [page]
    text = page.read_text()
    assert text == saturated.report(tmp_path / "out").read_text() and text.endswith("</html>")
    # Nothing is loaded from elsewhere.
    assert "<svg" in text and not re.search(r"<(script|link|img|iframe)\b|url\((?!#)|@import", text)
    with pytest.raises(OSError, match="missing.gap.HTML"):
        saturated.report(tmp_path / "missing" / "gap.HTML")
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(OSError, match="folder.html"):
        saturated.report(tmp_path / "folder.html")
    assert {path.name for path in tmp_path.iterdir()} == {"gap.html", "out", "folder.html"}


def test_a_notebook_shows_the_answer(saturated):
    shown = saturated._repr_html_()
    assert "actuator-saturation at input:u1" in shown and "<table>" in shown and "&" not in saturated.sentence


def test_nothing_is_named_where_nothing_is_missing():
    diagnosis = gap.diagnose(measured(stage), simulator=stage, rate=RATE, progress=False)
    assert diagnosis.verdict == "none" and diagnosis.effects == []


def test_friction_is_named_at_its_port():
    def rubbed(u):
        fine = 40
        h = 1.0 / (RATE * fine)
        x, y = np.zeros(2), np.empty((len(u), 1))
        for k, force in enumerate(u[:, 0]):
            y[k] = x[0]
            for _ in range(fine):
                v = x[1] + h * (A[1] @ x + 0.5 * (force - 1.5 * np.tanh(x[1] / 0.002)))
                x = np.array([x[0] + h * v, v])
        return y

    port = gap.Port("stage", input="force", force_unit="N", displacement_unit="m")
    simulator = gap.Simulator(Stage(), rate=RATE, inputs=["force"], outputs={"x": "position"}, ports=[port])
    lines = []
    diagnosis = gap.diagnose(measured(rubbed), simulator=simulator, rate=RATE, progress=lines.append)
    assert first(diagnosis)[0] == "coulomb-friction" and lines
    force = next(iter(diagnosis.effects[0].parameters.values()))
    assert 1.0 < force["value"] < 2.0
    u = measured(rubbed)[1][0]
    assert_allclose(diagnosis.predict(u), rubbed(u), atol=1e-3)
    with pytest.warns(UserWarning, match=r"extrapolation: .* is \d+\.\d times that of the fitted records"):
        diagnosis.predict(3.0 * u)


@pytest.mark.parametrize(("bound", "key"), [({"calls": 40}, "calls"), ({"seconds": 1.0}, "seconds")])
def test_a_bounded_search_says_what_it_left_out(bound, key):
    def slow(u):
        time.sleep(0.02)
        return stage(u)

    records = measured(lambda u: stage(6.0 * np.tanh(u / 6.0)))
    settings = {"in_loop": {"model_states": 0}}
    diagnosis = gap.diagnose(records, simulator=slow, rate=RATE, progress=False, settings=settings, **bound)
    used = diagnosis.data["simulator"]
    assert used["cut_short"] and used["ended_by"] == key and used["left_out"]
    assert any(f"`{key}` = {bound[key]:g}) ended the search early. Left out: " in said for said in diagnosis.warnings)
    assert used["runs"] <= 40 if key == "calls" else used["seconds"] < 1.5


def test_a_wrong_parameter_is_named():
    diagnosis = gap.diagnose(
        measured(lambda u: stage(u, 1.3)),
        simulator=lambda u, parameters: stage(u, parameters["gain"]),
        rate=RATE,
        parameters={"gain": gap.Parameter(1.0, lower=0.0)},
        progress=False,
    )
    # A gain of the simulator and one of its command are the same thing.
    effects = {name for one in diagnosis.candidates for name in [e["effect"] for e in one["effects"]]}
    assert "simulator-parameter" in effects
    assert_allclose(diagnosis.predict(command(9, 8.0)[:, None]), stage(command(9, 8.0), 1.3), atol=5e-4)


def test_a_system_is_a_simulator():
    system = StateSpace(A, B, [[1.0, 0.0]], [[0.0]])
    simulator = gap.from_system(system, rate=RATE)
    u = command(3, 5.0)[:, None]
    assert_allclose(simulator.run(np.zeros(0), u), stage(u), atol=1e-12)
    model = plid.Model.of_matrices(*STEP, [[1.0, 0.0]], rate=RATE)
    assert_allclose(gap.from_system(model, rate=RATE).run(np.zeros(0), u), stage(u), atol=1e-12)
    with pytest.raises(ValueError, match="sample rate of 100 Hz, the records 50 Hz"):
        gap.from_system(model, rate=50.0)


def test_a_linear_simulator_is_diagnosed_by_its_model(tmp_path):
    """The model gives the same answer as the simulator in the loop, and predicts without the simulator."""
    records = measured(lambda u: stage(u, 1.3))
    calls = []

    def simulator(u):
        calls.append(len(u))
        return stage(u)

    by_model = gap.diagnose(records, simulator=simulator, rate=RATE, progress=False)
    assert by_model.data["simulator"]["runs"] == len(calls) < 10
    assert any("model of 2 states" in sentence for sentence in by_model.data["evidence"])
    in_loop = gap.diagnose(
        records, simulator=stage, rate=RATE, progress=False, settings={"in_loop": {"model_states": 0}}
    )
    # With one input and one output, the two gains are the same thing.
    gains = {("actuator-gain", "input:u1"), ("sensor-gain", "output:y1")}
    assert first(by_model) in gains and first(in_loop) in gains
    fresh = command(9, 8.0)[:, None]
    calls.clear()
    assert_allclose(by_model.predict(fresh), stage(fresh, 1.3), atol=5e-4)
    assert calls == []
    assert "model of 2 states" in by_model.report(tmp_path).read_text()


def test_a_system_of_python_control_is_a_simulator():
    control = pytest.importorskip("control", reason="python-control is not installed")
    system = control.tf([0.5], [1.0, 4.0, 200.0], inputs=["force"], outputs=["x"])
    simulator = gap.from_system(system, rate=RATE)
    u = command(3, 5.0)[:, None]
    assert (simulator.inputs, simulator.outputs) == (["force"], ["x"])
    assert_allclose(simulator.run(np.zeros(0), u), stage(u), atol=1e-10)


def test_what_the_simulator_raises_is_the_cause():
    def broken(u):
        raise LookupError("no licence")

    with pytest.raises(RuntimeError, match="no licence") as caught:
        gap.diagnose(measured(stage), simulator=broken, rate=RATE, progress=False)
    assert isinstance(caught.value.__cause__, LookupError)


def test_a_wrong_answer_of_the_simulator_is_named():
    with pytest.raises(RuntimeError, match=r"returned the shape \(\d+, 1\), expected \(\d+, 1\)"):
        gap.diagnose(measured(stage), simulator=lambda u: stage(u)[1:], rate=RATE, progress=False)
    with pytest.raises(RuntimeError, match="NaN for output \"y1\" at sample 0"):
        gap.diagnose(measured(stage), simulator=lambda u: stage(u) * np.nan, rate=RATE, progress=False)


@pytest.mark.parametrize("stepping", [False, True])
def test_a_call_that_hangs_is_ended(stepping):
    class Hanging:
        def start(self):
            self.steps = 0

        def step(self, u, forces):
            self.steps += 1
            while self.steps > 50:
                pass
            return (0.0,)

    def hanging(u):
        while True:
            pass

    simulator = gap.Simulator(
        Hanging() if stepping else hanging, rate=RATE, inputs=["force"], outputs=["x"], name="stage", patience=0.3
    )
    began = time.monotonic()
    with pytest.raises(RuntimeError, match="stage has not returned within 0.3 s") as caught:
        gap.diagnose(measured(stage), simulator=simulator, rate=RATE, progress=False)
    assert isinstance(caught.value.__cause__, TimeoutError)
    assert time.monotonic() - began < 10
    # The exception has reached the call and nothing else.
    assert sum(range(100_000)) == 4_999_950_000


def test_a_slow_call_within_its_patience_is_no_fault():
    def slow(u):
        until = time.monotonic() + 0.05
        while time.monotonic() < until:
            pass
        return stage(u)

    simulator = gap.Simulator(slow, rate=RATE, inputs=["force"], outputs=["x"], patience=1.0)
    u = measured(stage)[0][0]
    first = simulator.run(np.zeros(0), u)
    assert np.array_equal(first[:, 0], np.ravel(stage(u)))
    diagnosis = gap.diagnose(measured(stage), simulator=simulator, rate=RATE, progress=False)
    assert diagnosis.verdict == "none"


def test_records_that_do_not_fit_are_named():
    u, y = measured(stage)[0]
    simulator = gap.Simulator(stage, rate=RATE, inputs=["force"], outputs=["x"])
    with pytest.raises(ValueError, match=r"records\[1\].u has the shape \(1200, 2\)"):
        gap.diagnose([(u, y), (np.c_[u, u], y)], simulator=simulator, rate=RATE)
    with pytest.raises(ValueError, match=r"records\[0\] has 1200 rows of u and 1199 of y"):
        gap.diagnose([(u, y[1:])], simulator=simulator, rate=RATE)
    with pytest.raises(ValueError, match="sample_rate_hz"):
        gap.diagnose([(u, y)], simulator=simulator, rate=2 * RATE)
    with pytest.raises(ValueError, match="empty"):
        gap.diagnose([], simulator=simulator, rate=RATE)
    with pytest.raises(ValueError, match="band_hz: 10 to 80"):
        gap.diagnose([(u, y)], simulator=simulator, rate=RATE, band_hz=(10, 80))
    with pytest.raises(ValueError, match="unknown field `in_lop`"):
        gap.diagnose([(u, y)], simulator=simulator, rate=RATE, settings={"in_lop": {}})
    with pytest.raises(TypeError, match="neither a function"):
        gap.diagnose([(u, y)], simulator=3, rate=RATE)


def test_columns_of_a_data_frame_are_those_of_the_simulator():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    u, y = measured(stage)[0]
    simulator = gap.Simulator(stage, rate=RATE, inputs=["force"], outputs=["x"])
    frame = pandas.DataFrame(y, columns=["z"])
    with pytest.raises(ValueError, match=r"records\[0\].y has the columns \['z'\], the simulator has \['x'\]"):
        gap.diagnose([(u, frame)], simulator=simulator, rate=RATE)


def files(folder, u, y):
    """Write a record in each format; return the files and the names of its channels."""
    pandas, io = pytest.importorskip("pandas"), pytest.importorskip("scipy.io")
    pandas.DataFrame({"force": u[:, 0], "x": y[:, 0]}).to_csv(folder / "r.csv", index=False)
    io.savemat(folder / "r.mat", {"force": u, "x": y})
    np.savez(folder / "r.npz", force=u[:, 0], x=y[:, 0])
    return [folder / name for name in ("r.csv", "r.mat", "r.npz")]


def test_records_come_from_arrays_data_frames_and_files(tmp_path):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    given = measured(lambda u: stage(6.0 * np.tanh(u / 6.0)))
    simulator = gap.Simulator(stage, rate=RATE, inputs=["force"], outputs=["x"])
    frames = [(pandas.DataFrame(u, columns=["force"]), pandas.DataFrame(y, columns=["x"])) for u, y in given]
    expected = gap.diagnose(given, simulator=simulator, rate=RATE, progress=False).data
    assert gap.diagnose(frames, simulator=simulator, rate=RATE, progress=False).data["effects"] == expected["effects"]
    for path in files(tmp_path, *given[1]):
        u, y = plid.read(path, inputs=["force"], outputs=["x"])
        assert_allclose(u, given[1][0], rtol=1e-15)
        assert_allclose(y, given[1][1], rtol=1e-15)
    with pytest.raises(ValueError, match="did you mean `force`|force"):
        plid.read(tmp_path / "r.csv", inputs=["forc"], outputs=["x"])
    with pytest.raises(OSError, match="missing.csv"):
        plid.read(tmp_path / "missing.csv", inputs=["force"], outputs=["x"])


def test_a_period_shows_the_noise():
    u = np.tile(command(3, 8.0, 400), 4)[:, None]
    noise = 2e-3 * np.random.default_rng(4).standard_normal((1600, 1))
    simulator = gap.Simulator(stage, rate=RATE, inputs=["force"], outputs=["x"])

    def diagnosed(**said):
        truth = stage(6.0 * np.tanh(u / 6.0)) + noise
        settings = {"in_loop": {"model_states": 0}}
        records = [gap.Record(u, truth, **said)] * 2
        return gap.diagnose(records, simulator=simulator, rate=RATE, settings=settings, progress=False)

    unseen, seen = "no record without input and no repeated input shows the noise", diagnosed(period=400)
    assert not any(unseen in warning for warning in seen.warnings)
    expected = 2e-3 / np.sqrt(np.mean(stage(6.0 * np.tanh(u / 6.0)) ** 2))
    assert seen.gap["noise_floor"] == pytest.approx(expected, rel=0.3)
    # Left out, the period is found; unsaid, nothing repeats.
    assert any("repeat after 400 samples" in warning for warning in diagnosed(excitation="periodic").warnings)
    with pytest.raises(ValueError, match="does not repeat after 390 samples.*period that fits is 400"):
        diagnosed(period=390)
    with pytest.raises(ValueError, match="only a periodic record has a period"):
        diagnosed(period=400, excitation="random")


class Kept(Stage):
    """A stage that keeps states."""

    def save(self):
        return self.x.copy()

    def restore(self, state):
        self.x = state.copy()
        return self.x


def test_the_checker_tells_what_a_simulator_does_not_honour():
    options = {"rate": RATE, "inputs": ["force"], "outputs": ["x"], "ports": ["stage"]}
    findings = gap.check(gap.Simulator(Kept(), **options))
    assert all(finding.holds for finding in findings) and "states" in [finding.what for finding in findings]
    assert "states" not in [finding.what for finding in gap.check(gap.Simulator(Stage(), **options))]
    forgetful = Kept()
    forgetful.restore = lambda state: forgetful.x
    wrong = [finding.what for finding in gap.check(gap.Simulator(forgetful, **options)) if not finding.holds]
    assert wrong == ["states"]


SLOW = """
import time, numpy as np
from plid import gap
def slow(u):
    print("runs", flush=True)
    time.sleep(0.2)
    return np.cumsum(u, axis=0)
u = np.random.default_rng(0).standard_normal((800, 1))
try:
    gap.diagnose([(u, np.cumsum(np.tanh(u), axis=0))], simulator=slow, rate=100.0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


# Runs that take a while, and one that never ends.
@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGINT between processes")
@pytest.mark.parametrize("wait", ["time.sleep(0.2)", "while True: pass"])
def test_ctrl_c_ends_a_diagnosis(wait):
    text = SLOW.replace("time.sleep(0.2)", wait)
    process = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "runs\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=20)
        assert rest.endswith("interrupted\n") and rest.count("runs") < 10
    finally:
        process.kill()
