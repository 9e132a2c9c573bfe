"""Records of a plant that the tests know."""

import os
import sys

import numpy as np
import pytest
from scipy.signal import dlsim

import plid

RATE = 50.0
STATUS = pytest.StashKey[int]()


def plant():
    """Return A, B, C, D of two modes with two inputs and two outputs."""
    a = np.zeros((4, 4))
    for at, radius, angle in ((0, 0.97, 0.6), (2, 0.95, 1.3)):
        c, s = radius * np.cos(angle), radius * np.sin(angle)
        a[at : at + 2, at : at + 2] = [[c, -s], [s, c]]
    b = np.array([[0.3, 0.0], [0.1, -0.4], [0.2, 0.5], [0.0, 0.3]])
    c = np.array([[1.0, 0.2, 0.5, -0.3], [-0.4, 1.0, 0.8, 0.1]])
    return a, b, c, np.zeros((2, 2))


def record(samples=1500, noise=0.05, seed=1):
    """Return inputs and noisy outputs of the plant, away from zero."""
    random = np.random.default_rng(seed)
    u = random.standard_normal((samples, 2))
    y = dlsim((*plant(), 1.0 / RATE), u)[1]
    return u + 3.0, y - 20.0 + noise * random.standard_normal(y.shape)


@pytest.fixture(scope="session")
def data():
    return record()


@pytest.fixture(scope="session")
def model(data):
    return plid.identify(*data, rate=RATE, states=4)


def pytest_sessionfinish(session, exitstatus):
    session.config.stash[STATUS] = int(exitstatus)


def pytest_unconfigure(config):
    """Leave without the exit handlers of an FMU.

    The library that pythonfmu 0.3 puts into an FMU reads memory that it has freed when the process ends
    (`finalizePythonInterpreter` in valgrind), and in rare runs this aborts the process after the last test.
    """
    if "pythonfmu" in sys.modules:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[STATUS])
