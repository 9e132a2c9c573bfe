"""Draws cases of MuJoCo models whose cause is known, for `plid gap diagnose` with the simulator in the loop.

    python3 experiments/mujoco/draw.py OUT --cases 40 --seed 1
    python3 experiments/mujoco/draw.py OUT --cases 16 --seed 5 --two      # two causes at once
    python3 experiments/mujoco/draw.py OUT --cases 12 --seed 3 --outside  # causes that no effect describes

Each folder OUT/NNN has model.xml (the simulator), records, case.toml, and fresh.csv, a record of which no diagnosis
knows. OUT/labels.json has the causes. The truth is another model with a shorter time step, in which the cause is
built in Python. Needs `pip install ./python[mujoco]`. score.py compares answers with labels.
"""

import argparse
import itertools
import json
import pathlib

import mujoco
import numpy as np

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples" / "simulator"

# Rate in Hz, and the time steps of the simulator and of the truth in s.
RATE, STEP, FINE = 200.0, 1e-3, 2.5e-4
SAMPLES = 1000

# Position of a stop, over the RMS of the displacement without it.
STOP = 0.6

PLANTS = {
    # A slider with a viscous bearing and a weak spring.
    "slider": dict(
        bodies='<body name="cart"><joint name="rail" type="slide" axis="1 0 0" damping="{d}" stiffness="4"/>'
        '<geom type="box" size=".1 .05 .05" mass="{m}"/></body>',
        actuators='<motor name="force" joint="rail"/>',
        sensors='<jointpos name="x" joint="rail"/><jointvel name="v" joint="rail"/>',
        numbers=dict(m=1.0, d=3.0),
        ports=["rail"],
        parameters=["joint.rail.damping", "body.cart.mass"],
        force=6.0,
    ),
    # A pendulum: gravity makes it nonlinear.
    "pendulum": dict(
        bodies='<body name="rod"><joint name="hinge" type="hinge" axis="0 1 0" damping="{d}"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass="{m}"/></body>',
        actuators='<motor name="torque" joint="hinge"/>',
        sensors='<jointpos name="angle" joint="hinge"/>',
        numbers=dict(m=0.8, d=0.06),
        ports=["hinge"],
        parameters=["joint.hinge.damping", "body.rod.mass"],
        force=0.9,
    ),
    # A position servo.
    "servo": dict(
        bodies='<body name="arm"><joint name="axis" type="hinge" axis="0 0 1" damping="{d}" armature=".01"/>'
        '<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="{m}"/></body>',
        actuators='<position name="target" joint="axis" kp="12" kv=".5"/>',
        sensors='<jointpos name="angle" joint="axis"/><jointvel name="rate" joint="axis"/>',
        numbers=dict(m=0.7, d=0.12),
        ports=["axis"],
        parameters=["joint.axis.damping", "body.arm.mass"],
        force=0.8,
    ),
    # A motor drives a link through an elastic joint, under gravity.
    "arm": dict(
        bodies='<body name="motor"><joint name="drive" type="hinge" axis="0 1 0" damping="{d}" armature=".02"/>'
        '<geom type="sphere" size=".03" mass=".3"/><body name="link"><joint name="elastic" type="hinge" axis="0 1 0" '
        'stiffness="25" damping=".05"/><geom type="capsule" fromto="0 0 0 0 0 -.35" size=".02" mass="{m}"/></body>'
        "</body>",
        actuators='<motor name="torque" joint="drive"/>',
        sensors='<jointpos name="drive" joint="drive"/><jointpos name="elastic" joint="elastic"/>',
        numbers=dict(m=0.6, d=0.2),
        ports=["drive", "elastic"],
        parameters=["joint.drive.damping", "body.link.mass", "joint.elastic.stiffness"],
        force=1.2,
    ),
}

# A table with two drives: their axes can be coupled.
TABLE = dict(
    bodies='<body name="saddle"><joint name="x" type="slide" axis="1 0 0" damping="{d}" stiffness="6"/>'
    '<geom type="box" size=".1 .1 .02" mass=".5"/><body name="plate"><joint name="y" type="slide" axis="0 1 0" '
    'damping="{d}" stiffness="6"/><geom type="box" size=".1 .1 .02" mass="{m}"/></body></body>',
    actuators='<motor name="fx" joint="x"/><motor name="fy" joint="y"/>',
    sensors='<jointpos name="x" joint="x"/><jointpos name="y" joint="y"/>',
    numbers=dict(m=0.8, d=2.5),
    ports=["x", "y"],
    parameters=["joint.x.damping", "joint.y.damping", "body.plate.mass"],
    force=5.0,
)

FRICTION = ["coulomb-friction", "stick-friction", "simulator-parameter"]


def xml(plant, step, **changed):
    numbers = {**plant["numbers"], **changed}
    return (
        f'<mujoco><option timestep="{step}" integrator="implicitfast"/><worldbody>'
        f'{plant["bodies"].format(**numbers)}</worldbody><actuator>{plant["actuators"]}</actuator>'
        f'<sensor>{plant["sensors"]}</sensor></mujoco>'
    )


class Cause:
    """What the truth has in addition to the simulator: other numbers, a changed command, forces at joints, changed
    outputs.

    `force` is that at one joint, of its displacement, velocity and time; `coupling` gives the forces at all joints from
    their positions and velocities. `sizes` are the true parameters of the effects that describe the cause exactly, and
    `changed` those of the simulator.
    """

    def __init__(self, names, place, numbers=None, command=None, force=None, sense=None, joint=None, coupling=None,
                 sizes=None, changed=None):
        self.names, self.place, self.numbers, self.coupling = names, place, numbers or {}, coupling
        self.command, self.force, self.sense, self.joint = command, force, sense, joint
        at = listed(place)[-1]
        self.sizes = {f"{name}@{at}": size for name, size in (sizes or {}).items()}
        self.changed = changed or {}

    def beside(self, other):
        """Both causes at once; only one of the two has a force."""
        def after(first, second):
            return (lambda x: second(first(x))) if first and second else first or second

        both = Cause(
            [self.names, other.names], [listed(self.place), listed(other.place)], {**self.numbers, **other.numbers},
            after(self.command, other.command), self.force or other.force, after(self.sense, other.sense),
            self.joint or other.joint,
        )
        both.sizes, both.changed = {**self.sizes, **other.sizes}, {**self.changed, **other.changed}
        return both


def lagged(hz):
    def command(u):
        share, slow, out = 1 - np.exp(-2 * np.pi * hz * FINE), np.zeros(u.shape[1]), np.empty_like(u)
        for k, now in enumerate(u):
            slow = slow + share * (now - slow)
            out[k] = slow
        return out

    return command


def delayed(seconds):
    return lambda u: np.vstack([np.zeros((round(seconds / FINE), u.shape[1])), u])[: len(u)]


def late(samples, output):
    def sense(y):
        y = y.copy()
        y[samples:, output], y[:samples, output] = y[:-samples, output].copy(), y[0, output]
        return y

    return sense


def stop(limit, stiffness, damping):
    def force(d, v, t):
        x = abs(d) - limit
        return -np.sign(d) * max(stiffness * x + damping * v * np.sign(d), 0.0) if x > 0 else 0.0

    return force


def causes(kind, plant, rng):
    """Draws a cause of a kind for a plant; None if the plant has no such cause."""
    u = "input:" + _name(plant["actuators"], 0)
    joints, outputs = plant["ports"], plant["sensors"].split("<")[1:]
    joint = joints[-1]
    port = u if len(joints) == 1 else "port:" + joint
    first = "output:" + _name(plant["sensors"], 0)
    scale, big = plant["force"], rng.uniform(0.7, 1.4)
    mass, damping = plant["parameters"][1], plant["parameters"][0]

    def number(key, parameter, value, names, place, sizes=None):
        return Cause(["simulator-parameter", *names], ["parameter:" + parameter, place], numbers={key: value},
                     changed={parameter: value}, sizes=sizes)

    def dry(size):
        return Cause(FRICTION, u, joint=joints[0], force=("dry", size), sizes={"stick-friction": {"Fc": size}})

    def smooth(size, v0=0.15):
        return Cause(["coulomb-friction", "stick-friction"], u, joint=joints[0],
                     force=lambda d, v, t: -size * np.tanh(v / v0), sizes={"coulomb-friction": {"F": size, "v0": v0}})

    def stiffening(k):
        return Cause(["cubic-stiffness"], port, joint=joint, force=lambda d, v, t: -k * d**3,
                     sizes={"cubic-stiffness": {"k": k}})

    def damped(value):
        extra = value - plant["numbers"]["d"]
        return number("d", damping, value, ["added-damping"], u, sizes={"added-damping": {"c": extra}})

    def saturated(a):
        return Cause(["actuator-saturation"], u, command=lambda c: a * np.tanh(c / a),
                     sizes={"actuator-saturation": {"a": a}})

    def dead(z):
        return Cause(["actuator-dead-zone"], u, command=lambda c: np.sign(c) * np.maximum(np.abs(c) - z, 0),
                     sizes={"actuator-dead-zone": {"delta": z}})

    def amplified(g):
        return Cause(["actuator-gain"], u, command=lambda c: g * c, sizes={"actuator-gain": {"g": g}})

    def late_command(seconds):
        tau = round(seconds / FINE) * FINE * RATE
        return Cause(["actuator-delay"], u, command=delayed(seconds), sizes={"actuator-delay": {"tau": tau}})

    def offset(o):
        return Cause(["sensor-offset"], first, sense=lambda y: y + o * np.eye(y.shape[1])[0],
                     sizes={"sensor-offset": {"o": o}})

    drawn = {
        "none": lambda: Cause([], None),
        "friction": lambda: dry(0.12 * big * scale),
        "smooth-friction": lambda: smooth(0.15 * big * scale),
        "stiffening": lambda: stiffening((400 if joint == "elastic" else 8.0) * big * scale),
        "stop": lambda: Cause(
            ["end-stop"], port, joint=joint, force=("stop", 400 * scale, 2 * scale),
            sizes={"end-stop": {"k": 400 * scale, "c": 2 * scale}},
        ),
        "damping": lambda: damped(plant["numbers"]["d"] * rng.choice([0.6, 1.7])),
        "mass": lambda: number("m", mass, plant["numbers"]["m"] * rng.choice([0.8, 1.3]), ["added-mass"], port),
        "gain": lambda: amplified(1 + 0.2 * big),
        "saturation": lambda: saturated(0.9 * big * scale),
        "dead-zone": lambda: dead(0.25 * big * scale),
        "lag": lambda: Cause(["actuator-lag"], u, command=lagged(5.0 * big), sizes={"actuator-lag": {"fp": 5.0 * big}}),
        "delay": lambda: late_command(0.02 * big),
        "sensor-delay": lambda: Cause(["sensor-delay"], first, sense=late(3, 0), sizes={"sensor-delay": {"tau": 3.0}}),
        "sensor-gain": lambda: Cause(
            ["sensor-gain"], first, sense=lambda y, g=1.15: np.hstack([g * y[:, :1], y[:, 1:]]),
            sizes={"sensor-gain": {"g": 1.15}},
        ),
        "offset": lambda: offset(0.04 * big),
        # Neither an effect nor a parameter: a payload that falls off and is picked up again.
        "slips": lambda: Cause(
            None, None, joint=joints[0],
            force=lambda d, v, t, f=0.35 * scale: f * (1 if int(1.7 * t) % 3 == 0 else 0) * np.sign(np.sin(9 * t * t)),
        ),
        # A joint that couples two axes: each pushes the other when both are away from their middle.
        "couples": lambda: Cause(None, None, coupling=lambda q, v, k=60 * big * scale: -k * q * q[::-1] ** 2),
    }
    if kind == "couples" and len(joints) < 2:
        return None
    if kind == "sensor-delay" and len(outputs) < 2 or kind == "mass" and "m" not in plant["numbers"]:
        return None
    return drawn[kind]()


KINDS = [
    "friction", "damping", "lag", "none", "stiffening", "saturation", "mass", "stop", "delay", "slips",
    "smooth-friction", "gain", "dead-zone", "sensor-delay", "offset", "sensor-gain",
]


# Two causes at once are of two classes.
CLASSES = {
    "command": ["lag", "saturation", "dead-zone", "delay", "gain"],
    "force": ["friction", "smooth-friction", "stiffening", "stop"],
    "numbers": ["damping", "mass"],
    "sense": ["sensor-gain", "offset"],
}


def two(plant, rng):
    """Draws two causes at once, and their kinds."""
    classes = rng.choice(list(CLASSES), 2, replace=False)
    kinds = [str(rng.choice(CLASSES[one])) for one in classes]
    first, second = (causes(kind, plant, rng) for kind in kinds)
    return "+".join(kinds), first and second and first.beside(second)


def _name(tags, index):
    return tags.split('name="')[index + 1].split('"')[0]


def command(rng, m, level):
    """Steps of random size and length, smoothed."""
    u, at = np.zeros((SAMPLES, m)), 0
    while at < SAMPLES:
        length = int(rng.integers(6, 40))
        u[at : at + length] = level * rng.normal(size=m)
        at += length
    slow = np.zeros(m)
    for k in range(SAMPLES):
        slow = slow + 0.3 * (u[k] - slow)
        u[k] = slow
    return u


def measure(plant, cause, u, reach):
    """Runs the truth; `reach` is the displacement that the joint of the cause has without it."""
    model = mujoco.MjModel.from_xml_string(xml(plant, FINE, **cause.numbers))
    force = cause.force
    joint = model.joint(cause.joint).id if cause.joint else None
    if isinstance(force, tuple) and force[0] == "dry":
        model.dof_frictionloss[model.jnt_dofadr[joint]] = force[1]
        force = None
    elif isinstance(force, tuple):
        force = stop(STOP * reach, *force[1:])
    data = mujoco.MjData(model)
    repeat = round(1 / (RATE * FINE))
    fine = np.repeat(u, repeat, axis=0)
    fine = cause.command(fine) if cause.command else fine
    y, seen = [], []
    dof = model.jnt_dofadr[joint] if joint is not None else 0
    for k, now in enumerate(fine):
        data.ctrl[:] = now
        if force is not None:
            data.qfrc_applied[dof] = force(data.qpos[dof], data.qvel[dof], k * FINE)
        if cause.coupling is not None:
            data.qfrc_applied[:] = cause.coupling(data.qpos, data.qvel)
        seen.append(data.qpos[dof])
        mujoco.mj_step(model, data)
        if k % repeat == 0:
            y.append(data.sensordata.copy())
    y = np.array(y)
    return (cause.sense(y) if cause.sense else y), np.sqrt(np.mean(np.square(seen)))


def write(folder, name, inputs, outputs, u, y):
    table = np.hstack([u, y])
    np.savetxt(folder / name, table, delimiter=",", header=",".join(inputs + outputs), comments="", fmt="%.9g")


def draw(folder, kind, plant_name, seed):
    """Writes a case of a kind, or of two causes if `kind` is None. Returns its label; None if there is no such case."""
    rng = np.random.default_rng(seed)
    plant = TABLE if plant_name == "table" else PLANTS[plant_name]
    kind, cause = two(plant, rng) if kind is None else (kind, causes(kind, plant, rng))
    if cause is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.xml").write_text(xml(plant, STEP))
    inputs = [_name(plant["actuators"], k) for k in range(plant["actuators"].count("name="))]
    outputs = [_name(plant["sensors"], k) for k in range(plant["sensors"].count("name="))]
    plain = Cause([], None, joint=cause.joint)
    levels = [0.5, 1.0, 1.0, 0.0, 1.0]
    commands = [command(rng, len(inputs), level * plant["force"]) for level in levels]
    reach = measure(plant, plain, commands[1], 0.0)[1]
    measured = [measure(plant, cause, u, reach)[0] for u in commands]
    for name, size in cause.sizes.items():
        if name.startswith("end-stop"):
            size["g"] = STOP * reach
    noise = 0.005 * np.sqrt(np.mean(np.square(measured[1]), axis=0))
    step = noise  # an encoder that rounds to the noise's size
    lines = [
        f"sample_rate_hz = {RATE}", f"inputs = {json.dumps(inputs)}", f"outputs = {json.dumps(outputs)}", "",
        "[simulator]",
        "command = " + json.dumps(
            ["python3", str(EXAMPLES / "mujoco_simulator.py"), "model.xml", "--rate", str(RATE)]
            + [x for port in plant["ports"] for x in ("--port", port)]
            + [x for path in plant["parameters"] for x in ("--parameter", path)]
        ),
    ]
    for k, (u, y) in enumerate(zip(commands, measured)):
        y = np.round((y + noise * rng.normal(size=y.shape)) / step) * step
        last = k == len(levels) - 1
        write(folder, "fresh.csv" if last else f"r{k}.csv", inputs, outputs, u, y)
        if not last:
            lines += ["", "[[record]]", f'file = "r{k}.csv"'] + (['excitation = "zero"'] if levels[k] == 0 else [])
    (folder / "case.toml").write_text("\n".join(lines) + "\n")
    relative = float(np.sqrt(np.mean((1.04 * noise) ** 2 / np.mean(np.square(measured[-1]), axis=0))))
    return dict(kind=kind, plant=plant_name, effects=cause.names, places=listed(cause.place), numbers=cause.changed,
                sizes=cause.sizes, noise=relative)


def listed(place):
    return place if isinstance(place, list) else [place]


def asked(outside, together):
    """Yields kinds and plants without end."""
    plants = list(PLANTS)
    for at in itertools.count():
        if together:
            yield None, plants[at % len(plants)]
        elif outside:
            yield ("couples", "table") if at % 2 == 0 else ("slips", plants[at // 2 % len(plants)])
        else:
            yield KINDS[at % len(KINDS)], plants[(at // len(KINDS) + at) % len(plants)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--two", action="store_true", help="two causes in each case")
    which.add_argument("--outside", action="store_true", help="causes that no effect describes")
    given = parser.parse_args()
    labels = {}
    for at, (kind, plant) in enumerate(asked(given.outside, given.two)):
        label = draw(given.out / f"{len(labels) + 1:03}", kind, plant, given.seed * 1000 + at)
        if label is not None:
            labels[f"{len(labels) + 1:03}"] = label
        if len(labels) == given.cases:
            break
    (given.out / "labels.json").write_text(json.dumps(labels, indent=1) + "\n")


if __name__ == "__main__":
    main()
