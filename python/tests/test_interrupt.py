"""Ctrl-C, and other threads of Python at work."""

import signal
import subprocess
import sys
import threading
import time

import pytest
from conftest import RATE, record

import plid

LONG = """
import sys, time, numpy as np, plid
random = np.random.default_rng(0)
u = random.standard_normal((200_000, 3))
y = np.cumsum(random.standard_normal((200_000, 3)), axis=0)
print("begins", flush=True)
try:
    plid.identify(u, y, rate=100.0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGINT between processes")
def test_ctrl_c_ends_a_long_identification():
    process = subprocess.Popen([sys.executable, "-c", LONG], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "begins\n"
        time.sleep(1.0)
        assert process.poll() is None, "the work was over before it was interrupted"
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=20)
        assert rest == "interrupted\n"
        assert time.monotonic() - sent < 10
    finally:
        process.kill()


def test_other_threads_run_meanwhile():
    u, y = record(20_000)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.monotonic()
    plid.identify(u, y, rate=RATE, states=4)
    ended = time.monotonic()
    done.set()
    thread.join()
    during = sum(began < t < ended for t in ticks)
    assert during > 0.2 * (ended - began) / 0.02, f"{during} ticks in {ended - began:.2f} s"
