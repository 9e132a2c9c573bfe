"""Draws cases of MuJoCo models whose simulation is a linearised model.json, for `plid gap diagnose`.

    python3 experiments/mujoco/linear.py draw OUT --cases 48 --seed 1
    python3 experiments/mujoco/linear.py score OUT --plid target/release/plid
    python3 experiments/mujoco/linear.py record OUT --seed 1

`draw` writes OUT/cases/NNN with model.json (the model linearised at rest), records at two levels and one without input,
and case.toml. The truth is the MuJoCo model itself with a cause. OUT/labels/NNN has the label and a record of which no
diagnosis knows. The sample rate of each case, and whether its sensors measure positions or velocities, are drawn.
`score` diagnoses the cases and compares the answers with the labels. Every other case declares no port. `record` writes
a few short cases, OUT/NAME, and OUT/labels.json: those of tests/mujoco. Needs NumPy, SciPy and `mujoco`.
"""

import argparse
import copy
import itertools
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import typing

import mujoco
import numpy as np
from cases import columns, gap

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "examples"))
from model_from_matrices import from_mujoco, state_space  # noqa: E402

SECONDS = 6.0
STEPS_PER_SAMPLE = 8


class Records(typing.NamedTuple):
    """What is recorded of a case. `levels` are those of the commands; the last record is withheld.

    The sample rate, and the kind of all sensors, are those of the plant if None.
    """

    most_samples: int
    levels: list
    digits: int
    rate: float | None = None
    sensor: str | None = None


DRAWN = Records(6000, [0.4, 1.0, 1.0, 0.0, 1.0], 9)
SHORT = Records(1200, [0.4, 1.0, 1.0, 1.0], 5)


class Plant:
    """A model and what is recorded of it. `outputs` are pairs of a joint and "position" or "velocity".

    If `nested`, each body hangs on the one before, and outputs and ports are those of bodies and not of joints.
    """

    def __init__(self, bodies, actuators, outputs, rate, level, nested=False, **numbers):
        self.nested = nested
        self.bodies, self.actuators, self.outputs = bodies, actuators, outputs
        self.rate, self.level, self.numbers = rate, level, numbers
        self.gravity = "gravity" in numbers

    def xml(self, **changed):
        numbers = {"loss": 0.0, "softness": 0.02, **self.numbers, **changed}
        gravity = "0 0 -9.81" if self.gravity else "0 0 0"
        return (
            f'<mujoco><option timestep="{1 / self.rate / STEPS_PER_SAMPLE}" integrator="implicitfast" '
            f'gravity="{gravity}"><flag contact="disable"/></option>'
            f"<worldbody>{self.bodies.format(**numbers)}</worldbody>"
            f"<actuator>{self.actuators.format(**numbers)}</actuator></mujoco>"
        )

    def seen(self, records):
        """The plant with the rate and the sensors of its records."""
        plant = copy.copy(self)
        plant.rate = records.rate or self.rate
        plant.outputs = [(joint, records.sensor or kind) for joint, kind in self.outputs]
        return plant

    def names(self):
        return [f"{kind[0]}_{joint}" for joint, kind in self.outputs]


CART = (
    '<body><joint name="rail" type="slide" axis="1 0 0" damping="{d}" frictionloss="{loss}" '
    'solreffriction="{softness} 1"/><geom type="box" size=".1 .05 .05" mass="{m}"/></body>'
)
HINGE = (
    '<body><joint name="axis" type="hinge" axis="0 1 0" damping="{d}" armature="{j}" frictionloss="{loss}" '
    'solreffriction="{softness} 1"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass="{m}"/></body>'
)
ARM = (
    '<body><joint name="drive" type="hinge" axis="0 0 1" damping="{d}" armature=".02"/><geom type="sphere" size=".03" '
    'mass=".3"/><body><joint name="elastic" type="hinge" axis="0 0 1" stiffness="{k}" damping=".04"/>'
    '<geom type="capsule" fromto="0 0 0 .35 0 0" size=".02" mass="{m}"/></body></body>'
)
# The masses of a chain move along one line; each joint is the stretch of a spring.
CHAIN = (
    '<body><joint name="a" type="slide" axis="1 0 0" stiffness="900" damping="{d}"/><geom type="box" '
    'size=".05 .05 .05" mass="1"/><body><joint name="b" type="slide" axis="1 0 0" stiffness="700" damping=".8"/>'
    '<geom type="box" size=".05 .05 .05" mass=".8"/><body><joint name="c" type="slide" axis="1 0 0" '
    'stiffness="500" damping=".6"/><geom type="box" size=".05 .05 .05" mass="{m}"/></body></body></body>'
)
MOTOR, SERVO = '<motor name="u" joint="{}"/>', '<position name="u" joint="{}" kp="{{kp}}" kv="{{kv}}"/>'

PLANTS = {
    "slider": Plant(CART, MOTOR.format("rail"), [("rail", "position")], 500.0, 6.0, m=1.0, d=3.0),
    "motor": Plant(HINGE, MOTOR.format("axis"), [("axis", "velocity")], 200.0, 0.6, m=0.4, d=0.15, j=0.01),
    "servo": Plant(
        HINGE, SERVO.format("axis"), [("axis", "position")], 500.0, 0.6, m=0.4, d=0.1, j=0.01, kp=14, kv=0.9
    ),
    "light servo": Plant(
        HINGE, SERVO.format("axis"), [("axis", "position")], 500.0, 0.4, m=0.4, d=0.1, j=0.01, kp=40, kv=0.15
    ),
    "arm": Plant(
        ARM, MOTOR.format("drive"), [("drive", "position"), ("elastic", "position")], 500.0, 0.8, m=0.5, d=0.3, k=30
    ),
    "pendulum": Plant(
        HINGE, MOTOR.format("axis"), [("axis", "position")], 200.0, 0.35, m=0.8, d=0.05, j=0.0, gravity=1
    ),
    "chain": Plant(
        CHAIN, MOTOR.format("a"), [("a", "position"), ("b", "position"), ("c", "position")], 500.0, 25.0, nested=True,
        m=0.6, d=1.0
    ),
}


class Truth:
    """A cause: changed numbers of the model, a changed command or measurement, a force at a joint, or a loop.

    `effects` are the names of the answers that are right, and `places` their locations. `numbers` are those of the
    model that differ. `controller` is the gain of a position loop whose output is the recorded input, and `torque_lag`
    the frequency in Hz of a lag behind a servo's own loop.
    """

    def __init__(
        self, effects, places=(), numbers=None, command=None, force=None, sense=None, controller=None, torque_lag=None
    ):
        self.effects, self.places, self.numbers = effects, places, numbers or {}
        self.command, self.force, self.sense = command, force, sense
        self.controller, self.torque_lag = controller, torque_lag


FRICTION = ["coulomb-friction", "stick-friction"]


def lag(hz):
    def command(u, dt):
        share, slow, out = 1 - np.exp(-2 * np.pi * hz * dt), 0.0, np.empty_like(u)
        for k, now in enumerate(u):
            slow += share * (now - slow)
            out[k] = slow
        return out

    return command


def delay(seconds):
    return lambda u, dt: np.concatenate([np.zeros(round(seconds / dt)), u])[: len(u)]


def late(samples):
    return lambda y: np.vstack([np.repeat(y[:1], samples, axis=0), y])[: len(y)]


def stop(limit, stiffness, damping):
    def force(d, v):
        beyond = abs(d) - limit
        return -np.sign(d) * max(stiffness * beyond + damping * v * np.sign(d), 0.0) if beyond > 0 else 0.0

    return force


def lost_motion(k, g):
    """Takes a spring away while its joint is within a gap."""
    return lambda d, v: k * np.clip(d, -g, g)


def drawn(kind, plant, big, reach):
    """A cause; `big` is near 1, and `reach` is the RMS displacement of each joint without it."""
    level, numbers = plant.level, plant.numbers
    joints = [joint for joint, _ in plant.outputs]
    at = {"input:u"} if len(joints) == 1 else {"input:u", "port:" + joints[0]}
    # A port that is not declared has the name of the output that shows its motion.
    last, far = joints[-1], {"port:" + joints[-1], "port:" + plant.names()[-1]}
    match kind:
        case "none":
            return Truth([])
        case "friction" | "weak friction" | "stiff friction":
            size = 0.04 if kind == "weak friction" else 0.12
            softness = 0.002 if kind == "stiff friction" else 0.02
            return Truth(FRICTION, at, dict(loss=size * big * level, softness=softness))
        case "mass":
            return Truth(["added-mass"], at if len(joints) == 1 else far, dict(m=numbers["m"] * (1 + 0.3 * big)))
        case "damping":
            return Truth(["added-damping", "modal-damping"], at, dict(d=numbers["d"] * (1 + 0.6 * big)))
        case "lag":
            return Truth(["actuator-lag"], {"input:u"}, command=lag(9.0 / big))
        case "delay":
            return Truth(["actuator-delay", "sensor-delay"], {"input:u", "output:*"}, command=delay(0.012 * big))
        case "sensor delay":
            sense = late(round(0.024 * plant.rate * big))
            return Truth(["sensor-delay", "actuator-delay"], {"input:u", "output:*"}, sense=sense)
        case "torque lag":
            return Truth(["actuator-lag"], {"loop:u"}, torque_lag=40.0 / big)
        case "stiffening":
            d = reach[last]
            k = 0.5 * numbers["k"] * big / d**2
            return Truth(["cubic-stiffness"], far, force=(last, lambda x, v: -k * x**3))
        case "stop":
            return Truth(["end-stop", "clearance"], far, force=(last, stop(1.2 * reach[last], 4 * numbers["k"], 0.1)))
        case "backlash":
            gap = 0.35 * big * reach[last]
            return Truth(["backlash", "clearance"], far, force=(last, lost_motion(numbers["k"], gap)))
        case "sine":
            return Truth(["gravity-sine", "cubic-stiffness"], at)
        case "closed loop":
            return Truth(FRICTION, at, dict(loss=0.12 * big * level), controller=60.0)
        case "sound loop":
            return Truth([], controller=60.0)
    raise ValueError(kind)


KINDS = [
    ("slider", "friction"), ("slider", "none"), ("servo", "lag"), ("pendulum", "sine"), ("chain", "mass"),
    ("motor", "friction"), ("arm", "stiffening"), ("slider", "weak friction"), ("servo", "delay"), ("slider", "mass"),
    ("light servo", "lag"), ("arm", "stop"), ("slider", "closed loop"), ("chain", "damping"), ("motor", "none"),
    ("slider", "stiff friction"), ("slider", "damping"), ("servo", "torque lag"), ("arm", "backlash"),
    ("chain", "sensor delay"), ("arm", "none"), ("slider", "sensor delay"), ("slider", "sound loop"), ("servo", "none"),
]

RATES, SENSORS = [200.0, 500.0, 1000.0], ["position", "velocity"]

# The cases that `record` writes.
RECORDED = [("slider", "friction"), ("servo", "lag"), ("pendulum", "sine"), ("motor", "none"), ("chain", "mass")]


def steps(rng, samples, level):
    """Steps of random size and length, smoothed."""
    u, at = np.zeros(samples), 0
    while at < samples:
        length = int(rng.integers(samples // 300 + 4, samples // 25))
        u[at : at + length] = level * rng.normal()
        at += length
    return lag(0.05)(u, 1.0)


def measure(plant, truth, u, noise, rng):
    """The command, outputs at the samples, and RMS displacement of each joint of the truth."""
    model = mujoco.MjModel.from_xml_string(plant.xml(**truth.numbers))
    data = mujoco.MjData(model)
    dt, fine = model.opt.timestep, np.repeat(u, STEPS_PER_SAMPLE)
    fine = truth.command(fine, dt) if truth.command else fine
    joints = {joint: model.joint(joint).id for joint, _ in plant.outputs}
    read = {"position": data.qpos, "velocity": data.qvel}
    joint, force = truth.force or (None, None)
    dof = model.joint(joint).id if joint else None
    y, sent, seen, held = [], [], [], 0.0
    for k, now in enumerate(fine):
        if k % STEPS_PER_SAMPLE == 0:
            y.append([read[kind][joints[at]] for at, kind in plant.outputs])
            if truth.controller:
                # It follows the reference, and its output is what the plant gets.
                held = truth.controller * (now / plant.level * 0.1 - y[-1][0] - noise[0] * rng.normal())
                sent.append(held)
        data.ctrl[0] = held if truth.controller else now
        if truth.torque_lag:
            wanted = model.actuator_gainprm[0, 0] * now + model.actuator_biasprm[0, 1:3] @ [data.qpos[0], data.qvel[0]]
            held += (1 - np.exp(-2 * np.pi * truth.torque_lag * dt)) * (wanted - held)
            data.qfrc_applied[0] = held - wanted
        if force is not None:
            data.qfrc_applied[dof] = force(data.qpos[dof], data.qvel[dof])
        seen.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    y = np.cumsum(y, axis=1) if plant.nested else np.array(y)
    y = truth.sense(y) if truth.sense else y
    reach = np.sqrt(np.mean(np.square(seen), axis=0))
    return np.array(sent) if truth.controller else u, y, {name: reach[at] for name, at in joints.items()}


def linearised(plant):
    """model.json of a plant without ports, and its ports, at the joints that are recorded."""
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        file.write(plant.xml())
        file.flush()
        matrices = from_mujoco(file.name)
    n = len(matrices["M"])
    # The coordinates of outputs and ports, of those of the joints.
    seen = np.tri(n) if plant.nested else np.eye(n)
    matrices |= {"outputs": seen, "ports": seen.T, "output_names": plant.names()}
    model = state_space(matrices, plant.rate, plant.outputs[0][1])
    ports = model.pop("ports")
    if len(ports) == 1:
        ports[0]["input"] = "u"
    if plant.outputs[0][1] == "velocity" and not np.any(matrices["K"]):
        # A motor that is seen by its speed is of first order: its position acts on nothing.
        ports = []
        for key in ["A", "B", "C"]:
            model[key] = (np.array(model[key])[1:] if key != "C" else np.array(model[key])).tolist()
        for key in ["A", "C"]:
            model[key] = np.array(model[key])[:, 1:].tolist()
        model["continuous"] = {
            "A": [model["continuous"]["A"][1][1:]], "B": model["continuous"]["B"][1:]
        }
    return model, ports


def write(path, outputs, u, y, digits):
    # Adding zero makes -0 a 0.
    table, header = np.column_stack([u, y]) + 0.0, ",".join(["u"] + outputs)
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt=f"%.{digits}g")


def draw(out, name, plant_name, kind, with_ports, seed, records=DRAWN):
    rng = np.random.default_rng(seed)
    plant, big = PLANTS[plant_name].seen(records), rng.uniform(0.8, 1.25)
    samples = min(round(SECONDS * plant.rate), records.most_samples)
    commands = [steps(rng, samples, level * plant.level) for level in records.levels]
    alone = drawn("sound loop", plant, 1.0, {}) if "loop" in kind else Truth([])
    _, nominal, reach = measure(plant, alone, commands[1], np.zeros(1), rng)
    noise = 0.004 * np.sqrt(np.mean(np.square(nominal), axis=0))
    truth = drawn(kind, plant, big, reach)
    model, ports = linearised(plant)
    folder, label = out / "cases" / name, out / "labels" / name
    for made in (folder, label):
        made.mkdir(parents=True, exist_ok=True)
    declared = with_ports and bool(ports)
    (folder / "model.json").write_text(json.dumps({**model, "ports": ports} if declared else model, indent=1) + "\n")
    lines = ['sim = "model.json"', f"sample_rate_hz = {plant.rate}"]
    lines += ['inputs = ["u"]', f"outputs = {json.dumps(plant.names())}"]
    for k, u in enumerate(commands):
        sent, y, _ = measure(plant, truth, u, noise, rng)
        # An encoder has steps of the size of its noise.
        y = np.round((y + noise * rng.normal(size=y.shape)) / noise) * noise
        if k == len(commands) - 1:
            write(label / "test_uy.csv", plant.names(), sent, y, records.digits)
            write(label / "test_u.csv", [], sent, np.zeros((len(sent), 0)), records.digits)
            size = np.sqrt(np.mean(np.square(y), axis=0))
        else:
            write(folder / f"r{k}.csv", plant.names(), sent, y, records.digits)
            quiet = not np.any(sent)
            lines += ["", "[[record]]", f'file = "r{k}.csv"'] + (['excitation = "zero"'] if quiet else [])
    (folder / "case.toml").write_text("\n".join(lines) + "\n")
    floor = float(np.sqrt(np.mean((1.04 * noise / size) ** 2)))
    found = dict(plant=plant_name, kind=kind, ports=declared, effects=truth.effects, noise=floor)
    found["places"] = sorted(truth.places)
    (label / "label.json").write_text(json.dumps(found, indent=1) + "\n")


def sampled(kind, seed):
    """Records of a rate and a kind of sensor that are drawn. The controller of a loop needs the position."""
    rng = np.random.default_rng([seed, 1])
    rate, sensor = float(rng.choice(RATES)), str(rng.choice(SENSORS))
    return DRAWN._replace(rate=rate, sensor="position" if "loop" in kind else sensor)


def record(out, seed):
    """Writes the short cases, without their withheld records."""
    labels = {}
    with tempfile.TemporaryDirectory() as folder:
        drawn_in = pathlib.Path(folder)
        for at, (plant, kind) in enumerate(RECORDED):
            name = f"{plant}-{kind}"
            draw(drawn_in, name, plant, kind, at % 2 == 0, seed * 1000 + at, SHORT)
            shutil.copytree(drawn_in / "cases" / name, out / name, dirs_exist_ok=True)
            labels[name] = json.loads((drawn_in / "labels" / name / "label.json").read_text())
    (out / "labels.json").write_text(json.dumps(labels, indent=1) + "\n")


def judge(label, answer):
    """Whether the main cause is right, whether its place is, and whether a wrong name is confident."""
    effects = answer["effects"]
    if not label["effects"]:
        return answer["verdict"] == "none", answer["verdict"] == "none", any(e["confidence"] >= 0.9 for e in effects)
    right = bool(effects) and effects[0]["effect"] in label["effects"]
    places = set(label["places"])
    anywhere = "output:*" in places or right and effects[0]["effect"] == "modal-damping"
    here = right and (anywhere or effects[0]["location"] in places)
    wrong = any(e["confidence"] >= 0.9 and e["effect"] not in label["effects"] for e in effects)
    return right, here, wrong


def score(out, plid):
    """Returns whether the main cause is right, whether its place is, whether a wrong name is confident, whether the
    prediction is close, and the label, of each case."""
    rows = []
    for label_file in sorted(out.glob("labels/*/label.json")):
        name, label = label_file.parent.name, json.loads(label_file.read_text())
        answers = out / "answers" / name
        began = time.monotonic()
        if not (answers / "diagnosis.json").exists():
            done = subprocess.run(
                [plid, "gap", "diagnose", out / "cases" / name / "case.toml", "--out", answers, "--force", "--quiet"],
                capture_output=True, text=True,
            )
            if done.returncode:
                print(name, label["plant"], label["kind"], "ENDED:", done.stderr.strip()[:300])
                rows.append((False, False, False, False, label))
                continue
            subprocess.run(
                [plid, "gap", "predict", "--diagnosis", answers / "diagnosis.json", "--input",
                 label_file.parent / "test_u.csv", "--out", answers / "predicted.csv", "--quiet"],
                capture_output=True,
            )
        took = time.monotonic() - began
        answer = json.loads((answers / "diagnosis.json").read_text())
        _, *outputs = (label_file.parent / "test_uy.csv").open().readline().strip().split(",")
        measured = columns(label_file.parent / "test_uy.csv", outputs)
        predicted = answers / "predicted.csv"
        left = gap(measured, columns(predicted, outputs)) if predicted.exists() else float("nan")
        given = answer["gap"]["as_given"]
        close = left <= max(3 * label["noise"], 0.15 * given)
        right, here, wrong = judge(label, answer)
        said = " + ".join(f'{e["effect"]}@{e["location"]} {e["confidence"]:.2f}' for e in answer["effects"])
        print(f'{name} {label["plant"]:12} {label["kind"]:15} {"ports" if label["ports"] else "":6}'
              f'{"right" if here else "name" if right else "MISS":6}{"SURE " if wrong else ""}'
              f'{said or answer["verdict"]}'
              f' | gap {given:.3f} -> {left:.4f}, noise {label["noise"]:.4f}{"" if close else " FAR"}, {took:.1f} s')
        rows.append((right, here, wrong, close, label))
    return rows


def summarise(rows):
    caused, sound = [r for r in rows if r[4]["effects"]], [r for r in rows if not r[4]["effects"]]
    print(f"\nright main cause {sum(r[0] for r in caused)} of {len(caused)}, at its place {sum(r[1] for r in caused)}; "
          f"nothing missing {sum(r[0] for r in sound)} of {len(sound)}; confident and wrong {sum(r[2] for r in rows)}; "
          f"gap within three times the noise or 15 % of that as given {sum(r[3] for r in rows)} of {len(rows)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    drawing = commands.add_parser("draw", help="draw cases")
    drawing.add_argument("out", type=pathlib.Path)
    drawing.add_argument("--cases", type=int, default=2 * len(KINDS))
    drawing.add_argument("--seed", type=int, default=1)
    recording = commands.add_parser("record", help="draw the short cases of tests/mujoco")
    recording.add_argument("out", type=pathlib.Path)
    recording.add_argument("--seed", type=int, default=1)
    scoring = commands.add_parser("score", help="diagnose drawn cases and compare the answers with their labels")
    scoring.add_argument("out", type=pathlib.Path)
    scoring.add_argument("--plid", default="target/release/plid")
    given = parser.parse_args()
    if given.command == "score":
        return summarise(score(given.out, given.plid))
    if given.command == "record":
        return record(given.out, given.seed)
    for at, (plant, kind) in zip(range(given.cases), itertools.cycle(KINDS)):
        with_ports, seed = (at + at // len(KINDS)) % 2 == 0, given.seed * 1000 + at
        draw(given.out, f"{at + 1:03}", plant, kind, with_ports, seed, sampled(kind, seed))


if __name__ == "__main__":
    main()
