"""Identification against the plant that made the records."""

import numpy as np
import pytest
from conftest import RATE, plant, record
from numpy.testing import assert_allclose

import plid


def true_modes():
    poles = np.linalg.eigvals(plant()[0])
    s = np.log(poles[poles.imag > 0]) * RATE
    return sorted((abs(s) / 2 / np.pi).tolist())


def test_the_order_and_the_modes_are_found(data):
    found = plid.identify(*data, rate=RATE)
    assert found.A.shape == (4, 4)
    for mode, hz in zip(found.modes(), true_modes(), strict=True):
        assert 0 < mode.hz_std < 0.01 * hz and abs(mode.hz - hz) < 5 * mode.hz_std
        assert 0 < mode.damping_std < mode.damping and mode.oscillatory


def test_the_response_is_that_of_the_plant(model):
    a, b, c, _ = plant()
    hz = np.array([1.0, 5.0, 12.0])
    found = model.frequency_response(hz)
    for f, h, std in zip(hz, found.response, found.magnitude_std, strict=True):
        truth = c @ np.linalg.solve(np.exp(2j * np.pi * f / RATE) * np.eye(4) - a, b)
        assert h.shape == std.shape == (2, 2) and (std > 0).all()
        assert_allclose(h, truth, atol=0.05 * abs(truth).max())


def test_a_record_is_simulated_as_it_was_recorded(data, model):
    u, y = data
    error = (model.simulate(u) - y)[200:]
    assert error.std() < 0.06


@pytest.mark.parametrize("form", plid.variants()["covariance"])
@pytest.mark.parametrize("expectations", plid.variants()["expectations"])
def test_every_form_and_expectation_is_reached_by_name(data, model, form, expectations):
    found = plid.identify(*data, rate=RATE, states=4, covariance=form, expectations=expectations)
    chosen = found.provenance["variant"]
    assert (chosen["covariance"], chosen["expectations"]) == (form, expectations)
    assert_allclose([m.hz for m in found.modes()], [m.hz for m in model.modes()], rtol=0.02)


@pytest.mark.parametrize("backend", plid.variants()["backend"])
def test_every_backend_gives_the_same_model(data, model, backend):
    found = plid.identify(*data, rate=RATE, states=4, backend=backend)
    assert found.provenance["variant"]["backend"] == backend
    assert_allclose(found.A, model.A, atol=1e-7)


def test_missing_outputs_cost_little(model):
    u, y = record()
    y[::9, 1] = np.nan
    with pytest.raises(ValueError, match=r"y: channel 'y2' is nan at sample 0 .*missing=True"):
        plid.identify(u, y, rate=RATE, states=4)
    found = plid.identify(u, y, rate=RATE, states=4, missing=True)
    assert_allclose([m.hz for m in found.modes()], [m.hz for m in model.modes()], rtol=0.01)


def test_a_predictor_is_fitted():
    """One-step predictions have a smaller error than a free run where the plant is disturbed."""
    a, b, c, _ = plant()

    def disturbed(seed):
        random = np.random.default_rng(seed)
        u, x, y = random.standard_normal((3000, 2)), np.zeros(4), np.empty((3000, 2))
        for k, u_k in enumerate(u):
            y[k] = c @ x + 0.05 * random.standard_normal(2)
            x = a @ x + b @ u_k + 0.1 * random.standard_normal(4)
        # Away from zero, and in other units.
        return u + 3.0, y * [1.0, 100.0] - 20.0

    u, y = disturbed(1)
    model = plid.identify(u, y, rate=RATE, states=4)
    assert model.predictor_gain.shape == (4, 2) and model.provenance["predictor"]
    assert plid.identify(u, y, rate=RATE, states=4, predictor=False).predictor_gain is None
    assert_allclose(model.with_predictor(u, y).predictor_gain, model.predictor_gain, rtol=0, atol=0)
    fresh, measured = disturbed(2)
    one_step = (measured - model.predict(fresh, measured))[200:].std(axis=0)
    free = (measured - model.simulate(fresh))[200:].std(axis=0)
    assert (one_step < 0.7 * free).all(), (one_step, free)


def test_progress_is_told(data):
    lines = []
    plid.identify(*data, rate=RATE, states=4, progress=lines.append)
    assert lines and all(line.startswith("4 states: ") for line in lines)


def test_what_progress_raises_stops_the_work(data):
    def objects(line):
        raise LookupError(line)

    with pytest.raises(LookupError, match="states"):
        plid.identify(*data, rate=RATE, progress=objects)


def test_names_come_from_a_data_frame(data):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    u = pandas.DataFrame(data[0], columns=["left", "right"])
    y = pandas.DataFrame(data[1], columns=["tip", "base"])
    found = plid.identify(u, y, rate=RATE, states=4)
    assert (found.inputs, found.outputs) == (["left", "right"], ["tip", "base"])
    with pytest.raises(ValueError, match="channel \"left\" is constant"):
        plid.identify(u.assign(left=1.0), y, rate=RATE)
    with pytest.raises(TypeError, match="column 'tip'"):
        plid.identify(u, y.assign(tip="far"), rate=RATE)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda u, y: dict(u=u[:-1]), ValueError, r"\(1499, 2\).*\(1500, 2\)"),
        (lambda u, y: dict(u=u[None]), ValueError, r"u has the shape \(1, 1500, 2\)"),
        (lambda u, y: dict(u=u.astype(str)), TypeError, "u holds <U"),
        (lambda u, y: dict(u=u + 1j), TypeError, "u holds complex128"),
        (lambda u, y: dict(u=u[:, :0]), ValueError, "empty"),
        (lambda u, y: dict(u=np.where(u > 5, np.inf, u)), ValueError, r"channel 'u\d' is inf"),
        (lambda u, y: dict(y=np.c_[y[:, 0], 0 * y[:, 1]]), ValueError, 'channel "y2" is constant'),
        (lambda u, y: dict(u=u[:5], y=y[:5]), ValueError, "too few"),
        (lambda u, y: dict(states=1), ValueError, "too few for 2 outputs"),
        (lambda u, y: dict(states=0), ValueError, "states = 0"),
        (lambda u, y: dict(states=2.5), TypeError, "float"),
        (lambda u, y: dict(rate=0), ValueError, "rate = 0"),
        (lambda u, y: dict(rate=float("nan")), ValueError, "rate = nan"),
        (lambda u, y: dict(covariance="array-sqr"), ValueError, 'covariance.*did you mean "array-sqrt"'),
        (lambda u, y: dict(backend="fear"), ValueError, 'backend.*did you mean "faer"'),
        (lambda u, y: dict(scalar="f46"), ValueError, "scalar: there is no"),
        (lambda u, y: dict(expectations=""), ValueError, "expectations"),
        (lambda u, y: dict(scalar="double-double", backend="faer"), ValueError, "faer has no such numbers"),
    ],
)
def test_what_does_not_fit_is_named(data, change, error, words):
    u, y = data
    with pytest.raises(error, match=words):
        plid.identify(**dict(u=u, y=y, rate=RATE) | change(u, y))
