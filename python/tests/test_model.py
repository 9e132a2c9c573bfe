"""Models: analysis, conversions and files."""

import json
import os
import pickle
import runpy
import shutil
import subprocess

import numpy as np
import pytest
from conftest import RATE, plant, record
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat, savemat
from scipy.linalg import solve_discrete_are
from scipy.signal import dlsim

import plid


@pytest.fixture
def exact():
    return plid.Model.of_matrices(*plant(), rate=RATE)


def test_a_simulation_agrees_with_scipy(exact):
    u = np.random.default_rng(2).standard_normal((300, 2))
    expected = dlsim(exact.to_scipy(), u)[1]
    assert_allclose(exact.simulate(u), expected, rtol=0, atol=1e-12)


def test_a_state_begins_a_simulation(exact):
    a, _, c, _ = plant()
    state = np.array([1.0, -1.0, 0.5, 2.0])
    found = exact.simulate(np.zeros((3, 2)), state=state)
    assert_allclose(found, [c @ state, c @ a @ state, c @ a @ a @ state], atol=1e-14)


def test_modes_are_those_of_the_closed_form(exact):
    for mode, (radius, angle) in zip(exact.modes(), ((0.97, 0.6), (0.95, 1.3)), strict=True):
        s = RATE * (np.log(radius) + 1j * angle)
        assert_allclose([mode.hz, mode.damping], [abs(s) / 2 / np.pi, -s.real / abs(s)], rtol=1e-12)
        assert_allclose(mode.pole, radius * np.exp(1j * angle), rtol=1e-12)
        assert mode.hz_std is None and mode.damping_std is None


def test_a_model_of_python_control_has_names_and_the_same_response(model):
    control = pytest.importorskip("control", reason="python-control is not installed")
    other = model.to_control()
    assert isinstance(other, control.StateSpace) and other.input_labels == model.inputs
    hz = np.array([1.0, 7.0])
    expected = np.moveaxis(other(np.exp(2j * np.pi * hz / RATE)), -1, 0)
    assert_allclose(model.frequency_response(hz).response, expected, rtol=1e-9)


@pytest.mark.parametrize("ending", [".json", ".npz", ".mat"])
def test_files_keep_every_bit(model, tmp_path, ending):
    path = tmp_path / f"model{ending}"
    model.save(path)
    found = plid.Model.load(path)
    for name in "ABCD":
        assert_array_equal(getattr(found, name), getattr(model, name))
    assert_array_equal(found.parameter_covariance, model.parameter_covariance)
    assert (found.rate, found.inputs, found.outputs) == (model.rate, model.inputs, model.outputs)
    assert found.provenance == model.provenance
    assert [m.hz_std for m in found.modes()] == [m.hz_std for m in model.modes()]


def test_a_model_of_one_state_survives_matlab(tmp_path):
    one = plid.Model.of_matrices([[0.5]], [[1.0]], [[2.0]], rate=10.0)
    one.save(tmp_path / "one.mat")
    assert_array_equal(plid.Model.load(tmp_path / "one.mat").C, [[2.0]])


def test_a_mat_file_without_names_is_read(tmp_path):
    a, b, c, d = plant()
    savemat(tmp_path / "own.mat", dict(A=a, B=b, C=c, D=d, sample_rate_hz=RATE))
    assert plid.Model.load(tmp_path / "own.mat").inputs == ["u1", "u2"]
    assert "A" in loadmat(tmp_path / "own.mat")
    savemat(tmp_path / "not.mat", dict(A=a))
    with pytest.raises(ValueError, match="no 'B'"):
        plid.Model.load(tmp_path / "not.mat")


def test_a_pickle_is_the_same_model(model):
    assert_array_equal(pickle.loads(pickle.dumps(model)).A, model.A)


def test_the_program_reads_the_model_and_simulates_the_same(model, data, tmp_path):
    """The Rust program simulates the same record from the same model.json."""
    program = os.environ.get("PLID_PROGRAM") or shutil.which("plid")
    if not program:
        pytest.skip("the program `plid` is neither in PLID_PROGRAM nor on the path")
    u, _ = data
    model.save(tmp_path / "model.json")
    deviations = u - model.operating_point[0]
    header = ",".join(model.inputs)
    np.savetxt(tmp_path / "u.csv", deviations, delimiter=",", header=header, comments="", fmt="%.17g")
    files = ["--model", tmp_path / "model.json", "--input", tmp_path / "u.csv", "--out", tmp_path / "y.csv"]
    done = subprocess.run([program, "simulate", *files], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    expected = np.genfromtxt(tmp_path / "y.csv", delimiter=",", names=True)
    found = model.simulate(u) - model.operating_point[1]
    for k, name in enumerate(model.outputs):
        assert_allclose(found[:, k], expected[name], rtol=0, atol=1e-12)


def test_what_the_program_exports_is_the_same_model(model, tmp_path):
    """The .mat and .npz of `plid export` are read by SciPy, NumPy and plid; the .py simulates by itself."""
    program = os.environ.get("PLID_PROGRAM") or shutil.which("plid")
    if not program:
        pytest.skip("the program `plid` is neither in PLID_PROGRAM nor on the path")
    model.save(tmp_path / "model.json")
    keys = json.loads((tmp_path / "model.json").read_text())
    keys["outputs"][0] = "Höhe"
    (tmp_path / "model.json").write_text(json.dumps(keys))
    for ending in ("mat", "npz", "py"):
        to = tmp_path / f"exported.{ending}"
        done = subprocess.run([program, "export", tmp_path / "model.json", "--to", to], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    read = [loadmat(tmp_path / "exported.mat"), np.load(tmp_path / "exported.npz")]
    for found in read:
        for name in "ABCD":
            assert_array_equal(found[name], getattr(model, name))
    for ending in ("mat", "npz"):
        found = plid.Model.load(tmp_path / f"exported.{ending}")
        assert found.outputs[0] == "Höhe" and found.provenance == model.provenance
        assert_array_equal(found.B, model.B)
    module = runpy.run_path(str(tmp_path / "exported.py"))
    u = np.random.default_rng(3).standard_normal((50, 2))
    assert_array_equal(module["A"], model.A)
    assert_allclose(module["simulate"](u), dlsim(model.to_scipy(), u)[1], rtol=0, atol=1e-12)
    assert module["outputs"] == keys["outputs"] and module["to_scipy"]().dt == pytest.approx(1 / RATE)


def test_a_predictor_gain_is_used(exact, tmp_path):
    exact.save(tmp_path / "model.json")
    keys = json.loads((tmp_path / "model.json").read_text())
    gain = np.arange(8.0).reshape(4, 2) / 50.0
    keys["predictor_gain"] = gain.tolist()
    (tmp_path / "model.json").write_text(json.dumps(keys))
    model = plid.Model.load(tmp_path / "model.json")
    assert_array_equal(model.predictor_gain, gain)
    a, b, c, _ = plant()
    random = np.random.default_rng(5)
    u, y = random.standard_normal((40, 2)), random.standard_normal((40, 2))
    expected, x = [], np.zeros(4)
    for u_k, y_k in zip(u, y, strict=True):
        expected.append(c @ x)
        x = a @ x + b @ u_k + gain @ (y_k - c @ x)
    assert_allclose(model.predict(u, y), expected, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="predictor_gain"):
        exact.predict(u, y)


def disturbed(samples, seed):
    """Return C, inputs, and outputs of the plant with disturbed states and noise, and the covariances of both.

    The second output has a unit in which it is a thousand times as large.
    """
    a, b, c, _ = plant()
    c = np.diag([1.0, 1e3]) @ c
    process, sensor = 0.1 * np.ones(4), np.array([0.1, 200.0])
    random = np.random.default_rng(seed)
    u, x, y = random.standard_normal((samples, 2)), np.zeros(4), np.empty((samples, 2))
    for k, u_k in enumerate(u):
        y[k] = c @ x + sensor * random.standard_normal(2)
        x = a @ x + b @ u_k + process * random.standard_normal(4)
    return c, u, y, np.diag(process**2), np.diag(sensor**2)


def test_the_predictor_gain_is_that_of_kalman():
    a, b, _, d = plant()
    c, u, y, process, sensor = disturbed(6000, 8)
    # The steady state of the covariance of a predicted state.
    p = solve_discrete_are(a.T, c.T, process, sensor)
    kalman = a @ p @ c.T @ np.linalg.inv(c @ p @ c.T + sensor)
    model = plid.Model.of_matrices(a, b, c, d, rate=RATE)
    found = model.with_predictor(u, y)
    assert_allclose(found.predictor_gain @ np.diag([1.0, 1e3]), kalman @ np.diag([1.0, 1e3]), rtol=0, atol=0.06)
    assert_array_equal(found.A, a)
    assert model.predictor_gain is None and "one-step errors" in found.provenance["predictor"]
    # On a new record, its error is that of the innovations, and much smaller than that of a free run.
    _, u, y, *_ = disturbed(6000, 9)
    error = (y - found.predict(u, y))[100:].std(axis=0)
    innovations = np.sqrt(np.diag(c @ p @ c.T + sensor))
    assert_allclose(error / innovations, 1.0, rtol=0, atol=0.04)
    assert (error < 0.7 * (y - found.simulate(u))[100:].std(axis=0)).all()


def test_a_predictor_is_fitted_only_to_its_record():
    a, b, c, d = plant()
    model = plid.Model.of_matrices(a, b, c, d, rate=RATE)
    u, y = record(200)
    with pytest.raises(ValueError, match=r"y has the shape \(200, 1\)"):
        model.with_predictor(u, y[:, :1])
    with pytest.raises(ValueError, match="15 samples are too few for the predictor gain of 4 states"):
        model.with_predictor(u[:15], y[:15])
    with pytest.raises(ValueError, match="expected"):
        model.with_predictor(u[:100], y)
    unstable = plid.Model.of_matrices(3.0 * a, b, np.zeros((2, 4)), d, rate=RATE)
    with pytest.raises(ValueError, match="no gain keeps the predictor bounded"):
        unstable.with_predictor(u, y)
    y[:, 1] = np.nan
    with pytest.raises(ValueError, match='channel "y2" has no sample that differs from zero'):
        model.with_predictor(u, y)


def test_what_does_not_fit_is_named(exact, tmp_path):
    a, b, c, d = plant()
    with pytest.raises(ValueError, match="B"):
        plid.Model.of_matrices(a, b[:3], c, d, rate=RATE)
    with pytest.raises(ValueError, match=r"u has the shape \(5, 3\)"):
        exact.simulate(np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r"state has the shape \(3,\), expected \(4,\)"):
        exact.simulate(np.zeros((5, 2)), state=np.zeros(3))
    with pytest.raises(ValueError, match="25"):
        exact.frequency_response(26.0)
    with pytest.raises(ValueError, match="'.txt' is none of"):
        exact.save(tmp_path / "model.txt")
    with pytest.raises(OSError, match="absent"):
        plid.Model.load(tmp_path / "absent.json")
