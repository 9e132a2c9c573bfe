"""Diagnoses drawn cases and compares the answers with their labels.

    python3 experiments/mujoco/score.py CASES                              # by the Python package
    python3 experiments/mujoco/score.py CASES --plid target/release/plid   # by the program, which runs a command

The summary counts the answers, the cases within the bounds on the gap, the runs and the time, and the parameters whose
true value lies in the stated interval. The bound on the gap on a fresh record is 1.5 times the noise where the law of
the truth is in the vocabulary, and 3 times where a law of the vocabulary is only close to it. Needs
`pip install ./python[mujoco]`.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import time

import numpy as np
from cases import cases, columns, gap

from plid import gap as plid_gap

# Kinds of causes whose law is not in the vocabulary, although one nearby is. MuJoCo's dry friction holds by a soft
# constraint, which gives way a little; the vocabulary has friction that is smooth in the velocity, and friction that
# holds exactly.
NEAR_MISSES = {"friction"}

# Largest gap on a fresh record over the noise, by how close the vocabulary comes to the truth.
BOUNDS = {"law in the vocabulary": 1.5, "near miss": 3.0, "outside the vocabulary": None}


def by_program(plid, case):
    """Returns diagnosis.json, the time that it took in s, and the gap on the fresh record."""
    began = time.monotonic()
    out = case.folder / "answer"
    subprocess.run(
        [plid, "gap", "diagnose", case.folder / "case.toml", "--out", out, "--force", "--quiet"], check=True
    )
    took = time.monotonic() - began
    subprocess.run(
        [plid, "gap", "predict", "--diagnosis", out / "diagnosis.json", "--input", case.folder / "fresh.csv", "--out",
         out / "fresh.csv", "--folder", case.folder, "--quiet"], check=True,
    )
    answer = json.loads((out / "diagnosis.json").read_text())
    return answer, took, gap(case.read("fresh.csv")[1], columns(out / "fresh.csv", case.case["outputs"]))


def by_package(case):
    """As `by_program`, with the same model and the same options as Python objects."""
    simulator = plid_gap.from_mujoco(
        case.folder / "model.xml", rate=case.rate, joints=case.listed("port"), parameters=case.listed("parameter")
    )
    records = [plid_gap.Record(*case.read(name), name=name) for name in case.records()]
    began = time.monotonic()
    diagnosis = plid_gap.diagnose(records, simulator=simulator, rate=case.rate, progress=False)
    took = time.monotonic() - began
    u, y = case.read("fresh.csv")
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


def covered(label, answer):
    """Yields for each stated number whose true value is known whether that lies in the interval."""
    for effect in answer["effects"]:
        if effect["effect"] == "simulator-parameter":
            low, high = effect["change"]["to"]["ci95"]
            true = label["numbers"].get(effect["location"].removeprefix("parameter:"))
            if true is not None:
                yield low <= true <= high
        for name, true in label["sizes"].get(f"{effect['effect']}@{effect['location']}", {}).items():
            low, high = effect["parameters"][name]["ci95"]
            yield low <= true <= high


def law(label):
    """Returns how close the vocabulary comes to the laws of a truth, which is a key of BOUNDS."""
    if label["effects"] is None:
        return "outside the vocabulary"
    return "near miss" if NEAR_MISSES & set(label["kind"].split("+")) else "law in the vocabulary"


def gaps(labels, ratios):
    """Yields a line for each class of laws: the gaps over the noise, and how many are within the bound."""
    for name, bound in BOUNDS.items():
        of = np.array([ratio for label, ratio in zip(labels, ratios, strict=True) if law(label) == name])
        if len(of):
            within = "" if bound is None else "; " + share(of <= bound, f"at most {bound:g} in")
            sizes = f"median {np.median(of):.2f}, largest {of.max():.2f}"
            yield f"gap on a fresh record over noise, {name}: {sizes}{within}"


def share(of, what):
    return f"{what} {sum(of)} of {len(of)}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--plid", help="the program; without it the Python package diagnoses")
    parser.add_argument("--only", nargs="*")
    given = parser.parse_args()
    tally, rows, inside, labels = collections.Counter(), [], [], []
    print(f"{'case':5}{'plant':10}{'cause':24}{'judged':10}{'gap':>8}{'fresh':>8}{'noise':>8}{'runs':>6}{'s':>6}"
          "  answer")
    for name, case in cases(given.cases, given.only):
        label = case.label
        answer, took, fresh = by_program(given.plid, case) if given.plid else by_package(case)
        verdict, runs = judge(label, answer), answer["simulator"]["runs"]
        tally[verdict] += 1
        rows.append((fresh / label["noise"], runs, took))
        labels.append(label)
        inside += covered(label, answer)
        said = " + ".join(f"{e['effect']}@{e['location']} {e['confidence']:.2f}" for e in answer["effects"])
        said = said or answer["verdict"]
        print(
            f"{name:5}{label['plant']:10}{label['kind']:24}{verdict:10}{answer['gap']['as_given']:8.3f}{fresh:8.4f}"
            f"{label['noise']:8.4f}{runs:6}{took:6.1f}  {said}", flush=True,
        )
    ratios, runs, times = (np.array(of) for of in zip(*rows, strict=True))
    print(dict(tally))
    print(*gaps(labels, ratios), sep="\n")
    print(f"runs: median {np.median(runs):.0f}; {share(runs <= 400, 'at most 400 in')}")
    print(f"time: median {np.median(times):.1f} s; {share(times <= 60, 'at most 60 s in')}")
    print(share(inside, "true values in their intervals:"))


if __name__ == "__main__":
    main()
