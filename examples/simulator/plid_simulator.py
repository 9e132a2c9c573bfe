"""Serves a simulator to plid over standard input and output. It needs only Python's standard library.

A simulator is an object with

- `description`: a dictionary, as in docs/simulator-protocol.md;
- `run(parameters, u)`: takes one list of inputs for each sample and returns one list of outputs for each; or
- `start(parameters)` and `step(u, forces)`: `start` goes to rest and returns the motions, a list of (displacement,
  velocity) with one entry for each port; `step` advances by one step and returns the outputs at its start and the
  motions at its end;
- if its description has `"states": True`, `save(slot)` and `restore(slot)`: `save` keeps the state between two steps
  under a number, `restore` goes back to it and returns the motions there.

`serve(simulator)` then answers until plid ends. Anything that is printed goes to plid's log.
"""

import json
import os
import struct
import sys


def serve(simulator):
    """Answers requests until standard input ends."""
    source, sink = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # The output of a simulator must not mix with the numbers.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    description = simulator.description
    m, p = len(description["inputs"]), len(description["outputs"])
    q = len(description.get("ports", []))
    _line(sink, {"protocol": 1, **description})
    asked, answered = struct.Struct(f"<{m + q}d"), struct.Struct(f"<c{p + 2 * q}d")
    while first := source.read(1):
        try:
            if first == b"s":
                values = asked.unpack(_exactly(source, asked.size))
                y, motions = simulator.step(values[:m], values[m:])
                flat = [x for motion in motions for x in motion]
                sink.write(answered.pack(b"s", *y, *flat))
                sink.flush()
                continue
            (kind, request), = json.loads(first + source.readline()).items()
            if kind == "run":
                samples = request["samples"]
                values = struct.unpack(f"<{samples * m}d", _exactly(source, 8 * samples * m))
                u = [list(values[k * m : (k + 1) * m]) for k in range(samples)]
                rows = _run(simulator, description, request["parameters"], u)
                _line(sink, {"ok": True}, [float(x) for row in rows for x in row])
            elif kind == "save":
                simulator.save(request["slot"])
                _line(sink, {"ok": True})
            else:
                starts = kind == "start"
                motions = simulator.start(request["parameters"]) if starts else simulator.restore(request["slot"])
                _line(sink, {"ok": True}, [x for motion in motions for x in motion])
        except Exception as error:  # plid is told, and the next request may succeed
            _line(sink, {"error": f"{type(error).__name__}: {error}"})


def _run(simulator, description, parameters, u):
    """Runs as a whole, or step by step without forces."""
    if hasattr(simulator, "run"):
        return simulator.run(parameters, u)
    steps, none = description["steps_per_sample"], [0.0] * len(description.get("ports", []))
    simulator.start(parameters)
    rows = []
    for now in u:
        for step in range(steps):
            y, _ = simulator.step(now, none)
            if step == 0:
                rows.append(list(y))
    return rows


def _line(sink, what, numbers=()):
    sink.write(json.dumps(what).encode() + b"\n" + struct.pack(f"<{len(numbers)}d", *numbers))
    sink.flush()


def _exactly(source, count):
    data = source.read(count)
    if len(data) != count:
        raise SystemExit("plid ended in the middle of a request")
    return data
