#!/usr/bin/env python3
"""Copies a case with records that differ in about the tenth digit: an answer must not depend on that.

    rounding.py CASE-FOLDER OUT [--copies 3] [--size 1e-10]

OUT/NAME-1, OUT/NAME-2, ... get the files of CASE-FOLDER. Every number of every .csv file is multiplied by one plus
`size` times a standard normal number; the copy's number is the seed. Standard library only.
"""
import argparse
import csv
import pathlib
import random
import shutil


def changed(cell, size, rng):
    """Returns a cell with a changed number. Missing samples and names stay as they are."""
    try:
        value = float(cell)
    except ValueError:
        return cell
    return repr(value * (1 + size * rng.gauss(0, 1)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--copies", type=int, default=3)
    parser.add_argument("--size", type=float, default=1e-10)
    options = parser.parse_args()
    for seed in range(1, options.copies + 1):
        rng = random.Random(seed)
        to = options.out / f"{options.case.name}-{seed}"
        shutil.copytree(options.case, to)
        for path in sorted(to.rglob("*.csv")):
            path.chmod(0o644)
            with path.open(newline="") as file:
                rows = [[changed(cell, options.size, rng) for cell in row] for row in csv.reader(file)]
            with path.open("w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)
        print(to)


main()
