#!/usr/bin/env python3
"""Compares the answers of two builds of the program, number by number.

    experiments/golden.py OLD_PROGRAM NEW_PROGRAM [--tolerance 1e-9] [--cases CASE ...] [--data FOLDER] [--quick]
                          [--out FOLDER]
    experiments/golden.py --self-test

Both programs answer the golden set: `plid run experiments/truss-mimo-30.toml`, `plid reproduce --quick`, the quick
trial with a fixed seed (60 blind cases, drawn and diagnosed), and `plid gap diagnose` of each CASE. This takes about
twenty minutes for each program on two cores. `--quick` leaves out `reproduce` and takes every twentieth case of the
trial. With `--out`, the answers are kept; a program that has not changed since is not run again.

A CASE is a folder with its records and a case.toml, or the TOML file of a case, such as
experiments/gap/real/silverbox.toml. The records of a file are in the folder of `--data` if it is given, and else beside
the file.

All JSON and CSV files are compared. Two numbers are equal if they differ by at most `--tolerance` times the larger
magnitude; the default, 0, requires every digit. Texts with a space (sentences, warnings) may differ, other texts (names
of effects, locations) may not. Times, paths, hashes and the identity of the program are left out. Every difference is
printed with its file, its key and both values. The exit status is 0 if there is none, 1 if there is one, and 2 if a
program fails.

The `settings` of an answer are compared, too. A setting that is new, gone or has another value is a warning, once for
all files and without influence on the exit status: a new setting changes no answer as long as its default is what the
code had before.
"""

import argparse
import collections
import csv
import hashlib
import json
import math
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SEED = "20261123"
# The share of the trial's cases that `--quick` takes.
SHARD = "1/20"
# Keys whose values differ between two builds, or between two runs of one build.
EXCLUDED = {"seconds", "program", "times", "path", "sha256", "files", "hash", "manifest", "commitment"}
# The key whose values are compared apart from all others.
SETTINGS = "settings"


def diagnosis(case, data):
    """Returns a case's name and its arguments for `plid gap diagnose`: its file, and the folder of its data."""
    case = Path(case).resolve()
    if case.suffix != ".toml":
        return case.name, [case / "case.toml"]
    return case.stem, [case, *(["--data", Path(data).resolve()] if data else [])]


def answer(program, out, cases, quick):
    """Lets a program answer the golden set, and writes its answers to the folder `out`."""
    program, identity = Path(program).resolve(), out / "program.sha256"
    digest = hashlib.sha256(program.read_bytes()).hexdigest()
    if out.exists() and any(out.iterdir()):
        if not identity.exists() or identity.read_text() != digest:
            sys.exit(f"{out} holds the answers of another program")
    out.mkdir(parents=True, exist_ok=True)
    identity.write_text(digest)

    def step(name, *arguments):
        done = out / f"{name}.done"
        if done.exists():
            return
        print(f"{program}: {name}", file=sys.stderr)
        command = [program, "--quiet", *map(str, arguments)]
        if subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode != 0:
            print(f"failed: {' '.join(map(str, command))}", file=sys.stderr)
            sys.exit(2)
        done.touch()

    step("run", "run", "experiments/truss-mimo-30.toml", "--out", out / "run", "--force")
    if not quick:
        step("reproduce", "reproduce", "--quick", "--out", out / "reproduce", "--force")
    trial, config = out / "trial", "experiments/trials/quick.toml"
    step("draw", "gap", "trial", "draw", config, "--seed", SEED, "--out", trial, "--sealed", out / "sealed")
    step("answers", "gap", "trial", "diagnose", trial, *(["--shard", SHARD] if quick else []))
    for name, case in cases:
        step(f"case-{name}", "gap", "diagnose", *case, "--out", out / "cases" / name, "--force")


def differences(old, new, tolerance, at):
    """Yields every place at which two values differ by more than words."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted((old.keys() | new.keys()) - EXCLUDED - {SETTINGS}):
            if key not in old or key not in new:
                yield f"{at}/{key}: only in the {'old' if key in old else 'new'} answer"
            else:
                yield from differences(old[key], new[key], tolerance, f"{at}/{key}")
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{at}: {len(old)} entries in the old answer, {len(new)} in the new one"
        for index, (one, other) in enumerate(zip(old, new)):
            yield from differences(one, other, tolerance, f"{at}/{index}")
    elif not are_equal(old, new, tolerance):
        yield f"{at}: {old!r} in the old answer, {new!r} in the new one"


def changed_settings(old, new):
    """Yields every difference between the settings of two answers, wherever they are in them."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() & new.keys()):
            if key == SETTINGS:
                yield from differences(old[key], new[key], 0.0, SETTINGS)
            else:
                yield from changed_settings(old[key], new[key])
    elif isinstance(old, list) and isinstance(new, list):
        for one, other in zip(old, new):
            yield from changed_settings(one, other)


def are_equal(old, new, tolerance):
    """Returns whether two numbers agree within the tolerance, or two other values are the same apart from words."""
    if is_number(old) and is_number(new):
        if math.isnan(old) or math.isnan(new):
            return math.isnan(old) and math.isnan(new)
        return old == new or abs(old - new) <= tolerance * max(abs(old), abs(new)) < math.inf
    if isinstance(old, str) and isinstance(new, str):
        return old == new or (" " in old and " " in new)
    return type(old) is type(new) and old == new


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def values(file):
    """Returns the contents of a JSON or CSV file; the cells of the latter are numbers where they can be."""
    if file.suffix == ".json":
        return json.loads(file.read_text())

    def cell(text):
        try:
            return float(text)
        except ValueError:
            return text

    with file.open(newline="") as rows:
        return [[cell(text) for text in row] for row in csv.reader(rows)]


def compare(old, new, tolerance):
    """Returns the number of files that both folders hold, all differences, and the warnings about settings."""

    def files(folder):
        every = (file for suffix in ("json", "csv") for file in folder.rglob(f"*.{suffix}"))
        return {str(file.relative_to(folder)): file for file in every}

    olds, news = files(old), files(new)
    lone = sorted(olds.keys() ^ news.keys())
    found = [f"{name}: only in the {'old' if name in olds else 'new'} set" for name in lone]
    both = sorted(olds.keys() & news.keys())
    changed = collections.Counter()
    for name in both:
        one, other = values(olds[name]), values(news[name])
        found += differences(one, other, tolerance, name)
        changed.update(set(changed_settings(one, other)))
    return len(both), found, [f"{setting} (in {count} files)" for setting, count in sorted(changed.items())]


class SelfTest(unittest.TestCase):
    """Tests of the comparison; they run no program."""

    def compared(self, old, new, tolerance):
        with tempfile.TemporaryDirectory() as folder:
            for name, content in (("old", old), ("new", new)):
                (Path(folder) / name).mkdir()
                for file, text in content.items():
                    (Path(folder) / name / file).write_text(text)
            return compare(Path(folder) / "old", Path(folder) / "new", tolerance)

    def found(self, old, new, tolerance=0.0):
        return self.compared(old, new, tolerance)[1]

    def test_equal_answers_have_no_difference(self):
        same = {"a.json": '{"gap": 0.25, "effects": ["sensor-lag", null], "n": NaN}', "b.csv": "y1\n1e-3\n"}
        self.assertEqual(self.found(same, same), [])
        self.assertEqual(self.found({"b.csv": "y1\n1e-3\n"}, {"b.csv": "y1\n0.001\n"}), [])

    def test_a_changed_number_is_found_with_its_key_and_both_values(self):
        old, new = ({"a.json": '{"gap": {"refit": %s}}' % refit} for refit in ("0.25", "0.25000001"))
        self.assertEqual(
            self.found(old, new), ["a.json/gap/refit: 0.25 in the old answer, 0.25000001 in the new one"]
        )
        self.assertEqual(len(self.found(old, new, 1e-9)), 1)
        self.assertEqual(self.found(old, new, 1e-6), [])
        self.assertEqual(len(self.found({"b.csv": "y1\n1\n"}, {"b.csv": "y1\n2\n"})), 1)

    def test_numbers_that_are_not_finite_and_values_of_other_types_differ(self):
        for old, new in (("1.0", "NaN"), ("1.0", "Infinity"), ("1.0", "null"), ("1", "true"), ('"a b"', "1")):
            self.assertEqual(len(self.found({"a.json": old}, {"a.json": new}, 1e-3)), 1, (old, new))

    def test_names_must_agree_but_sentences_and_times_need_not(self):
        self.assertEqual(len(self.found({"a.json": '["sensor-lag"]'}, {"a.json": '["sensor-gain"]'})), 1)
        old = {"a.json": '{"sentence": "The gap is closed.", "seconds": 1.0}'}
        new = {"a.json": '{"sentence": "It closes the gap.", "seconds": 2.0}'}
        self.assertEqual(self.found(old, new), [])

    def test_a_missing_file_key_or_entry_is_found(self):
        self.assertEqual(len(self.found({"a.json": "1"}, {})), 1)
        self.assertEqual(len(self.found({"a.json": '{"k": 1}'}, {"a.json": "{}"})), 1)
        self.assertEqual(len(self.found({"a.json": "[1, 2]"}, {"a.json": "[1]"})), 1)


    def test_a_changed_setting_is_a_warning_and_no_difference(self):
        written = '{"gap": 1, "settings": {"judge": {"excess": %s, "caveat": 0.21}}}'
        answers = [written % excess for excess in (4.0, 5.0)]
        old, new = ({"a.json": text, "b.json": f"[{text}]"} for text in answers)
        warning = "settings/judge/excess: 4.0 in the old answer, 5.0 in the new one (in 2 files)"
        self.assertEqual(self.compared(old, new, 0.0), (2, [], [warning]))
        self.assertEqual(self.compared(old, old, 0.0), (2, [], []))
        fewer = {name: text.replace(', "caveat": 0.21', "") for name, text in old.items()}
        lacking = "settings/judge/caveat: only in the old answer (in 2 files)"
        self.assertEqual(self.compared(old, fewer, 0.0), (2, [], [lacking]))

    def test_a_case_is_a_folder_or_a_file_with_its_data_elsewhere(self):
        here = Path.cwd().resolve()
        self.assertEqual(diagnosis("cases/one", "data"), ("one", [here / "cases/one/case.toml"]))
        self.assertEqual(diagnosis("real/f16.toml", None), ("f16", [here / "real/f16.toml"]))
        self.assertEqual(
            diagnosis("real/f16.toml", "data"), ("f16", [here / "real/f16.toml", "--data", here / "data"])
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old_program", nargs="?", type=Path)
    parser.add_argument("new_program", nargs="?", type=Path)
    parser.add_argument("--tolerance", type=float, default=0.0, help="largest relative difference of two numbers")
    parser.add_argument("--cases", nargs="+", default=[], metavar="CASE", help="folders or files of further cases")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="folder of the records of cases that are files")
    parser.add_argument("--quick", action="store_true", help="a small part of the golden set")
    parser.add_argument("--out", type=Path, help="folder for the answers; default: a temporary one")
    parser.add_argument("--self-test", action="store_true", help="test the comparison")
    given = parser.parse_args()
    if given.self_test:
        unittest.main(argv=[sys.argv[0]])
    if given.old_program is None or given.new_program is None:
        parser.error("two programs are needed")
    cases = [diagnosis(case, given.data) for case in given.cases]
    if len({name for name, _ in cases}) < len(cases):
        parser.error("two of the cases have the same name")
    with tempfile.TemporaryDirectory() as temporary:
        out = (given.out or Path(temporary)).resolve()
        for name, program in (("old", given.old_program), ("new", given.new_program)):
            answer(program, out / name, cases, given.quick)
        files, found, changed = compare(out / "old", out / "new", given.tolerance)
    for line in found:
        print(line)
    for line in changed:
        print(f"warning: {line}")
    print(f"{files} files, {len(found)} differences, {len(changed)} settings differ")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
