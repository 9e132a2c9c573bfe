"""The joint filter in numpy: as a dense Kalman filter, and by blocks."""

import numpy as np
from scipy.linalg.blas import dgemm

from case import Case


class Linearisation:
    """f(s), its Jacobian F and Qbar of the joint EKF about the estimate after the measurement."""

    def __init__(self, case: Case):
        self.case = case
        self.F = np.eye(case.size)
        self.F[: case.n, : case.n] = case.J
        self.Q = np.zeros((case.size, case.size))
        # Where phi (x) I stands in F: entry (i, (1 + k) n + i) for state i and parameter vector k.
        i, k = np.meshgrid(np.arange(case.n), np.arange(case.p + case.m))
        self.at = i, (1 + k) * case.n + i

    def about(self, s, u):
        """f(s), with F and Q set."""
        case, n = self.case, self.case.n
        theta = s[n:].reshape(-1, n)
        phi = np.concatenate([s[case.rows], u])
        A, B = theta[: case.p].T, theta[case.p :].T
        self.F[:n, case.rows] = case.J[:, case.rows] + A
        self.F[self.at] = phi[:, None]
        self.Q[:n, :n] = case.Sigma + B @ case.Q @ B.T
        after = s.copy()
        after[:n] = case.J @ s[:n] + phi @ theta
        return after


class NumpyDense:
    """F, H and P as matrices, BLAS for each product."""

    def __init__(self, case: Case):
        self.case = case
        self.linear = Linearisation(case)

    def load(self, s, P):
        self.s, self.P = s.copy(), P.copy()

    def run(self, z, u):
        case, linear = self.case, self.linear
        for k in range(len(z)):
            PHt = self.P @ case.H.T
            K = np.linalg.solve(case.H @ PHt + case.R, PHt.T).T
            self.s += K @ (z[k] - case.H @ self.s)
            self.P -= K @ PHt.T
            # Without this the asymmetry grows until P is lost, within 60 samples.
            self.P = 0.5 * (self.P + self.P.T)
            self.s = linear.about(self.s, u[k])
            self.P = linear.F @ self.P @ linear.F.T
            self.P += linear.Q

    def estimate(self):
        return self.s, self.P


class NumpyStructured:
    """Only what F changes: the n state rows and columns, by block additions. P in place, through BLAS where it is one
    update."""

    def __init__(self, case: Case):
        self.case = case

    def load(self, s, P):
        self.s, self.P = s.copy(), np.asfortranarray(P)

    def run(self, z, u):
        case, n, s, P = self.case, self.case.n, self.s, self.P
        rows, J, size = case.rows, case.J, case.size
        source = np.argmax(J, axis=1)
        first = ~J.any(axis=1)
        theta = s[n:].reshape(-1, n)
        for k in range(len(z)):
            # Measurement update: with Re = L L^T and W = P H^T L^-T, K e = W L^-1 e and P <- P - W W^T, which is
            # exactly symmetric.
            PHt = P[:, rows]
            Linv = np.linalg.inv(np.linalg.cholesky(PHt[rows] + case.R))
            W = PHt @ Linv.T
            s += W @ (Linv @ (z[k] - s[rows]))
            dgemm(-1.0, W, W, beta=1.0, c=P, trans_b=True, overwrite_c=True)
            # Time update: the state rows of F P, from the columns of P, which are its rows.
            phi = np.concatenate([s[rows], u[k]])
            A, B = theta[: case.p].T, theta[case.p :].T
            Qbar = case.Sigma + (B * np.diag(case.Q)) @ B.T
            s[:n] = J @ s[:n] + phi @ theta
            blocks = P.T[n:].reshape(len(phi), n * size)
            moved = (phi @ blocks).reshape(n, size)
            shifted = P.T[source]
            shifted[first] = 0.0
            moved += shifted
            moved += A @ P.T[rows]
            # Their state columns once more.
            corner = moved[:, source]
            corner[:, first] = 0.0
            corner += moved[:, rows] @ A.T
            corner += np.einsum("k,ikj->ij", phi, moved[:, n:].reshape(n, len(phi), n))
            corner += Qbar
            moved[:, :n] = 0.5 * (corner + corner.T)
            P.T[:n] = moved
            P.T[n:, :n] = moved[:, n:].T

    def estimate(self):
        return self.s, self.P
