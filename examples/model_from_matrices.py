"""Writes a model.json with ports from the matrices of a mechanical model: M q'' + C q' + K q = F u.

    python3 examples/model_from_matrices.py MATRICES.npz --rate 500 --kind position --out model.json
    python3 examples/model_from_matrices.py --mujoco arm.xml --rate 500 --kind position --out model.json
    python3 examples/model_from_matrices.py --urdf arm.urdf --rate 500 --kind position --out model.json

MATRICES.npz holds, with n coordinates q:

    M, C, K    n x n     mass, damping and stiffness
    inputs     n x m     the force of a unit of each input on each coordinate (F)
    outputs    p x n     each output as a combination of coordinates
    ports      n x r     the direction of each port: its force acts along it, its displacement is measured along it
    input_names, output_names, port_names   optional lists of words

The matrices of a finite-element program have more coordinates than a simulation needs: `--modes N` keeps the N modes of
lowest frequency. What the other modes give way under a constant force is then missing.

From a MuJoCo model, the inputs are the actuators, and each joint is an output and a port. A URDF has no actuators: each
joint that is not fixed gets a motor, whose input is its force or torque. An input with the name of a joint is called
NAME_command, because a file of records has one column of each name. The model is linearised at its initial position;
only hinges and slides are allowed, and contacts are left out. Needs NumPy and SciPy, and `mujoco` for the last two
forms.
"""

import argparse
import json
import sys

import numpy as np
from scipy.linalg import eigh, expm

STEP = 1e-6  # of the finite differences, in rad or m and their derivatives


def from_mujoco(path):
    """The matrices of a MuJoCo model at its initial position."""
    import mujoco

    return linearised(mujoco.MjModel.from_xml_path(path), path)


def from_urdf(path):
    """The matrices of a robot with a motor at each joint, at its initial position. Meshes are left out."""
    import mujoco

    spec = mujoco.MjSpec.from_file(path)
    for joint in spec.joints:
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
    return linearised(spec.compile(), path)


def linearised(model, path):
    """The matrices of a compiled MuJoCo model at its initial position."""
    import mujoco

    data = mujoco.MjData(model)
    if model.nq != model.nv:
        sys.exit(f"{path}: only hinges and slides have matrices; remove free and ball joints")
    n, m = model.nv, model.nu
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    start = data.qpos.copy()

    def force(q, v, u):
        data.qpos[:], data.qvel[:], data.ctrl[:] = start + q, v, u
        mujoco.mj_forward(model, data)
        return data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias

    def slope(count, at):
        half = [(force(*at(STEP * e)) - force(*at(-STEP * e))) / (2 * STEP) for e in np.eye(count)]
        return np.array(half).reshape(count, n).T

    zero, still = np.zeros(n), np.zeros(m)
    mass = np.zeros((n, n))
    force(zero, zero, still)
    for column, unit in zip(mass, np.eye(n)):
        mujoco.mj_mulM(model, data, column, unit)  # M is symmetric
    joints = [model.joint(j).name or f"joint{j + 1}" for j in range(model.njnt)]
    actuators = [model.actuator(i).name or f"u{i + 1}" for i in range(m)]
    return {
        "M": mass,
        "C": -slope(n, lambda e: (zero, e, still)),
        "K": -slope(n, lambda e: (e, zero, still)),
        "inputs": slope(m, lambda e: (zero, zero, e)),
        "outputs": np.eye(n),
        "ports": np.eye(n),
        "input_names": [f"{name}_command" if name in joints else name for name in actuators],
        "output_names": joints,
        "port_names": joints,
    }


def names(matrices, key, count, letter):
    """The names under a key, or u1, u2, ..."""
    return [str(name) for name in matrices[key]] if key in matrices else [f"{letter}{k + 1}" for k in range(count)]


def lowest_modes(matrices, count):
    """The matrices in the coordinates of the modes of lowest frequency."""
    mass, damping, stiffness, force, outputs, ports = (
        np.atleast_2d(np.asarray(matrices[key], float)) for key in ["M", "C", "K", "inputs", "outputs", "ports"]
    )
    if not 1 <= count <= len(mass):
        sys.exit(f"--modes {count}: the matrices have {len(mass)} modes")
    _, shapes = eigh(stiffness, mass, subset_by_index=[0, count - 1])
    squares = {key: shapes.T @ square @ shapes for key, square in [("M", mass), ("C", damping), ("K", stiffness)]}
    return matrices | squares | {"inputs": shapes.T @ force, "outputs": outputs @ shapes, "ports": shapes.T @ ports}


def state_space(matrices, rate, kind):
    """model.json: the states are q and q'."""
    mass, damping, stiffness, force, outputs, ports = (
        np.atleast_2d(np.asarray(matrices[key], float)) for key in ["M", "C", "K", "inputs", "outputs", "ports"]
    )
    n, m, p, r = len(mass), force.shape[1], len(outputs), ports.shape[1]
    inverse = np.linalg.inv(mass)
    zero = np.zeros((n, n))
    a = np.block([[zero, np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.vstack([np.zeros((n, m)), inverse @ force])
    # The input is held over a sample.
    held = expm(np.block([[a, b], [np.zeros((m, 2 * n + m))]]) / rate)
    of_states = {
        "position": np.hstack([outputs, np.zeros((p, n))]),
        "velocity": np.hstack([np.zeros((p, n)), outputs]),
        "acceleration": outputs @ a[n:],
    }[kind]
    direct = outputs @ inverse @ force if kind == "acceleration" else np.zeros((p, m))
    outputs_named = names(matrices, "output_names", p, "y")

    def port(k, name):
        direction = ports[:, k]
        entry = {
            "name": name,
            "force": np.concatenate([np.zeros(n), inverse @ direction]).tolist(),
            "displacement": np.concatenate([direction, np.zeros(n)]).tolist(),
            "velocity": np.concatenate([np.zeros(n), direction]).tolist(),
        }
        if kind == "acceleration":
            entry["output"] = (outputs @ inverse @ direction).tolist()
        return entry

    return {
        "format": "state-space",
        "sample_rate_hz": rate,
        "inputs": names(matrices, "input_names", m, "u"),
        "outputs": outputs_named,
        "output_kinds": {name: kind for name in outputs_named},
        "A": held[: 2 * n, : 2 * n].tolist(),
        "B": held[: 2 * n, 2 * n :].tolist(),
        "C": of_states.tolist(),
        "D": direct.tolist(),
        "continuous": {"A": a.tolist(), "B": b.tolist()},
        "ports": [port(k, name) for k, name in enumerate(names(matrices, "port_names", r, "port"))],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("matrices", nargs="?", help="an .npz file with the matrices")
    parser.add_argument("--mujoco", metavar="XML", help="a MuJoCo model in place of the matrices")
    parser.add_argument("--urdf", metavar="URDF", help="a robot in place of the matrices, with a motor at each joint")
    parser.add_argument("--rate", type=float, required=True, help="sample rate of the records in Hz")
    parser.add_argument("--kind", choices=["position", "velocity", "acceleration"], required=True)
    parser.add_argument("--modes", type=int, metavar="N", help="keep the N modes of lowest frequency")
    parser.add_argument("--out", required=True, metavar="FILE")
    arguments = parser.parse_args()
    given = [arguments.matrices, arguments.mujoco, arguments.urdf]
    if sum(path is not None for path in given) != 1:
        parser.error("give one of MATRICES.npz, --mujoco XML and --urdf URDF")
    if arguments.mujoco:
        matrices = from_mujoco(arguments.mujoco)
    elif arguments.urdf:
        matrices = from_urdf(arguments.urdf)
    else:
        matrices = dict(np.load(arguments.matrices))
    missing = [key for key in ["M", "C", "K", "inputs", "outputs", "ports"] if key not in matrices]
    if missing:
        sys.exit(f"{arguments.matrices}: no array {', '.join(missing)}")
    if arguments.modes is not None:
        matrices = lowest_modes(matrices, arguments.modes)
    with open(arguments.out, "w") as file:
        json.dump(state_space(matrices, arguments.rate, arguments.kind), file, indent=1)


if __name__ == "__main__":
    main()
