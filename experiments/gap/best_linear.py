#!/usr/bin/env python3
"""Copies a case without its simulation: the gap as given is then that of the best linear model of the fitted records.

    best_linear.py CASE.toml OUT.toml

Leaves out `sim` and the records that only serve the simulation (`use = "sim"`). Standard library only.
"""
import pathlib
import re
import sys
import tomllib


def without_simulation(case):
    """Returns the text of a case without what gives its simulation."""
    head, *records = re.split(r"(?m)^(?=\[\[record\]\])", case)
    fitted = [record for record in records if tomllib.loads(record)["record"][0].get("use") != "sim"]
    return re.sub(r"(?m)^sim\s*=.*\n", "", head) + "".join(fitted)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__.strip())
    case, out = map(pathlib.Path, sys.argv[1:])
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(without_simulation(case.read_text()))


if __name__ == "__main__":
    main()
