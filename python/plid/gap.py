"""Where a simulator disagrees with records, and why.

`diagnose` runs your own simulator and names the effects that it lacks: friction, backlash, a delay, a wrong parameter.
"""

from __future__ import annotations

import dataclasses
import html
import json
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plid import _plid
from plid._arrays import Array, channels, positive
from plid._fmu import FmuPort, from_fmu
from plid._identify import listener
from plid._mujoco import from_mujoco
from plid._simulator import Finding, Parameter, Port, Simulator, check, serve
from plid._state_space import from_system

__all__ = [
    "Diagnosis",
    "Effect",
    "Finding",
    "FmuPort",
    "Parameter",
    "Port",
    "Record",
    "Simulator",
    "check",
    "diagnose",
    "from_fmu",
    "from_mujoco",
    "from_system",
    "serve",
]


@dataclasses.dataclass(frozen=True)
class Record:
    """A record that begins at rest.

    Attributes
    ----------
    u, y : array_like, shapes (samples, m), (samples, p)
        Inputs and outputs. NaN among the outputs is a missing sample.
    name : str, optional
        The name of the record in the answer.
    start_s : float, optional
        Start in s since the first record began. By default, each record follows the previous one without a pause.
    held_out : bool, default False
        Whether the record is held out to measure the gap. If no record is held out, the diagnosis chooses one.
    excitation : {"zero", "random", "periodic"}, optional
        The kind of inputs. By default, it is determined from the inputs, and "periodic" if a period is given.
    period : int, optional
        Number of samples after which the inputs repeat. The differences between periods then show the noise. It may be
        left out if the excitation is "periodic".
    """

    u: Any
    y: Any
    name: str | None = None
    start_s: float | None = None
    held_out: bool = False
    excitation: str | None = None
    period: int | None = None


@dataclasses.dataclass(frozen=True)
class Effect:
    """An effect that the simulator lacks, or a parameter that is wrong.

    Attributes
    ----------
    effect, location : str
        Its name and its location, such as "coulomb-friction" and "port:hinge".
    confidence : float
        Probability that it is the cause, among all explanations.
    family : dict or None
        `name` and `confidence` of the family of effects to which it belongs, such as "dry friction". Records often show
        the family more clearly than the law.
    parameters : dict
        Value, 95 % interval and unit of each parameter by name.
    share : float or None
        Share of the gap that it explains.
    change : dict or None
        For a wrong parameter: `number`, `from` and `to`.
    """

    effect: str
    location: str
    confidence: float
    family: dict[str, Any] | None
    parameters: dict[str, dict[str, Any]]
    share: float | None
    change: dict[str, Any] | None


class Diagnosis:
    """The answer of `diagnose`.

    Attributes
    ----------
    sentence : str
        The answer as a sentence.
    verdict : str
        "effects", "none" or "unknown".
    effects : list of Effect
        The effects that the simulator lacks, the largest share of the gap first.
    candidates : list of dict
        All explanations with their probabilities.
    remainder : dict
        The part of the gap that the best explanation leaves.
    gap : dict
        Gaps relative to the output: `as_given`, `refit`, `with_effect`, `noise_floor` and others.
    warnings : list of str
        Warnings about the records and the simulator.
    data : dict
        The contents of diagnosis.json.

    Examples
    --------
    >>> print(diagnosis)
    >>> diagnosis.report("out/gap")
    """

    def __init__(self, core: _plid.Outcome, simulator: Simulator) -> None:
        self._core, self._simulator = core, simulator
        self.data: dict[str, Any] = json.loads(core.diagnosis())
        self.sentence: str = self.data["sentence"]
        self.verdict: str = self.data["verdict"]
        known = [field.name for field in dataclasses.fields(Effect)]
        self.effects = [Effect(**{key: effect.get(key) for key in known}) for effect in self.data["effects"]]
        self.candidates: list[dict[str, Any]] = self.data["candidates"]
        self.remainder: dict[str, Any] = self.data["remainder"]
        self.gap: dict[str, Any] = self.data["gap"]
        self.warnings: list[str] = self.data["warnings"]

    def predict(self, u: Any, *, start_s: float | None = None) -> Array:
        """Predict the outputs with the simulator and the effects that were found.

        Parameters
        ----------
        u : array_like, shape (samples, m)
            Inputs from rest.
        start_s : float, optional
            Time in s since the first record began, for effects that drift. The default is the end of the last record.

        Returns
        -------
        ndarray, shape (samples, p)
            The outputs.

        Warns
        -----
        UserWarning
            If the inputs or the motion at a port clearly exceed those of the fitted records, where the effects were
            not observed.
        """
        given = channels(u, "u").samples
        expected = len(self._simulator.inputs)
        if given.shape[1] != expected:
            raise ValueError(f"u has the shape {given.shape}, expected (samples, {expected})")
        outputs, warning = self._core.predict(self._simulator, given, start_s)
        if warning is not None:
            warnings.warn(warning, stacklevel=2)
        return outputs

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the report: a page for a browser, which needs no other file.

        Parameters
        ----------
        path : path
            A folder, which receives report.html, diagnosis.json and sim-with-effect.json. If the path ends in .html,
            the page alone is written to this file.

        Returns
        -------
        pathlib.Path
            The page.

        Raises
        ------
        OSError
            If the files cannot be written. Those of an earlier diagnosis then stay as they were.

        Examples
        --------
        >>> diagnosis.report("out/gap")
        >>> diagnosis.report("gap.html")
        """
        path = Path(path)
        if path.suffix.lower() == ".html":
            self._core.write_page(path)
            return path
        self._core.write(path)
        return path / "report.html"

    def __str__(self) -> str:
        return self._core.text().rstrip()

    def __repr__(self) -> str:
        return f"<plid.gap.Diagnosis: {self.sentence}>"

    def _repr_html_(self) -> str:
        """Show the sentence, the parameters and the explanations in a notebook."""
        rows = [
            [f"{effect.effect} at {effect.location}", name, f"{value['value']:.4g} {value['unit']}", interval(value)]
            for effect in self.effects
            for name, value in effect.parameters.items()
        ]
        explained = [
            [" and ".join(f"{e['effect']} at {e['location']}" for e in one["effects"]) or "something else",
             f"{one['probability']:.3f}"]
            for one in self.candidates
        ]
        parts = [f"<p><b>{html.escape(self.sentence)}</b></p>"]
        if rows:
            parts.append(table(["effect", "parameter", "value", "95 % interval"], rows))
        if explained:
            parts.append(table(["explanation", "probability"], explained))
        return "".join(parts)


def kind(record: Record, u: Array) -> dict[str, Any]:
    """Return the excitation of a record with these inputs, as in a case."""
    silent = not np.any(u)
    by_default = "zero" if silent else "random" if record.period is None else "periodic"
    said = {"excitation": record.excitation or by_default}
    return said if record.period is None else said | {"period": int(record.period)}


def interval(value: dict[str, Any]) -> str:
    """Return an interval in words."""
    low_high = value.get("ci95")
    return "" if low_high is None else f"{low_high[0]:.4g} to {low_high[1]:.4g}"


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table of HTML."""
    def cells(row: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row) + "</tr>"

    return "<table>" + cells(head, "th") + "".join(cells(row, "td") for row in rows) + "</table>"


def diagnose(
    records: Sequence[Record | tuple[Any, Any]],
    *,
    simulator: Simulator | Callable[..., Any] | Any,
    rate: float,
    parameters: Mapping[str, float | Parameter] | None = None,
    band_hz: tuple[float, float] | None = None,
    suspects: Sequence[str] = (),
    exclude: Sequence[str] = (),
    material: float = 0.02,
    calls: int | None = None,
    seconds: float | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[str], object] | bool | None = None,
) -> Diagnosis:
    """Find which effect a simulator lacks. Ctrl-C stops the computation.

    Parameters
    ----------
    records : sequence of Record or (u, y)
        Records that begin at rest, in the order in which they were taken. A record whose inputs are zero shows the
        noise. Two levels of excitation separate more causes than one.
    simulator : Simulator, or function u -> y
        The simulator. For a function, the names of the channels come from the first record.
    rate : float
        Samples per second, in Hz.
    parameters : dict, optional
        The parameters of a function that may be wrong, by name. The function is then called as
        `simulator(u, parameters)`.
    band_hz : (float, float), optional
        The frequencies that are fitted and judged.
    suspects, exclude : sequence of str, optional
        Effects or locations that are suspected or ruled out.
    material : float, default 0.02
        Smallest gap beyond the noise that matters, relative to the output.
    calls, seconds : int, float, optional
        Largest number of runs of the simulator, each on one record, and their longest total time, in s. If one of
        these limits ends the search, a warning states what was left out. The default is 1000 runs and any time.
    settings : dict, optional
        Thresholds by table, as in a case file: `{"in_loop": {"steps": 12}}`.
    progress : callable or bool, optional
        Receives lines of text. By default they go to standard error if it is a terminal; False turns them off.

    Returns
    -------
    Diagnosis
        The answer, with predictions and a report.

    Raises
    ------
    ValueError
        If the records do not match each other or the simulator.
    RuntimeError
        If the simulator as given fails. Its own exception is the cause.

    Examples
    --------
    >>> diagnosis = plid.gap.diagnose([(u1, y1), (u2, y2)], simulator=my_function, rate=200.0)
    >>> print(diagnosis.sentence)
    """
    rate = positive(rate, "rate")
    given = [one if isinstance(one, Record) else Record(*one) for one in records]
    if not given:
        raise ValueError("records is empty")
    read = [
        (channels(one.u, f"records[{k}].u", letter="u"), channels(one.y, f"records[{k}].y", missing=True, letter="y"))
        for k, one in enumerate(given)
    ]
    if not isinstance(simulator, Simulator):
        inputs, outputs = (of.names for of in read[0])
        simulator = Simulator(simulator, rate=rate, inputs=inputs, outputs=outputs, parameters=parameters)
    elif parameters is not None:
        raise TypeError("parameters are those of the Simulator: leave them out here")
    core_records, clock = [], 0.0
    for k, (one, (u, y)) in enumerate(zip(given, read, strict=True)):
        sides = (("u", one.u, u, simulator.inputs), ("y", one.y, y, simulator.outputs))
        for name, data, of, expected in sides:
            if of.samples.shape[1] != len(expected):
                raise ValueError(
                    f"records[{k}].{name} has the shape {of.samples.shape}, expected (samples, {len(expected)}): "
                    f"{expected}"
                )
            if hasattr(data, "columns") and of.names != expected:
                raise ValueError(f"records[{k}].{name} has the columns {of.names}, the simulator has {expected}")
        if len(u.samples) != len(y.samples):
            raise ValueError(f"records[{k}] has {len(u.samples)} rows of u and {len(y.samples)} of y")
        start = clock if one.start_s is None else float(one.start_s)
        clock = start + len(u.samples) / rate
        core_records.append((one.name or f"record {k + 1}", u.samples, y.samples, start, one.held_out))
    options = {
        "sample_rate_hz": rate,
        "inputs": simulator.inputs,
        "outputs": simulator.outputs,
        "suspects": list(suspects),
        "exclude": list(exclude),
        "material": float(material),
        "record": [kind(one, u) | {"file": name} for one, (name, u, *_) in zip(given, core_records, strict=True)],
    }
    if band_hz is not None:
        options["band_hz"] = list(band_hz)
    bounds = {key: of for key, of in (("calls", calls), ("seconds", seconds)) if of is not None}
    options["settings"] = dict(settings or {})
    options["settings"]["in_loop"] = dict(options["settings"].get("in_loop", {})) | bounds
    with listener(progress) as listen:
        core = _plid.diagnose(core_records, simulator, simulator.description(), json.dumps(options), listen)
    return Diagnosis(core, simulator)

