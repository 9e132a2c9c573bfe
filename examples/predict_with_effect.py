#!/usr/bin/env python3
"""Repeats `plid gap predict` from sim-with-effect.json alone: free run from rest, with the diagnosed effects.

    python3 examples/predict_with_effect.py sim-with-effect.json u.csv y.csv [t0]

t0 is the time since the first record began, in s, which drifts and hum need. The default is the end of the last record.
To add an effect to your own simulator, copy its function, and the lines of `simulate` that call it.
"""
import copy
import json
import math
import re
import sys

import numpy as np

TAU = 2 * math.pi
# Free shapes, in `unit`: knots of static curves, widths of smoothed steps, yield points, turns of a course over time.
KNOTS, STEPS = (0.0, 0.1, 0.3, 0.8, 1.4, 2.0, 2.8, 3.8), (0.03, 0.12, 0.4, 1.5)
YIELDS, TURNS = (0.2, 0.6, 1.5, 4.0), (0.08, 0.2, 0.38, 0.6, 0.8)
SLIDERS = 64  # of an Iwan joint
FORCE_PARTS = 8  # parts of a sample over which a force that depends on the motion is a straight line
DRIFT_SAMPLES = 16  # samples after which a drifting stiffness is brought up to date


def slip(z, delta, slope, width):
    """dz = slope dx - (|dx| z + dx |z|) / (2 width), exactly, for a motion by `delta` in one direction."""
    sign = math.copysign(1, delta)
    along, left = sign * z, abs(delta)
    if along < 0:  # on the way back it is a spring, until z changes its sign
        if left <= -along / slope:
            return sign * (along + slope * left)
        along, left = 0.0, left + along / slope
    limit = slope * width
    return sign * (limit + (along - limit) * math.exp(-left / width))


def skewed_slip(z, delta, rise, fall):
    """dz/dx = 1 - rise |z| while |z| grows and 1 + fall |z| while it falls, exactly, as above."""
    def moved(z, way, rate):
        return z - (z - 1 / rate) * -math.expm1(-rate * way) if rate else z + way
    sign = math.copysign(1, delta)
    along, left = sign * z, abs(delta)
    if along < 0:
        end = moved(along, left, fall)
        if end < 0:
            return sign * end
        left -= math.log1p(-fall * along) / fall if fall else -along
        along = 0.0
    return sign * moved(along, left, rise)


def sliders(p):
    """The stretch at which each slider of an Iwan joint yields, and the share of its spring in k. The displacements up
    to dm, of density x^chi, are divided into intervals; each has a slider with its stiffness and its largest force."""
    power, edges = 1 + max(p["chi"], -0.95), (np.arange(SLIDERS + 1) / SLIDERS)**3
    shares = np.diff(edges**power)
    return {"shares": shares, "yields": p["dm"] * power / (power + 1) * np.diff(edges**(power + 1)) / shares}


def yielding(z, delta, p):
    """A joint's slip. Without h, it is elastic as it is unloaded."""
    if "h" not in p:
        return slip(z, delta, 1.0, p["dy"])
    return skewed_slip(z, delta, (1 + p["h"]) / (2 * p["dy"]), (1 - p["h"]) / (2 * p["dy"]))


def ramp(x, first, second):
    """Zero up to the first knot; from there on its slope rises evenly, to one at the second."""
    width, past = second - first, max(x - first, 0)
    return past * past / (2 * width) if past < width else past - width / 2


def bend(x, s):
    """sign(x) (s_1 |x| + sum_k s_k ramp_k(|x|)): the first eight s where x >= 0, the others where x < 0."""
    side = s[:8] if x >= 0 else s[8:]
    pieces = zip(side[1:], KNOTS, KNOTS[1:])
    bends = sum(c * ramp(abs(x), first, second) for c, first, second in pieces)
    return math.copysign(1, x) * (side[0] * abs(x) + bends)


def free_rate(x, s):
    """sum_k s_k tanh(x / W_k), and the last two times x |x| and x^2."""
    return sum(size * math.tanh(x / width) for size, width in zip(s, STEPS)) + s[4] * x * abs(x) + s[5] * x * x


def stop(d, v, side, g, p):
    """A spring with a damper beyond g on one side of rest. It pushes and never pulls."""
    x = side * d - g
    return -side * max(p["k"] * x + p["c"] * side * v, 0) if x > 0 else 0.0


def course(t, s):
    """sum_k s_k max(t - T_k, 0)."""
    return sum(slope * np.maximum(t - turn, 0) for slope, turn in zip(s, TURNS))


# Effects on a channel: the new signal x, with parameters p, at times t (s), with h from one value to the next (s).
# A command is held over h. What acts between samples gives the mean over h: while h is short compared with the periods
# of the structure, the structure responds to both in the same way. PARTS says into how many parts a sample is divided
# for that. In closed loop, a signal is passed one sample at a time, and p["memory"] keeps what the next sample needs.

def actuator_hysteresis(x, p, t, h):
    out, (z, before) = np.empty_like(x), p["memory"].get("last", (0.0, 0.0))
    for k, now in enumerate(x):
        z = slip(z, now - before, p["alpha"], p["uy"])
        out[k], before = now - z, now
    p["memory"]["last"] = z, before
    return out


def free_hysteresis(x, p, t, h):
    out, (z, before) = np.empty_like(x), p["memory"].get("last", ([0.0] * len(YIELDS), 0.0))
    for k, now in enumerate(x):
        z = [slip(z, now - before, 1.0, share * p["unit"]) for z, share in zip(z, YIELDS)]
        out[k], before = now - sum(s * z for s, z in zip(p["s"], z)), now
    p["memory"]["last"] = z, before
    return out


def free_curve(x, p, t, h):
    return x + p["unit"] * np.array([bend(now / p["unit"], p["s"]) for now in x])


def free_path(x, p, back):
    """With values that are so many samples earlier, or later: zero before the record, behind it the last value."""
    reach = max(back)
    whole = np.concatenate([p["memory"].get("past", np.zeros(reach)), x])
    p["memory"]["past"] = whole[len(x):]
    other = [whole[np.minimum(np.arange(len(x)) + reach - j, len(whole) - 1)] for j in back]
    return x + sum(s * (then - x) for s, then in zip(p["s"], other))


def delayed(x, steps, edges, memory):
    """Delayed by any number of steps, with Lagrange's weights on so many values about that instant."""
    first = max(0, int(steps) - edges // 2 + 1)
    weights = [np.prod([(steps - first - i) / (j - i) for i in range(edges) if i != j]) for j in range(edges)]
    last = edges - 1
    whole = np.concatenate([memory.get("past", np.zeros(first + last)), x])
    memory["past"] = whole[len(x):]
    return sum(weight * whole[last - j:len(x) + last - j] for j, weight in enumerate(weights))


def actuator_delay(x, p, t, h):
    # A step between two edges of the parts is spread over six edges: its moments are right up to the fifth.
    return delayed(x, p["tau"] * p["parts"], 6, p["memory"])


def actuator_lag(x, p, t, h):
    # (1 + s / from) / (1 + s / to): the pole that the simulation has is undone, and the new one put in its place.
    # Without "pole" the simulation shows none for this input, and there is nothing to undo.
    decay = math.exp(-TAU * p["fp"] * h)
    mean = -math.expm1(-TAU * p["fp"] * h) / (TAU * p["fp"] * h)
    direct = p["fp"] / p["pole"] if "pole" in p else 0.0
    out, lagged = np.empty_like(x), p["memory"].get("last", 0.0)
    for k, now in enumerate(x):
        out[k] = direct * now + (1 - direct) * (now + (lagged - now) * mean)
        lagged = now + (lagged - now) * decay
    p["memory"]["last"] = lagged
    return out


def actuator_slew_limit(x, p, t, h):
    out, most, at = np.empty_like(x), p["R"] * h, p["memory"].get("last", 0.0)
    for k, now in enumerate(x):
        far = now - at
        if abs(far) <= most:  # it arrives within h, and stays for what is left
            out[k], at = now - 0.5 * far * abs(far) / most, now
        else:
            start, at = at, at + math.copysign(most, far)
            out[k] = 0.5 * (start + at)
    p["memory"]["last"] = at
    return out


def sensor_lag(x, p, t, h):
    out, keep, lagged = np.empty_like(x), math.exp(-TAU * p["fc"] * h), p["memory"].get("last", 0.0)
    for k, now in enumerate(x):
        out[k] = lagged = keep * lagged + (1 - keep) * now
    p["memory"]["last"] = lagged
    return out


def sensor_delay(x, p, t, h):
    if p["in_loop"]:  # A controller reads it, so it depends on earlier samples alone.
        return delayed(x, p["tau"], 4 if p["tau"] < 2 else 6, p["memory"])
    # Of linear phase over the whole band. Behind the record stands its point reflection about the last sample, which
    # fades to zero within 64 samples, so that the record does not end with a jump. The length has no prime factors
    # above 5, as plid has it; it shows a little at both ends.
    length = len(x) + math.ceil(p["tau"]) + 64
    while 30**20 % length != 0:
        length += 1
    k = np.arange(length - len(x))
    back = len(x) - 2 - k
    reflected = 2 * x[-1] - np.where(back >= 0, x[np.maximum(back, 0)], x[-1])
    fading = 0.5 * (1 + np.cos(np.pi * np.minimum(k / 64, 1)))
    turn = np.exp(-1j * TAU * p["tau"] / length * np.arange(length // 2 + 1))
    return np.fft.irfft(np.fft.rfft(np.concatenate([x, fading * reflected])) * turn, length)[:len(x)]


def saturation(x, p, sharp):
    # With "r", a limit whose corner is round; without it, the curve of the effect itself.
    if "r" not in p:
        return sharp(x)
    r, ratio = abs(p["r"]), np.abs(x) / p["a"]
    if r < 1e-3:
        return np.clip(x, -p["a"], p["a"])
    below, above = np.minimum(ratio, 1), np.maximum(ratio, 1)  # the power of neither overflows
    size = np.where(ratio <= 1, below * (1 + below ** (1 / r)) ** -r, (1 + above ** (-1 / r)) ** -r)
    return np.copysign(p["a"] * size, x)


PARTS = {"actuator-delay": 4, "actuator-lag": 8, "actuator-slew-limit": 8, "free-command-path": 2}
COMMANDS = {
    "actuator-gain": lambda x, p, t, h: p["g"] * x,
    "actuator-gain-drift": lambda x, p, t, h: x * (1 + p["r"] * t),
    "actuator-saturation": lambda x, p, t, h: saturation(x, p, lambda x: p["a"] * np.tanh(x / p["a"])),
    "actuator-dead-zone": lambda x, p, t, h: np.sign(x) * np.maximum(np.abs(x) - p["delta"], 0),
    "actuator-crosstalk": lambda x, p, t, h: x + p["c"] * p["from"],
    "actuator-hysteresis": actuator_hysteresis,
    "actuator-delay": actuator_delay,
    "actuator-lag": actuator_lag,
    "actuator-slew-limit": actuator_slew_limit,
    "free-command": free_curve,
    "free-hysteresis": free_hysteresis,
    "free-command-path": lambda x, p, t, h: free_path(x, p, [j * (p["parts"] // 2) for j in (1, 2, 3, 4)]),
    "free-gain-course": lambda x, p, t, h: x * (1 + course(t / p["unit"], p["s"])),
}
SENSORS = {
    "sensor-gain": lambda x, p, t, h: p["g"] * x,
    "sensor-offset": lambda x, p, t, h: x + p["o"],
    "sensor-drift": lambda x, p, t, h: x + p["s"] * t,
    "sensor-saturation": lambda x, p, t, h: saturation(x, p, lambda x: np.clip(x, -p["a"], p["a"])),
    "sensor-quantisation": lambda x, p, t, h: (np.copysign(np.maximum(abs(x) - p["cut"] * p["q"], 0), x)
                                               if p["cut"] > 0 else x),
    "sensor-crosstalk": lambda x, p, t, h: x + p["c"] * p["from"],
    "mains-hum": lambda x, p, t, h: x + p["a"] * np.sin(TAU * p["f"] * t + p["phi"])
                                      + sum(p[f"a{n}"] * np.sin(TAU * n * p["f"] * t + p[f"phi{n}"])
                                            for n in (2, 3, 5)),
    "sensor-lag": sensor_lag,
    "sensor-delay": sensor_delay,
    "free-sensor": free_curve,
    "free-sensor-path": lambda x, p, t, h: free_path(x, p, (1, 2, 3, 4) if p["in_loop"] else (-1, 1, 2, 3)),
    "free-zero-course": lambda x, p, t, h: x + p["size"] * course(t / p["unit"], p["s"]),
}
# The side and the distance from rest of a stop that a displacement may meet.
STOPS = {"end-stop": lambda d, p: (math.copysign(1, d), p["g"]),
         "one-sided-stop": lambda d, p: (math.copysign(1, p["s"]), abs(p["s"]))}
# Forces inside the structure, of the displacement d and the velocity v that their port sees, and of a joint's slip z.
FORCES = {
    "cubic-stiffness": lambda d, v, z, p: -p["k"] * d**3,
    "quadratic-stiffness": lambda d, v, z, p: -p["k"] * d**2,
    "clearance": lambda d, v, z, p: -p["k"] * math.copysign(max(abs(d) - p["g"], 0), d),
    "backlash": lambda d, v, z, p: p["k"] * min(max(d, -p["g"]), p["g"]),
    "coulomb-friction": lambda d, v, z, p: -p["F"] * math.tanh(v / p["v0"]),
    "quadratic-damping": lambda d, v, z, p: -p["c"] * abs(v) * v,
    "gravity-sine": lambda d, v, z, p: p["k"] * (d - math.sin(d)),
    "end-stop": lambda d, v, z, p: stop(d, v, *STOPS["end-stop"](d, p), p),
    "one-sided-stop": lambda d, v, z, p: stop(d, v, *STOPS["one-sided-stop"](d, p), p),
    "stick-friction": lambda d, v, z, p: 0.0 if v == 0 else
        -math.copysign(p["Fc"] + (p["Fs"] - p["Fc"]) * math.exp(-(v / p["vs"])**2), v),
    "iwan-joint": lambda d, v, z, p: p["k"] * (p["s"] * d - np.sum(p["shares"] * z)),
    "joint-hysteresis": lambda d, v, z, p: p["k"] * (p.get("s", 0.0) * d - z),
    "free-stiffness": lambda d, v, z, p: -p["size"] * bend(d / p["unit"], p["s"]),
    "free-damping": lambda d, v, z, p: -p["size"] * free_rate(v / p["unit"], p["s"]),
}
# In closed loop, `linear_with_modal_effects` already includes these.
CHANGES_OF_PLANT = ["actuator-gain", "actuator-crosstalk", "sensor-gain", "sensor-crosstalk"]
# Stiffness and damper of the steepest part of a law, which takes steps of its own.
STEEPEST = {"backlash": lambda p: (p["k"], 0.0), "end-stop": lambda p: (p["k"], p["c"]),
            "one-sided-stop": lambda p: (p["k"], p["c"])}
# The largest force of dry friction that holds its port.
HOLDS = {"stick-friction": lambda p: p["Fs"]}
# Several forces at one port, each with a slip of its own.
SEVERAL = {"free-joint": lambda p: [("joint-hysteresis", {"k": s * p["size"] / p["unit"], "dy": share * p["unit"]})
                                    for s, share in zip(p["s"], YIELDS)]}
# How z changes while d moves by `delta`.
SLIPS = {"joint-hysteresis": yielding, "iwan-joint": lambda z, delta, p: np.clip(z + delta, -p["yields"], p["yields"])}
# Forces of the time alone.
DISTURBANCES = {"narrowband-disturbance": lambda t, p: p["a"] * np.sin(TAU * p["f"] * t + p["phi"])}
# Every w^2 is multiplied by this.
DRIFTS = {
    "stiffness-drift": lambda t, p: 1 + p["r"] * t,
    "free-stiffness-course": lambda t, p: 1 + course(t / p["unit"], p["s"]),
}
# Already in linear_with_modal_effects, as a lag at a place loop:u1 is; and what no free run shows.
NOTHING_TO_DO = ["modal-frequency", "modal-damping", "missing-mode", "added-mass", "added-damping", "added-stiffness",
                 "sensor-noise", "sensor-dropout", "coloured-disturbance"]

KNOWN = [COMMANDS, FORCES, SEVERAL, DISTURBANCES, DRIFTS, SENSORS, NOTHING_TO_DO]


def change(function, signal, location, names, p, t, h, memory=None):
    """Changes the channels that a location names: input:u1, input:all, or input:u1->u2, which is from u1 into u2. In
    closed loop, `memory` is kept from one sample to the next."""
    source, _, target = location.partition(":")[2].rpartition("->")
    p = {**p, "in_loop": memory is not None}
    if source:
        p["from"] = signal[names.index(source)]
    for i in range(len(names)) if target == "all" else [names.index(target)]:
        p["memory"] = {} if memory is None else memory.setdefault(i, {})
        signal[i] = function(signal[i], p, t, h)


def strut(location, model):
    """The port of input:u1, of port:NAME or of freq:132.6 port:NAME. A port on one mode is named as its place."""
    at = location.rpartition("port:")[2]
    key = "name"
    if at.startswith("input:"):
        key, at = "input", at[len("input:"):]
    return next(port for port in model["ports"] if port.get(key) == at)


def expm(a):
    """The matrix exponential: the Taylor series of a / 2^s, squared s times."""
    s = max(0, math.ceil(math.log2(np.linalg.norm(a, 1) + 1e-9)) + 2)
    term = total = np.eye(len(a))
    for k in range(1, 16):
        term = term @ a / (k * 2**s)
        total = total + term
    return np.linalg.matrix_power(total, 2**s)


def over(a, b, h):
    """What dx/dt = A x + B w does in h: to x, with a held w, and with a w that rises from 0 to 1 (Van Loan 1978)."""
    n, m = b.shape
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n:n + m], whole[n:n + m, n + m:] = a * h, b * h, np.eye(m)
    whole = expm(whole)
    return whole[:n, :n], whole[:n, n:n + m], whole[:n, n + m:]


def in_time(model, q):
    """A and B in continuous time. Without "continuous" (a pure delay has no logarithm) only the modes have one, each
    from its own 2 x 2 block; the rest then stands still until the end of a sample."""
    if "continuous" in model:
        return np.array(model["continuous"]["A"]), np.array(model["continuous"]["B"])
    a, b, held = np.zeros_like(model["A"], float), np.zeros_like(model["B"], float), np.array(model["B"])
    for i in range(0, 2 * q, 2):
        z = complex(model["A"][i][i], model["A"][i + 1][i])
        pole = np.log(z) * model["sample_rate_hz"]
        a[i:i + 2, i:i + 2] = [[pole.real, -pole.imag], [pole.imag, pole.real]]
        drive = (held[i] + 1j * held[i + 1]) * pole / (z - 1)
        b[i], b[i + 1] = drive.real, drive.imag
    return a, b


class Loop:
    """A controller that reads the outputs at each sample. Its command is added to the inputs until the next one."""

    def __init__(self, law, model):
        a, b, c, d = (np.array(law[key], float) for key in "ABCD")
        of_outputs = np.array([[name == output for output in model["outputs"]] for name in law["inputs"]], float)
        to_inputs = np.array([[name == output for output in law["outputs"]] for name in model["inputs"]], float)
        self.a, self.c, self.x = a, to_inputs @ c, np.zeros(len(a))
        self.b, self.d = b @ of_outputs, to_inputs @ d @ of_outputs
        self.references = [name for name in law["inputs"] if name not in model["outputs"]]
        at = [law["inputs"].index(name) for name in self.references]
        self.b_references, self.d_references = b[:, at], to_inputs @ d[:, at]
        self.others = [i for i, name in enumerate(model["inputs"])
                       if not self.references or name not in law["outputs"]]
        self.drivers = self.references + [model["inputs"][i] for i in self.others]
        self.names, self.rate = (model["inputs"], model["outputs"]), model["sample_rate_hz"]
        self.commands, self.sensors = [], []

    def driven_by(self, given):
        """The inputs without the feedback, from the references and the inputs that the controller does not drive."""
        v, x = np.zeros((len(self.c), given.shape[1])), np.zeros(len(self.a))
        references = given[:len(self.references)]
        for k in range(given.shape[1] if self.references else 0):
            v[:, k] = self.c @ x + self.d_references @ references[:, k]
            x = self.a @ x + self.b_references @ references[:, k]
        v[self.others] = given[len(self.references):]
        return v

    def take(self, effects):
        """Takes the effects on commands and measurements, each with a memory."""
        self.commands = [(*effect, {}) for effect in effects if effect[0] in COMMANDS]
        # The fits add what a truncating converter takes to the records, so that a controller reads values without it.
        self.sensors = [(*effect, {}) for effect in effects
                        if effect[0] in SENSORS and effect[0] != "sensor-quantisation"]

    def answer(self, v, y, d, t, parts):
        """The commands in the parts of a sample, by their part without feedback and the outputs without direct
        feedthrough (inputs x parts)."""
        fed = self.d @ self.measure(y, t, copy.deepcopy(self.sensors)) if np.any(self.d) else 0.0
        command = np.linalg.solve(np.eye(len(v)) - self.d @ d, v + self.c @ self.x + fed)
        u, own = command[:, None], 1
        for name, location, p, memory in self.commands:
            u, own = refined(u, own, PARTS.get(name, 1))
            change(COMMANDS[name], u, location, self.names[0], {**p, "parts": own}, np.full(own, t),
                   1 / (self.rate * own), memory)
        return np.repeat(u, parts // own, axis=1)

    def measure(self, y, t, sensors):
        """The outputs at a sample as the controller reads them."""
        y = y[:, None].copy()
        for name, location, p, memory in sensors:
            change(SENSORS[name], y, location, self.names[1], p, np.array([t]), 1 / self.rate, memory)
        return y[:, 0]

    def read(self, y, t):
        self.x = self.a @ self.x + self.b @ self.measure(y, t, self.sensors)


def simulate(file, u, t0):
    """Outputs (p x samples) for inputs u (m x samples), from rest; in closed loop, for what drives it."""
    if file.get("intersample") == "foh":  # straight from sample to sample: on average the middle
        u = (u + np.hstack([u[:, 1:], u[:, -1:]])) / 2
    model = file.get("linear_with_modal_effects", file["linear"])
    loop = Loop(file["controller"], model) if "controller" in file else None
    if loop:
        u = loop.driven_by(u)
    # A mode that was missing stands behind the others and before the rest.
    q = file["modes"] + (len(model["A"]) - len(file["linear"]["A"])) // 2
    rate, t = model["sample_rate_hz"], t0 + np.arange(u.shape[1]) / model["sample_rate_hz"]
    effects, loads = [], []
    for effect in file["effects"]:
        name, numbers = effect["effect"], {**effect["parameters"], **effect.get("given", {})}
        if not any(name in known for known in KNOWN):
            sys.exit(f"{name}: this script does not know it")
        p = {key: number["value"] for key, number in numbers.items()}
        if "s_1" in p:  # a free shape: s_1, s_2, ...
            p["s"] = [p[f"s_{k}"] for k in range(1, 1 + sum(key.startswith("s_") for key in p))]
        if name == "iwan-joint":
            held = effect["location"].startswith("mode:") or file["modes"] == 1
            p = {"s": float(held), **p, **sliders(p)}
        if effect["location"].startswith("loop:"):
            loads.append(name)
            continue
        if loop and name in CHANGES_OF_PLANT:
            continue
        several = SEVERAL[name](p) if name in SEVERAL else [(name, p)]
        effects.extend((name, effect["location"], p) for name, p in several)

    u, parts = u.copy(), 1
    if loop:
        loop.take(effects)
    for name, location, p in effects:
        if name in COMMANDS:
            u, parts = refined(u, parts, PARTS.get(name, 1))
            if not loop:
                change(COMMANDS[name], u, location, model["inputs"], {**p, "parts": parts}, np.repeat(t, parts),
                       1 / (rate * parts))
    forces = [(name, p, strut(location, model)) for name, location, p in effects if name in FORCES]
    on_motions = [force for force in forces if is_moved(force[2])]
    forces = [force for force in forces if not is_moved(force[2])]
    if forces:
        u, parts = refined(u, parts, max([FORCE_PARTS] + [stiff_parts(*force, rate) for force in forces]))
    pushes = [
        (DISTURBANCES[name](t, p), strut(location, model)) for name, location, p in effects if name in DISTURBANCES
    ]
    drifts = [(DRIFTS[name], p) for name, _, p in effects if name in DRIFTS]
    loads += [name for name, _, _ in effects if name.startswith("added-")]
    if drifts and loads:
        sys.exit(f"{loads[0]} with a stiffness that changes: this script knows only the modes without it")
    y = structure(model, q, u, parts, t, forces, pushes, drifts, loop)
    for name, p, port in on_motions:
        d = u[model["inputs"].index(port["input"]), ::parts]
        y += np.outer(port["output"], on_a_given_motion(name, p, d, rate))
    for name, location, p in effects:
        if name in SENSORS:
            change(SENSORS[name], y, location, model["outputs"], p, t, 1 / rate, {} if loop else None)
    return y


def is_moved(port):
    """Whether the motion at a port is its input, as on a testing machine: no state moves there."""
    return "input" in port and not np.any([port["force"], port["displacement"], port["velocity"]])


def on_a_given_motion(name, p, d, rate):
    """The force of a law on a displacement d at its samples."""
    v, z, force = np.gradient(d) * rate, 0.0, np.zeros(len(d))
    for k in range(len(d)):
        if name in SLIPS and k > 0:
            z = SLIPS[name](z, d[k] - d[k - 1], p)
        force[k] = FORCES[name](d[k], v[k], z, p)
    return force


def stiff_parts(name, p, port, rate):
    """The parts of a sample that a stiff law needs, a power of two up to 32: in each, it turns the motion of its port
    by a quarter of a radian at most. A unit force accelerates the port by its mobility."""
    stiffness, damper = STEEPEST[name](p) if name in STEEPEST else (0, 0)
    if stiffness == damper == 0:
        return 1
    mobility = max(float(np.dot(port["velocity"], port["force"])), 0)
    turn = (math.sqrt(abs(stiffness) * mobility) + abs(damper) * mobility) / (0.25 * rate)
    return 2 ** math.ceil(math.log2(min(max(turn, 1), 32)))


def refined(u, parts, least):
    """Each value repeated, so that a sample has at least so many."""
    return (np.repeat(u, least // parts, axis=1), least) if parts < least else (u, parts)


def at_end(name, before, now, z, p):
    """The force at the end of a part, over which it is taken to change linearly. Where a stop is reached on the way, it
    is the one that gives the mean force of the part."""
    end = FORCES[name](*now, z, p)
    if name not in STOPS:
        return end
    side, at = STOPS[name](now[0], p)
    first, last = side * before[0] - at, side * now[0] - at
    if first >= 0 or last <= 0:
        return end
    since = last / (last - first)
    speed = now[1] + since * (before[1] - now[1])
    return since * (end - side * max(p["c"] * side * speed, 0.0))


def bent(share, before, after):
    """The straight line, as its start and its change, that moves a body as two straight pieces of a force do: it has
    their sum and their first moment. Each piece goes from one value to another; the second begins at this share."""
    left = 1 - share
    total = 0.5 * (share * sum(before) + left * sum(after))
    moment = (share * (0.5 * sum(before) - share * (before[0] + 2 * before[1]) / 6)
              + left**2 * (2 * after[0] + after[1]) / 6)
    return 6 * moment - 2 * total, 6 * total - 12 * moment


def friction(before, now, acting, most, stuck, by):
    """Dry friction in a part of a sample in which it holds its port, lets it go or brings it to rest; None in another
    part. Its start and its change, its value where the port rests or slides off, and the share of the part in which
    the port slides off. `by` is what a held unit and a ramp to one do to displacement and velocity."""
    (d_held, v_held), (d_ramp, v_ramp) = by
    (d0, v0), (d1, v1) = before, now
    if stuck or v0 == 0:
        # The straight line that keeps the port where it is.
        twist = v_held * d_ramp - d_held * v_ramp
        change = (d_held * v1 - v_held * (d1 - d0)) / twist if twist else 0.0
        start = acting - (v1 + v_ramp * change) / v_held
        end, mean = start + change, start + 0.5 * change
        if abs(mean) > most or abs(end) > most >= abs(start):
            edge = math.copysign(most, mean if abs(start) > most else end)
            share = 0.0 if abs(start) > most else (edge - start) / change
            return *bent(share, (start, edge), (edge, edge)), edge, 1 - share
        return start, change, end, 0.0
    if v0 * v1 > 0:
        return None
    last = -math.copysign(most, v0)
    braked = v1 + v_held * 0.5 * (last - acting)
    share = min(max(v0 / (v0 - braked), 0.0), 1.0)
    rests = acting - (v1 - v0) / v_held
    force = min(max(rests, -most), most)
    start, change = bent(share, (acting, last), (force, force))
    if force == rests:
        return acting - (v1 + v_ramp * change) / v_held, change, force, 0.0
    return start, change, force, 1 - share


def structure(model, q, u, parts, t, forces, pushes, drifts, loop):
    """Everything between the command and the sensors, part by part."""
    (a, b), c, d = in_time(model, q), np.array(model["C"]), np.array(model["D"])
    n, count, h = len(a), len(forces), 1 / (model["sample_rate_hz"] * parts)
    ports = [port for *_, port in forces + pushes]
    column = np.array([port["force"] for port in ports]).reshape(-1, n).T
    at_once = np.array([port.get("output") or [0.0] * len(c) for port in ports]).reshape(-1, len(c)).T
    sees = np.array([[port["displacement"], port["velocity"]] for *_, port in forces]).reshape(-1, n)
    waits, rest = "continuous" not in model, slice(2 * q, n)
    if waits:
        rest_a, rest_b, column[rest] = np.array(model["A"])[rest, rest], np.array(model["B"])[rest], 0
    step, add, _ = over(a, b, h)
    _, held, ramp = over(a, column, h)

    plain_c, plain_sees = c, sees
    x, y, f, z = np.zeros(n), np.zeros((len(c), len(t))), np.zeros(len(ports)), [0.0] * count
    seen, passed = [(0.0, 0.0)] * count, [0.0] * count  # (d, v) of each port, and the d to which its z belongs
    kept = [0.0 if name in HOLDS else None for name, *_ in forces]  # the force that holds a port, None while it moves
    act = lambda j, name, p: FORCES[name](*seen[j], z[j], p) if kept[j] is None else kept[j]
    law = lambda: [act(j, name, p) for j, (name, p, _) in enumerate(forces)]
    own = lambda: [[sees[2 * j:2 * j + 2] @ by[:, j] for by in (held, ramp)] for j in range(count)]
    by = own()  # displacement and velocity at each port by its own held unit, and by its ramp to one
    for k in range(len(t)):
        if drifts and k % DRIFT_SAMPLES == 0:
            middle = t[k] + DRIFT_SAMPLES / 2 * parts * h
            now, c, sees = stiffened(a, plain_c, plain_sees, q, math.prod(drift(middle, p) for drift, p in drifts))
            step, add, _ = over(now, b, h)
            _, held, ramp = over(now, column, h)
            by = own()
            seen = (sees @ x).reshape(-1, 2).tolist()
        for part in range(k * parts, (k + 1) * parts):
            f[:count] = law()
            if part == k * parts:
                if loop:
                    u[:, part:part + parts] = loop.answer(u[:, part], c @ x + at_once @ f, d, t[k], parts)
                y[:, k] = c @ x + d @ u[:, part] + at_once @ f  # sampled before the disturbance's next value acts
                if loop:
                    loop.read(y[:, k], t[k])
                f[count:] = [signal[k] for signal, _ in pushes]
            x = step @ x + add @ u[:, part] + held @ f
            if waits and part == (k + 1) * parts - 1:
                x[rest] = rest_a @ x[rest] + rest_b @ u[:, k * parts:part + 1].mean(axis=1)
            if forces:
                # So far the forces were held. What they are at the end of that step says how they change on the way:
                # the change is a ramp (exponential time differencing of second order, Cox and Matthews 2002).
                before, seen = seen, (sees @ x).reshape(-1, 2).tolist()
                slides, change, starts = [1.0] * count, np.zeros(count), f[:count].copy()
                for j, (name, p, _) in enumerate(forces):
                    # Where friction sets in or lets go within the part, its straight line moves the port as the force
                    # that switches there does.
                    switched = name in HOLDS and friction(before[j], seen[j], f[j], HOLDS[name](p),
                                                          kept[j] is not None, by[j])
                    if switched:
                        start, change[j], starts[j], slides[j] = switched
                        kept[j] = starts[j] if slides[j] == 0 else None
                        x = x + held[:, j] * (start - f[j]) + ramp[:, j] * change[j]
                        f[j] = start
                        seen[j:] = (sees @ x).reshape(-1, 2).tolist()[j:]
                    if name in SLIPS:
                        z[j], passed[j] = SLIPS[name](z[j], seen[j][0] - passed[j], p), seen[j][0]
                ends = [at_end(name, before[j], seen[j], z[j], p) if kept[j] is None else kept[j]
                        for j, (name, p, _) in enumerate(forces)]
                x += ramp[:, :count] @ (np.array(slides) * (np.array(ends) - starts))
                seen = (sees @ x).reshape(-1, 2).tolist()
    return y


def stiffened(a, c, sees, q, factor):
    """With every w^2 times a factor. The force 2 zeta w q' stays, and with it the real part of each pole; with
    dz/dt = pole z + b f, displacement, velocity and acceleration are rows times z that depend on the pole."""
    a, c, sees = a.copy(), c.copy(), sees.copy()

    def turn(rows, i, by):
        value = (rows[:, i] - 1j * rows[:, i + 1]) * by
        rows[:, i], rows[:, i + 1] = value.real, -value.imag

    for i in range(0, 2 * q, 2):
        pole = complex(a[i, i], a[i + 1, i])
        moved = complex(pole.real, math.sqrt(max(abs(pole)**2 * factor - pole.real**2, 1e-6 * abs(pole)**2)))
        a[i:i + 2, i:i + 2] = [[moved.real, -moved.imag], [moved.imag, moved.real]]
        shape = pole.imag / moved.imag
        turn(sees[0::2], i, shape)
        turn(sees[1::2], i, shape * (moved / pole))
        turn(c, i, shape * (moved / pole)**2)
    return a, c, sees


def read_inputs(path, names):
    """Columns by name (m x samples)."""
    with open(path, encoding="utf-8-sig") as text:
        lines = [line.strip() for line in text if line.strip() and not line.startswith("#")]
    header, *rows = [[cell.strip('" ') for cell in re.split(r" *[,;\t] *| +", line)] for line in lines]
    missing = [name for name in names if name not in header]
    if missing:
        sys.exit(f"{path}: no column {', '.join(missing)}")
    return np.array([[float(row[header.index(name)]) for name in names] for row in rows]).T


def main():
    if len(sys.argv) not in (4, 5):
        sys.exit(__doc__)
    with open(sys.argv[1], encoding="utf-8") as text:
        file = json.load(text)
    inputs = Loop(file["controller"], file["linear"]).drivers if "controller" in file else file["linear"]["inputs"]
    u = read_inputs(sys.argv[2], inputs)
    y = simulate(file, u, float(sys.argv[4]) if len(sys.argv) == 5 else file["t0"])
    np.savetxt(sys.argv[3], y.T, fmt="%.12g", delimiter=",", header=",".join(file["linear"]["outputs"]), comments="")


if __name__ == "__main__":
    main()
