"""The files of drawn cases."""

import csv
import dataclasses
import json
import pathlib
import tomllib

import numpy as np


def gap(measured, predicted):
    """RMS of the error over RMS of the output, each output scaled to unit RMS."""
    return float(np.sqrt(np.mean(np.mean((measured - predicted) ** 2, axis=0) / np.mean(measured**2, axis=0))))


def columns(path, names):
    with open(path, newline="") as file:
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


@dataclasses.dataclass
class Case:
    """A case: its files, and its label."""

    folder: pathlib.Path
    label: dict
    case: dict

    @property
    def rate(self):
        return self.case["sample_rate_hz"]

    def listed(self, key):
        """Returns the ports or the parameters, as the command names them."""
        words = self.case["simulator"]["command"]
        return [words[k + 1] for k, word in enumerate(words) if word == f"--{key}"]

    def read(self, name):
        """Returns inputs and outputs of a record."""
        return tuple(columns(self.folder / name, self.case[side]) for side in ("inputs", "outputs"))

    def records(self):
        """Returns the names of the records that a diagnosis may see."""
        return [record["file"] for record in self.case["record"]]


def cases(folder, only=None):
    """Yields the names and the cases of a folder."""
    for name, label in json.loads((folder / "labels.json").read_text()).items():
        if not only or name in only:
            yield name, Case(folder / name, label, tomllib.loads((folder / name / "case.toml").read_text()))
