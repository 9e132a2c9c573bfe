"""One sample at a time."""

import numpy as np
import pytest
from conftest import RATE, plant, record
from numpy.testing import assert_allclose

import plid


def run(samples=600, missing=False, **options):
    u, y = record(samples)
    u, y = u - u.mean(axis=0), y - y.mean(axis=0)
    if missing:
        y[50::7, 0] = np.nan
    identifier = plid.Identifier(2, 2, states=4, rate=RATE, sensor_noise=0.05**2, missing=missing, **options)
    innovations = np.array([identifier.step(*sample) for sample in zip(u, y, strict=True)])
    return identifier, innovations


@pytest.fixture(scope="module")
def plain():
    return run()


def test_the_modes_are_found_on_the_way(plain):
    identifier, innovations = plain
    poles = np.linalg.eigvals(plant()[0])
    hz = sorted(abs(np.log(poles[poles.imag > 0]) * RATE) / 2 / np.pi)
    assert_allclose([mode.hz for mode in identifier.model().modes()], hz, rtol=0.01)
    assert np.std(innovations[300:]) < 0.2 * np.std(innovations[:50])
    assert identifier.steps == 600 and identifier.state.shape == (4,)
    assert identifier.estimate.shape == identifier.variances.shape == (4 + 4 * 4,)


def test_the_first_innovation_is_the_output():
    identifier = plid.Identifier(1, 1, states=2, rate=RATE, sensor_noise=1e-4)
    assert_allclose(identifier.step(0.3, -0.7), [-0.7], atol=1e-15)


def test_variances_shrink():
    identifier = plid.Identifier(1, 1, states=1, rate=RATE, sensor_noise=1.0, state_noise=0.0)
    before = identifier.variances
    identifier.step(1.0, 0.5)
    # The state is 1 +- 1 before the measurement and halves; then a = 0 forgets it, and the parameter a is unknown.
    assert identifier.variances.shape == before.shape == (3,)
    assert_allclose(before, 1.0)


@pytest.mark.parametrize("form", plid.variants()["covariance"])
@pytest.mark.parametrize("backend", plid.variants()["backend"])
def test_every_variant_gives_the_same_estimate(plain, form, backend):
    identifier, _ = run(covariance=form, backend=backend)
    assert_allclose(identifier.estimate, plain[0].estimate, atol=1e-6)


def test_missing_outputs_have_no_innovation():
    identifier, innovations = run(missing=True)
    assert np.isnan(innovations[50, 0]) and np.isfinite(innovations[50, 1])
    assert np.isfinite(identifier.estimate).all()


def test_what_does_not_fit_is_named():
    identifier = plid.Identifier(2, 1, states=2, rate=RATE, sensor_noise=1e-4)
    with pytest.raises(ValueError, match=r"u has the shape \(1,\), expected \(2,\)"):
        identifier.step(1.0, 1.0)
    with pytest.raises(ValueError, match="(?i)output|finite|NaN"):
        identifier.step([1.0, 1.0], np.nan)
    with pytest.raises(ValueError, match="sensor_noise has the shape"):
        plid.Identifier(1, 1, states=2, rate=RATE, sensor_noise=[1.0, 2.0])
    with pytest.raises(ValueError, match="2 indices"):
        plid.Identifier(1, 1, states=[1, 1], rate=RATE, sensor_noise=1.0)
    with pytest.raises(ValueError, match="did you mean"):
        plid.Identifier(1, 1, states=2, rate=RATE, sensor_noise=1.0, covariance="joesph")
