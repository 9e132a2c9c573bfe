"""Fits named parameters by plid, `mujoco.sysid` and SciPy's least squares, side by side on drawn cases.

    python3 experiments/mujoco/draw.py CASES --cases 40 --seed 7
    python3 experiments/mujoco/compare.py CASES

Where a named parameter is wrong, all should find the same optimum. Where an effect is missing, the two others have only
the parameters to explain it with; plid may also name the effect. All start from the same model, see the same records
and weigh each output by the noise in the record without input. A run is one record simulated once. Needs
`pip install ./python[mujoco] "mujoco[sysid]" scipy`.
"""

import argparse
import contextlib
import io
import pathlib
import time

import mujoco
import numpy as np
import scipy.optimize
from cases import cases, gap
from mujoco import sysid

from plid import gap as plid_gap

# Bounds of a parameter, over its nominal value.
BOUNDS = 0.1, 10.0


class Problem:
    """The records of a case, and its model with other parameters."""

    def __init__(self, case):
        self.case, self.names = case, case.listed("parameter")
        self.file = case.folder / "model.xml"
        self.simulator = plid_gap.from_mujoco(
            self.file, rate=case.rate, joints=case.listed("port"), parameters=self.names
        )
        self.nominal = np.array([self.simulator.parameters[name].value for name in self.names])
        self.records = [case.read(name) for name in case.records()]
        quiet = next(y for u, y in self.records if not u.any())
        self.noise = quiet.std(axis=0)
        self.runs = 0

    def simulate(self, values, u):
        self.runs += 1
        return self.simulator.run(values, u)

    def residual(self, values):
        return np.concatenate([((self.simulate(values, u) - y) / self.noise).ravel() for u, y in self.records])

    def fresh(self, values):
        u, y = self.case.read("fresh.csv")
        return gap(y, self.simulator.run(values, u))


def by_scipy(problem):
    """Least squares in parameters over their nominal values."""
    def residual(x):
        return problem.residual(x * problem.nominal)

    found = scipy.optimize.least_squares(residual, np.ones(len(problem.names)), bounds=BOUNDS, x_scale="jac")
    return found.x * problem.nominal


def modifier(name):
    """Returns what puts a parameter into the specification of a model."""
    kind, element, field = name.split(".")

    def put(spec, parameter):
        value = float(parameter.value[0])
        if kind == "joint":
            joint = spec.joint(element)
            old = getattr(joint, field)
            # Some versions have an array for each joint.
            setattr(joint, field, value if np.ndim(old) == 0 else [value, *np.ravel(old)[1:]])
        else:
            spec.body(element).geoms[0].mass = value

    return put


def by_sysid(problem):
    """`mujoco.sysid` with its own optimiser; its rollouts are counted."""
    case, spec = problem.case, mujoco.MjSpec.from_file(str(problem.file))
    model = spec.compile()
    steps = round(1 / (case.rate * model.opt.timestep))
    start = sysid.create_initial_state(model, model.qpos0)
    controls, sensors, names = [], [], case.records()
    for u, y in problem.records:
        fine = np.arange(len(u) * steps) * model.opt.timestep
        controls.append(sysid.TimeSeries.from_control_names(fine, np.repeat(u, steps, axis=0), model))
        sensors.append(sysid.TimeSeries.from_names(np.arange(len(y)) / case.rate, y, model))
    sequences = sysid.ModelSequences("case", spec, names, [start] * len(names), controls, sensors)

    def rollout(models, **rest):
        problem.runs += len(models)
        return sysid.sysid_rollout(models=models, **{key: rest[key] for key in (
            "datas", "control_signal", "initial_states", "rollout_signal_mapping", "rollout_state_mapping",
            "ctrl_mapping")})

    def weighed(params, predicted, measured, model, return_pred_all, **_):
        # The sensors that a rollout records are those at the start of each step.
        seen = sysid.TimeSeries(measured.times, predicted.data[::steps], measured.signal_mapping)
        return (seen.data - measured.data) / problem.noise, seen, measured

    parameters = sysid.ParameterDict()
    for name, value in zip(problem.names, problem.nominal, strict=True):
        low, high = (factor * value for factor in BOUNDS)
        parameters.add(sysid.Parameter(name, value, low, high, modifier=modifier(name)))
    residual = sysid.build_residual_fn(
        models_sequences=[sequences], modify_residual=weighed, custom_rollout=rollout, n_threads=1,
        resample_true=False,
    )
    # Its optimiser prints each iteration.
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False, x_scale="jac")
    return found.as_vector()


def timed(method, problem):
    """Returns values, runs and seconds of a method."""
    problem.runs, began = 0, time.monotonic()
    values = method(problem)
    return values, problem.runs, time.monotonic() - began


def by_plid(problem):
    """Returns the diagnosis and the time that it took in s."""
    names = problem.case.records()
    records = [plid_gap.Record(u, y, name=name) for name, (u, y) in zip(names, problem.records, strict=True)]
    began = time.monotonic()
    return plid_gap.diagnose(records, simulator=problem.simulator, rate=problem.case.rate, progress=False), began


def changes(problem, values):
    """Returns the parameters over their nominal values, in words."""
    return ", ".join(f"{name} {value / old:.3f}" for name, value, old in
                     zip(problem.names, values, problem.nominal, strict=True))


def agrees(diagnosis, problem, values):
    """Returns whether other values lie in plid's intervals, for the parameters that it names."""
    at = dict(zip(problem.names, values, strict=True))
    changed = [effect for effect in diagnosis.effects if effect.change]
    named = [[*one.change["to"]["ci95"], at[one.location.removeprefix("parameter:")]] for one in changed]
    return "-" if not named else "yes" if all(low <= value <= high for low, high, value in named) else "no"


def row(*cells):
    print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


def compare(name, case):
    """Prints three rows: plid, mujoco.sysid and SciPy."""
    problem, label = Problem(case), case.label
    diagnosis, began = by_plid(problem)
    took = time.monotonic() - began
    u, y = case.read("fresh.csv")
    fresh = gap(y, diagnosis.predict(u)) / label["noise"]
    truth = ", ".join(f"{key} {value / problem.nominal[problem.names.index(key)]:.3f}"
                      for key, value in label["numbers"].items()) or label["kind"]
    said = " and ".join(
        f"{e.location.removeprefix('parameter:')} {e.change['to']['value'] / e.change['from']:.3f}" if e.change
        else f"{e.effect} at {e.location}" for e in diagnosis.effects) or diagnosis.verdict
    row(name, label["plant"], truth, "plid", said, "", f"{fresh:.2f}", diagnosis.data["simulator"]["runs"],
        f"{took:.1f}")
    for method, words in ((by_sysid, "mujoco.sysid"), (by_scipy, "SciPy")):
        values, runs, took = timed(method, problem)
        row("", "", "", words, changes(problem, values), agrees(diagnosis, problem, values),
            f"{problem.fresh(values) / label['noise']:.2f}", runs, f"{took:.1f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--only", nargs="*")
    given = parser.parse_args()
    row("case", "plant", "truth", "by", "answer, or parameters over nominal", "in plid's interval",
        "gap on a fresh record over noise", "runs", "s")
    row(*["---"] * 9)
    for name, case in cases(given.cases, given.only):
        if case.label["effects"] and not isinstance(case.label["effects"][0], list):
            compare(name, case)


if __name__ == "__main__":
    main()
