"""Diagnoses drawn cases and compares the answers with their labels.

    python3 experiments/mujoco/score.py CASES                              # by the Python package
    python3 experiments/mujoco/score.py CASES --plid target/release/plid   # by the program, which runs a command

Needs `pip install ./python[mujoco]`.
"""

import argparse
import csv
import json
import pathlib
import subprocess
import time
import tomllib

import numpy as np

from plid import gap as plid_gap


def gap(measured, predicted):
    """RMS of the error over RMS of the output, each output scaled to unit RMS."""
    return float(np.sqrt(np.mean(np.mean((measured - predicted) ** 2, axis=0) / np.mean(measured**2, axis=0))))


def columns(path, names):
    with open(path, newline="") as file:
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


def by_program(plid, folder):
    """Returns diagnosis.json, the time that it took in s, and the gap on the fresh record."""
    began = time.monotonic()
    out = folder / "answer"
    subprocess.run([plid, "gap", "diagnose", folder / "case.toml", "--out", out, "--force", "--quiet"], check=True)
    took = time.monotonic() - began
    subprocess.run(
        [plid, "gap", "predict", "--diagnosis", out / "diagnosis.json", "--input", folder / "fresh.csv", "--out",
         out / "fresh.csv", "--folder", folder, "--quiet"], check=True,
    )
    answer = json.loads((out / "diagnosis.json").read_text())
    outputs = list(answer["where"]["channels"])
    return answer, took, gap(columns(folder / "fresh.csv", outputs), columns(out / "fresh.csv", outputs))


def by_package(folder):
    """As `by_program`, with the same model and the same options as Python objects."""
    case = tomllib.loads((folder / "case.toml").read_text())
    words, rate = case["simulator"]["command"], case["sample_rate_hz"]
    ports, parameters = ([words[k + 1] for k, word in enumerate(words) if word == f"--{key}"]
                         for key in ("port", "parameter"))
    simulator = plid_gap.from_mujoco(folder / "model.xml", rate=rate, joints=ports, parameters=parameters)

    def read(name):
        return columns(folder / name, case["inputs"]), columns(folder / name, case["outputs"])

    records = [plid_gap.Record(*read(record["file"]), name=record["file"]) for record in case["record"]]
    began = time.monotonic()
    diagnosis = plid_gap.diagnose(records, simulator=simulator, rate=rate, progress=False)
    took = time.monotonic() - began
    u, y = read("fresh.csv")
    return diagnosis.data, took, gap(y, diagnosis.predict(u))


def judge(label, answer):
    """Returns whether the answer is right, right in kind but not in place, wrong, or wrong with confidence."""
    effects = answer["effects"]
    if label["effects"] == []:
        return "right" if answer["verdict"] == "none" else "wrong"
    if label["effects"] is None:
        sure = max((effect["confidence"] for effect in effects), default=0.0)
        return "right" if sure < 0.5 else "CONFIDENT" if sure >= 0.9 else "wrong"
    if not effects:
        return "wrong"
    if isinstance(label["effects"][0], list):
        return judge_two(label, effects)
    first = effects[0]
    named = [first["effect"] + "@" + first["location"]] + [w for c in answer["not_separable"] for w in c]
    right = [name for name in named if name.split("@")[0] in label["effects"]]
    if any(name.split("@")[1] in label["places"] for name in right):
        return "right"
    if right:
        return "place"
    return "CONFIDENT" if first["confidence"] >= 0.9 else "wrong"


def judge_two(label, effects):
    """Returns "right" if both causes are named, "one" for one of them, else whether the first is sure."""
    def named(names, places):
        return any(one["effect"] in names and one["location"] in places for one in effects)

    found = sum(named(*cause) for cause in zip(label["effects"], label["places"], strict=True))
    return ["CONFIDENT" if effects[0]["confidence"] >= 0.9 else "wrong", "one", "right"][found]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--plid", help="the program; without it the Python package diagnoses")
    parser.add_argument("--only", nargs="*")
    given = parser.parse_args()
    labels = json.loads((given.cases / "labels.json").read_text())
    tally, ratios = {}, []
    print(f"{'case':5}{'plant':10}{'cause':16}{'judged':10}{'gap':>8}{'fresh':>8}{'noise':>8}{'runs':>6}{'s':>6}  answer")
    for name, label in labels.items():
        if given.only and name not in given.only:
            continue
        folder = given.cases / name
        answer, took, fresh = by_program(given.plid, folder) if given.plid else by_package(folder)
        verdict = judge(label, answer)
        tally[verdict] = tally.get(verdict, 0) + 1
        ratios.append(fresh / label["noise"])
        said = " + ".join(f"{e['effect']}@{e['location']} {e['confidence']:.2f}" for e in answer["effects"])
        said = said or answer["verdict"]
        print(
            f"{name:5}{label['plant']:10}{label['kind']:16}{verdict:10}{answer['gap']['as_given']:8.3f}{fresh:8.4f}"
            f"{label['noise']:8.4f}{answer['simulator']['runs']:6}{took:6.1f}  {said}", flush=True,
        )
    print(tally, f"fresh gap over noise: median {np.median(ratios):.2f}, at most 1.5 in {np.mean(np.array(ratios) <= 1.5):.0%}")


if __name__ == "__main__":
    main()
