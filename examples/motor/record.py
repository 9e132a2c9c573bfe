"""Writes a case for `plid gap diagnose`: a motor on a bench whose bearing has dry friction that its simulation lacks.

    python3 examples/motor/record.py out/motor
    plid gap diagnose out/motor/case.toml --out out/motor/gap

The input is the torque in N m, and the output the speed in rad/s. The truth is integrated with small steps, in which
the friction stops the shaft whenever it can. Needs NumPy.
"""

import json
import pathlib
import shutil
import sys

import numpy as np

RATE = 500.0  # samples a second
SECONDS = 8.0
STEPS = 20  # of the truth in a sample
INERTIA, DAMPER = 0.002, 0.004  # kg m^2 and N m s/rad, of the truth and of the simulation
FRICTION = 0.02  # N m, of the truth alone
SPEED_NOISE = 0.15  # rad/s
# The torque of each record is a share of LOUDEST, in N m.
LOUDEST = 0.3
RECORDS = {"quiet": 0.0, "low": 0.3, "high": 1.0, "check": 1.0}


def simulation():
    """model.json: a first-order motor whose torque is held over a sample."""
    pole = np.exp(-DAMPER / INERTIA / RATE)
    return {
        "format": "state-space",
        "sample_rate_hz": RATE,
        "inputs": ["torque"],
        "outputs": ["speed"],
        "A": [[pole]],
        "B": [[(1 - pole) / DAMPER]],
        "C": [[1.0]],
        "D": [[0.0]],
    }


def torque(random, level):
    """A random course of the frequencies from 0.5 to 20 Hz, with an RMS of `level`."""
    count = round(SECONDS * RATE)
    hz = np.fft.rfftfreq(count, 1 / RATE)
    lines = (hz >= 0.5) & (hz <= 20.0)
    course = np.fft.irfft(lines * np.exp(2j * np.pi * random.random(len(lines))), count)
    return level * course / np.sqrt(np.mean(course**2))


def speed(command):
    """The speed of the true motor at the samples."""
    step, moving, seen = 1 / RATE / STEPS, 0.0, []
    for now in command:
        seen.append(moving)
        for _ in range(STEPS):
            free = moving + step / INERTIA * (now - DAMPER * moving)
            moving = np.sign(free) * max(abs(free) - step / INERTIA * FRICTION, 0.0)
    return np.array(seen)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__.strip())
    out = pathlib.Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    for name, share in RECORDS.items():
        command = torque(random, share * LOUDEST)
        measured = speed(command) + SPEED_NOISE * random.standard_normal(len(command))
        table = np.column_stack([command, measured])
        np.savetxt(out / f"{name}.csv", table, delimiter=",", header="torque,speed", comments="", fmt="%.6g")
    (out / "motor.json").write_text(json.dumps(simulation(), indent=1) + "\n")
    shutil.copy(pathlib.Path(__file__).with_name("case.toml"), out)


if __name__ == "__main__":
    main()
