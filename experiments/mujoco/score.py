"""Diagnoses drawn cases and compares the answers with their labels.

    python3 experiments/mujoco/score.py CASES --plid target/release/plid
"""

import argparse
import csv
import json
import pathlib
import subprocess
import time

import numpy as np


def gap(measured, predicted):
    """RMS of the error over RMS of the output, each output scaled to unit RMS."""
    return float(np.sqrt(np.mean(np.mean((measured - predicted) ** 2, axis=0) / np.mean(measured**2, axis=0))))


def columns(path, names):
    with open(path, newline="") as file:
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


def diagnose(plid, folder):
    began = time.monotonic()
    out = folder / "answer"
    subprocess.run([plid, "gap", "diagnose", folder / "case.toml", "--out", out, "--force", "--quiet"], check=True)
    took = time.monotonic() - began
    subprocess.run(
        [plid, "gap", "predict", "--diagnosis", out / "diagnosis.json", "--input", folder / "fresh.csv", "--out",
         out / "fresh.csv", "--folder", folder, "--quiet"], check=True,
    )
    return json.loads((out / "diagnosis.json").read_text()), took


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
    first = effects[0]
    named = [first["effect"] + "@" + first["location"]] + [w for c in answer["not_separable"] for w in c]
    right = [name for name in named if name.split("@")[0] in label["effects"]]
    if any(name.split("@")[1] in label["places"] for name in right):
        return "right"
    if right:
        return "place"
    return "CONFIDENT" if first["confidence"] >= 0.9 else "wrong"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--plid", default="plid")
    parser.add_argument("--only", nargs="*")
    given = parser.parse_args()
    labels = json.loads((given.cases / "labels.json").read_text())
    tally, ratios = {}, []
    print(f"{'case':5}{'plant':10}{'cause':16}{'judged':10}{'gap':>8}{'fresh':>8}{'noise':>8}{'runs':>6}{'s':>6}  answer")
    for name, label in labels.items():
        if given.only and name not in given.only:
            continue
        folder = given.cases / name
        answer, took = diagnose(given.plid, folder)
        outputs = list(answer["where"]["channels"])
        fresh = gap(columns(folder / "fresh.csv", outputs), columns(folder / "answer" / "fresh.csv", outputs))
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
