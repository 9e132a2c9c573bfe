"""A MuJoCo model as a simulator for plid, without a loop of your own.

    python3 mujoco_simulator.py MODEL.xml --rate 200 --port hinge --parameter joint.hinge.damping

The inputs are the model's actuators, the outputs are its sensors, and the ports are the named joints (hinge or slide).
The parameters are numbers of the model:

    joint.NAME.damping | frictionloss | stiffness | armature
    body.NAME.mass          (its inertia follows)
    actuator.NAME.gain      (factor on the gain and, of a position actuator, on the stiffness)

It needs `pip install ./python[mujoco]` in a clone of plid. `plid.gap.from_mujoco` creates the same simulator in Python.
"""

import argparse

from plid import gap


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--rate", type=float, required=True, help="samples per second")
    parser.add_argument("--port", action="append", default=[], help="a joint that takes a force")
    parser.add_argument("--parameter", action="append", default=[], help="a number that may be wrong")
    given = parser.parse_args()
    simulator = gap.from_mujoco(given.model, rate=given.rate, joints=given.port, parameters=given.parameter)
    gap.serve(simulator)


if __name__ == "__main__":
    main()
