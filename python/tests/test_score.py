"""The summary of the score of drawn MuJoCo cases."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "experiments" / "mujoco"))
import score  # noqa: E402


def label(kind, effects=("actuator-lag",)):
    return {"kind": kind, "effects": None if effects is None else list(effects)}


def test_gaps_are_bounded_by_how_close_the_vocabulary_comes():
    labels = [label("lag"), label("none", ()), label("friction"), label("friction"), label("lag+friction")]
    lines = list(score.gaps([*labels, label("slips", None)], [1.4, 1.6, 2.9, 3.1, 1.0, 9.0]))
    assert lines == [
        "gap on a fresh record over noise, law in the vocabulary: median 1.50, largest 1.60; at most 1.5 in 1 of 2",
        "gap on a fresh record over noise, near miss: median 2.90, largest 3.10; at most 3 in 2 of 3",
        "gap on a fresh record over noise, outside the vocabulary: median 9.00, largest 9.00",
    ]
    # A class without cases has no line.
    assert len(list(score.gaps([label("smooth-friction")], [1.0]))) == 1
