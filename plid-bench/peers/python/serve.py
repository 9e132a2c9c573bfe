"""One Python peer, driven by compare.py in the way that `plid-peers serve` is:  serve.py DIRECTORY STEPS NAME"""

import sys
import time
from pathlib import Path

import numpy as np

from case import Case


def build(name, case):
    """The peer called `name`. Its library is loaded only here: what one loads shall not slow another."""
    if name == "numpy dense":
        from numpy_peers import NumpyDense

        return NumpyDense(case)
    if name == "numpy structured":
        from numpy_peers import NumpyStructured

        return NumpyStructured(case)
    if name == "filterpy":
        from filterpy_peers import FilterPy

        return FilterPy(case)
    if name == "filterpy square root":
        from filterpy_peers import FilterPySquareRoot

        return FilterPySquareRoot(case)
    if name.startswith("jax "):
        import jax_peers

        _, step, how = name.split()
        return jax_peers.Jax(case, getattr(jax_peers, step), scan=how == "scan")
    raise SystemExit(f'there is no filter called "{name}"')


def main():
    directory, steps, name = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    case = Case.read(directory)
    peer = build(name, case)
    peer.load(case.s0, case.P0)
    peer.run(*case.span(0, steps))
    s, P = (part.copy() for part in peer.estimate())
    np.save(directory / f"{name}.s.npy", s)
    np.save(directory / f"{name}.p.npy", P)
    print("ready", flush=True)
    for line in sys.stdin:
        samples = case.span(steps, int(line))
        peer.load(s, P)
        start = time.process_time()
        peer.run(*samples)
        print(time.process_time() - start, flush=True)


if __name__ == "__main__":
    main()
