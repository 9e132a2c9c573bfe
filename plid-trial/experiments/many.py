#!/usr/bin/env python3
"""Measures the overhead of a trial of many cases beyond the diagnosis: files, bytes, and the time of each step.

    experiments/trials/many.py PROGRAM OUT [--cases 10000] [--shards 16]

Draws a trial of tiny cases (one channel, short records, the effect sensor-offset) into the new folder OUT and lets the
program diagnose the first one. That answer is copied to all other cases, as shards would have left it, so the scores
mean nothing. Then the shards are merged and scored. Printed are the time, the processor time and the largest memory of
each step, and the files, folders, bytes and blocks on the disk of each folder.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

CONFIG = """name = "many"
[cases]
singles_per_effect = {cases}
[draw]
effects = ["sensor-offset"]
least_over_floor = 5.0
length = 0.1
channels = [{{ inputs = 1, outputs = 1 }}]
"""


def step(name, program, *arguments):
    """Runs the program, and prints its time, its processor time and its largest memory."""
    start = time.monotonic()
    process = subprocess.Popen([program, "--quiet", *map(str, arguments)], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - start
    if status != 0:
        sys.exit(f"{name} failed")
    processor = usage.ru_utime + usage.ru_stime
    print(f"{name:<10} {seconds:8.1f} s {processor:8.1f} s of a core {usage.ru_maxrss / 1024:8.0f} MiB", flush=True)


def share_out(trial, shards):
    """Copies the one answer to all cases, in folders like those of shards."""
    cases = [case["case"] for case in json.loads((trial / "trial.json").read_text())["cases"]]
    given = trial / "shards" / f"1-of-{len(cases)}"
    complete = json.loads((given / "shard.json").read_text())
    answer = {path.name: path.read_bytes() for path in (given / cases[0]).iterdir()}
    for number in range(1, shards + 1):
        own = cases[number - 1 :: shards]
        folder = trial / "shards" / f"{number}-of-{shards}"
        for case in own:
            place = folder / case
            place.mkdir(parents=True)
            for name, content in answer.items():
                if name == "answer.json":
                    content = json.dumps(json.loads(content) | {"case": case}).encode()
                (place / name).write_bytes(content)
        marker = complete | {"shard": {"number": number, "of": shards}, "cases": own}
        (folder / "shard.json").write_text(json.dumps(marker))
    shutil.rmtree(given)


def count(name, folder):
    """Prints how many files and folders a folder holds, and their size."""
    files = folders = size = blocks = 0
    for place, _, names in os.walk(folder):
        folders += 1
        for path in [place, *(os.path.join(place, file) for file in names)]:
            blocks += 512 * os.lstat(path).st_blocks
        files += len(names)
        size += sum(os.lstat(os.path.join(place, file)).st_size for file in names)
    print(f"{name:<10} {files:8} files {folders:8} folders {size / 1e6:9.1f} MB {blocks / 1e6:9.1f} MB on the disk")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=Path)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--shards", type=int, default=16)
    arguments = parser.parse_args()
    out = arguments.out
    out.mkdir(parents=True)
    config, trial, sealed = out / "many.toml", out / "trial", out / "sealed"
    config.write_text(CONFIG.format(cases=arguments.cases))
    program = shutil.which(arguments.program) or sys.exit(f"{arguments.program} is not a program")
    step("draw", program, "gap", "trial", "draw", config, "--out", trial, "--sealed", sealed, "--seed", 1)
    step("diagnose 1", program, "gap", "trial", "diagnose", trial, "--shard", f"1/{arguments.cases}")
    share_out(trial, arguments.shards)
    step("merge", program, "gap", "trial", "merge", trial)
    step("score", program, "gap", "trial", "score", trial, "--sealed", sealed, "--out", out / "score")
    for name, folder in [
        ("cases", trial / "cases"),
        ("shards", trial / "shards"),
        ("answers", trial / "answers"),
        ("sealed", sealed),
        ("score", out / "score"),
    ]:
        count(name, folder)
    print(f"trial.json {os.path.getsize(trial / 'trial.json') / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
