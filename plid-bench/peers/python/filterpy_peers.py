"""The joint filter in filterpy: KalmanFilter with F and Q of each step, and SquareRootKalmanFilter."""

import numpy as np
from filterpy.kalman import KalmanFilter, SquareRootKalmanFilter

from case import Case
from numpy_peers import Linearisation


class FilterPy:
    """KalmanFilter: Joseph's update. `predict` multiplies by F; f(s) then replaces that mean."""

    def __init__(self, case: Case):
        self.linear = Linearisation(case)
        self.filter = KalmanFilter(dim_x=case.size, dim_z=case.p)
        self.filter.H, self.filter.R = case.H, case.R

    def load(self, s, P):
        self.filter.x, self.filter.P = s.copy(), P.copy()

    def run(self, z, u):
        filter, linear = self.filter, self.linear
        for k in range(len(z)):
            filter.update(z[k])
            after = linear.about(filter.x, u[k])
            filter.predict(F=linear.F, Q=linear.Q)
            filter.x = after

    def estimate(self):
        return self.filter.x, self.filter.P


class FilterPySquareRoot:
    """SquareRootKalmanFilter. Its `Q` must be positive definite, which Qbar is not: the parameters have no noise. So
    the factor behind it is set, Cholesky's of the states' block."""

    def __init__(self, case: Case):
        self.case = case
        self.linear = Linearisation(case)
        self.filter = SquareRootKalmanFilter(dim_x=case.size, dim_z=case.p)
        self.filter.H, self.filter.R = case.H, case.R
        self.filter._Q1_2 = np.zeros((case.size, case.size))

    def load(self, s, P):
        self.filter.x, self.filter.P = s.copy(), P

    def run(self, z, u):
        filter, linear, n = self.filter, self.linear, self.case.n
        for k in range(len(z)):
            filter.update(z[k])
            after = linear.about(filter.x, u[k])
            filter.F = linear.F
            filter._Q1_2[:n, :n] = np.linalg.cholesky(linear.Q[:n, :n])
            filter.predict()
            filter.x = after

    def estimate(self):
        return self.filter.x, self.filter.P
