"""Runs every peer against plid: checks that both find the same, times them in turn, prints a table, writes peers.json.

    compare.py PROGRAM [--out DIR] [--states 12 30 64] [--only NAME ...] [--repeats 9] [--core 1]

PROGRAM is plid-peers, built. A peer is a process that answers "run so many samples" with seconds of the processor. plid
and the peer answer by turns on one core, so that whatever else the machine does falls on both.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent

# Set before any library of numbers is loaded, here or in a peer.
ONE_THREAD = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")}
ONE_THREAD["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
ONE_THREAD["JAX_PLATFORMS"] = "cpu"
os.environ.update(ONE_THREAD)

import numpy as np  # noqa: E402

# Samples after which the estimates are compared, from s0 and P0.
AGREE_AFTER = 60
# The largest relative difference of s (2-norm) and P (Frobenius) with which a time is printed.
TOLERANCE = 1e-8
# Seconds that a batch of samples should take. A batch has one sample at least, and ends with the record at most.
BATCH_S = 0.15
LONGEST = 3000


@dataclass
class Peer:
    name: str
    """As `serve` knows it."""
    form: str
    """How the covariance is carried."""
    package: str
    structured: bool = False
    python: bool = False
    same_form: str | None = None
    """plid's own form of the same kind, if that is not the direct one."""


PEERS = [
    Peer("numpy structured", "direct", "numpy", structured=True, python=True),
    Peer("jax structured scan", "direct", "jax", structured=True, python=True),
    Peer("jax structured step", "direct", "jax", structured=True, python=True),
    Peer("numpy dense", "direct", "numpy", python=True),
    Peer("jax dense scan", "direct", "jax", python=True),
    Peer("jax dense step", "direct", "jax", python=True),
    Peer("adskalman", "direct", "adskalman"),
    Peer("adskalman plain", "direct", "adskalman"),
    Peer("bayes_estimate", "direct", "bayes_estimate"),
    Peer("kfilter", "direct", "kfilter"),
    Peer("multicalc", "direct", "multicalc"),
    Peer("minikalman", "direct", "minikalman"),
    Peer("kalman_filters", "direct", "kalman_filters"),
    Peer("filterpy", "Joseph", "filterpy", python=True, same_form="plid joseph"),
    Peer("kalmanfilt", "Joseph", "kalmanfilt", same_form="plid joseph"),
    Peer("numeris", "Joseph", "numeris", same_form="plid joseph"),
    Peer("bayes_estimate UD", "UD", "bayes_estimate", same_form="plid bierman-ud"),
    Peer("filterpy square root", "square root", "filterpy", python=True, same_form="plid array-sqrt"),
]
REFERENCE = "plid direct"


class Ended(Exception):
    """A filter's process has ended before it should, with these last words on standard error."""


PIPES = ("stdin", "stdout", "stderr")


class Served:
    """A filter in a process of its own, at rest until it is asked."""

    def __init__(self, command):
        self.process = subprocess.Popen(command, **dict.fromkeys(PIPES, subprocess.PIPE), text=True)
        self.answer()

    def answer(self):
        answer = self.process.stdout.readline().strip()
        if not answer:
            raise Ended(self.process.stderr.read().strip().splitlines()[-1:])
        return answer

    def seconds(self, samples):
        self.process.stdin.write(f"{samples}\n")
        self.process.stdin.flush()
        return float(self.answer())

    def batch(self):
        """Returns a number of samples that take about BATCH_S. The batch has then been run once, because some peers
        compile for its length."""
        samples = 1
        while True:
            self.seconds(samples)
            taken = self.seconds(samples)
            if samples == LONGEST or taken > 0.4 * BATCH_S:
                return samples
            samples = min(LONGEST, max(2 * samples, int(samples * BATCH_S / max(taken, 1e-6))))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait()


def command(program, directory, states, name, python):
    if python:
        return [sys.executable, HERE / "python" / "serve.py", directory, str(AGREE_AFTER), name]
    return [program, "serve", directory, str(states), str(AGREE_AFTER), name]


def difference(directory, name):
    """The larger of the relative differences of s and of P from plid's; infinite if anything is not finite."""
    found = []
    for part in "sp":
        reference, other = (np.load(directory / f"{which}.{part}.npy") for which in (REFERENCE, name))
        found.append(np.linalg.norm(other - reference) / np.linalg.norm(reference))
    return float(np.max(found)) if np.all(np.isfinite(found)) else float("inf")


def in_turn(served, repeats):
    """Microseconds a sample of each of `served`, `repeats` times by turns."""
    batches = [one.batch() for one in served]
    times = [[one.seconds(samples) / samples * 1e6 for one, samples in zip(served, batches)] for _ in range(repeats)]
    return list(zip(*times))


def measure(program, directory, states, peer, repeats):
    row = {"name": peer.name, "dtype": "f64", "structured": peer.structured, "form": peer.form}
    row |= {"package": peer.package, "version": package_version(peer)}
    try:
        with Served(command(program, directory, states, peer.name, peer.python)) as served:
            row["agreement"] = difference(directory, peer.name)
            if not row["agreement"] <= TOLERANCE:
                return row | {"refused": f"s or P differs by more than {TOLERANCE:.0e}"}
            return row | timed(program, directory, states, peer, served, repeats)
    except Ended as error:
        return row | {"refused": "".join(*error.args) or "its process ended"}


def timed(program, directory, states, peer, served, repeats):
    """The times of `served`, and of plid in turn with it."""
    with ExitStack() as stack:
        names = [REFERENCE, peer.same_form] if peer.same_form else [REFERENCE]
        own = [stack.enter_context(Served(command(program, directory, states, name, False))) for name in names]
        *ours, theirs = in_turn([*own, served], repeats)
    times = {"us_per_step": median(theirs), "us_per_step_min": min(theirs)}
    times |= {"plid_us_per_step": median(ours[0]), "plid_us_per_step_min": min(ours[0])}
    times["ratio"] = median(their / our for their, our in zip(theirs, ours[0]))
    if peer.same_form:
        times |= {"plid_same_form": peer.same_form.removeprefix("plid "), "plid_same_form_us_per_step": median(ours[1])}
    return times


def package_version(peer):
    if peer.python:
        return version(peer.package)
    lock = (HERE / "Cargo.lock").read_text().split("[[package]]")
    # The newest, where an older one is there for another crate's sake.
    block = [block for block in lock if f'name = "{peer.package}"\n' in block][-1]
    return block.split('version = "')[1].split('"')[0]


def text_of(*arguments):
    return subprocess.run(arguments, capture_output=True, text=True, check=True).stdout.strip()


def machine(core):
    cpu = platform.processor()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), cpu)
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "pinned_to_core": core,
        "system": platform.system(),
        "rustc": text_of("rustc", "--version"),
        "cargo_profile": "release, no target flags",
        "python": platform.python_version(),
        **{package: version(package) for package in ("numpy", "scipy", "jax", "jaxlib", "filterpy")},
        "environment": ONE_THREAD,
    }


def pin(core):
    """Pins this process, and so all that it starts, to one core; returns which, or None where a system cannot."""
    if not hasattr(os, "sched_setaffinity"):
        return None
    core = max(os.sched_getaffinity(0)) if core is None else core
    os.sched_setaffinity(0, {core})
    return core


# Microseconds a step are medians, with the least of all batches in brackets; the ratio is the median of the turns'
# ratios.
HEADER = """| peer | version | form | us a step | plid direct, us | ratio | plid in the same form, us | s, P differ by |
|---|---|---|---|---|---|---|---|"""


def line_of(row):
    start = f"| {row['name']} | {row['version']} | {row['form']} |"
    agreement = f"{row['agreement']:.1e}" if "agreement" in row else ""
    if "refused" in row:
        return f"{start} refused: {row['refused']} | | | | {agreement} |"
    same = f"{row['plid_same_form']} {row['plid_same_form_us_per_step']:.1f}" if "plid_same_form" in row else ""
    theirs = f"{row['us_per_step']:.1f} ({row['us_per_step_min']:.1f})"
    ours = f"{row['plid_us_per_step']:.1f} ({row['plid_us_per_step_min']:.1f})"
    times = f"{theirs} | {ours} | {row['ratio']:.1f} | {same}"
    return f"{start} {times} | {agreement} |"


def write_whole(path, text):
    part = path.with_suffix(".part")
    part.write_text(text)
    part.replace(path)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("program", type=Path)
    arguments.add_argument("--out", type=Path, default=HERE / "out")
    arguments.add_argument("--states", type=int, nargs="+", default=[12, 30, 64])
    arguments.add_argument("--only", nargs="+", metavar="NAME")
    arguments.add_argument("--repeats", type=int, default=9)
    arguments.add_argument("--core", type=int)
    given = arguments.parse_args()
    core = pin(given.core)
    peers = [peer for peer in PEERS if not given.only or peer.name in given.only]
    sizes = []
    for states in given.states:
        directory = given.out / f"n{states}"
        subprocess.run([given.program, "export", directory, str(states)], check=True)
        with Served(command(given.program, directory, states, REFERENCE, False)):
            pass  # It has left its estimate to be compared with.
        print(f"\nn = {states}, 3 inputs, 3 outputs, N = {7 * states}\n\n{HEADER}", flush=True)
        rows = []
        for peer in peers:
            rows.append(measure(given.program, directory, states, peer, given.repeats))
            print(line_of(rows[-1]), flush=True)
        size = {"n": states, "inputs": 3, "outputs": 3}
        size["peers"] = [row for row in rows if "refused" not in row]
        size["refused"] = [row for row in rows if "refused" in row]
        sizes.append(size)
    result = {"machine": machine(core), "agree_after": AGREE_AFTER, "tolerance": TOLERANCE, "sizes": sizes}
    write_whole(given.out / "peers.json", json.dumps(result, indent=2) + "\n")
    print(f"\nwrote {given.out / 'peers.json'}")


if __name__ == "__main__":
    main()
