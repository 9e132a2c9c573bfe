"""The joint filter in JAX, compiled, in double precision: dense and by blocks; each as one scan over the record, and
step by step."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from case import Case

jax.config.update("jax_enable_x64", True)


class Shapes:
    """What the compiled step takes as constants."""

    def __init__(self, case: Case):
        self.n, self.p, self.m, self.size = case.n, case.p, case.m, case.size
        self.rows = case.rows
        self.J, self.H = jnp.array(case.J), jnp.array(case.H)
        self.R, self.Q, self.Sigma = jnp.array(case.R), jnp.array(case.Q), jnp.array(case.Sigma)
        self.source = np.argmax(case.J, axis=1)
        self.first = ~case.J.any(axis=1)

    def shift(self, X):
        """J X"""
        return jnp.where(self.first[:, None], 0.0, X[self.source])

    def correct(self, s, PHt, z):
        """s+ and W, where P+ = P - W W^T: W = P H^T L^-T with Re = L L^T."""
        Linv = jnp.linalg.inv(jnp.linalg.cholesky(PHt[self.rows] + self.R))
        W = PHt @ Linv.T
        return s + W @ (Linv @ (z - s[self.rows])), W

    def about(self, s, u):
        """phi, A^, Qbar and f(s)."""
        theta = s[self.n :].reshape(self.p + self.m, self.n)
        phi = jnp.concatenate([s[self.rows], u])
        A, B = theta[: self.p].T, theta[self.p :].T
        x = self.shift(s[: self.n, None])[:, 0] + phi @ theta
        return phi, A, self.Sigma + B @ self.Q @ B.T, jnp.concatenate([x, s[self.n :]])


def dense(shapes: Shapes, state, sample):
    """A Kalman filter with F, H and P as matrices."""
    (s, P), (z, u), n = state, sample, shapes.n
    PHt = P @ shapes.H.T
    s, W = shapes.correct(s, PHt, z)
    P = P - W @ W.T
    phi, A, Qbar, s = shapes.about(s, u)
    Abar = shapes.J.at[:, shapes.rows].add(A)
    top = jnp.concatenate([Abar, *(w * jnp.eye(n) for w in phi)], axis=1)
    F = jnp.concatenate([top, jnp.eye(shapes.size)[n:]])
    P = F @ P @ F.T
    P = P.at[:n, :n].add(Qbar)
    # Without this the asymmetry grows until P is lost, within 60 samples.
    return s, 0.5 * (P + P.T)


def structured(shapes: Shapes, state, sample):
    """Only the n state rows and columns that F changes. Products with p columns are written as sums of p outer
    products: those are fused into one sweep over P, a matrix product would be stored first."""
    (s, P), (z, u), n, rows = state, sample, shapes.n, shapes.rows

    def outer(left, right):
        return sum(left[:, i, None] * right[None, :, i] for i in range(shapes.p))

    PHt = P[:, rows]
    s, W = shapes.correct(s, PHt, z)
    P = P - outer(W, W)
    phi, A, Qbar, s = shapes.about(s, u)
    blocks = [(w, slice((1 + k) * n, (2 + k) * n)) for k, w in enumerate(phi)]
    # The state rows of F P, n x N; then their state columns once more.
    moved = shapes.shift(P[:n]) + outer(A, P[rows].T) + sum(w * P[block] for w, block in blocks)
    corner = shapes.shift(moved[:, :n].T).T + moved[:, rows] @ A.T
    corner = corner + sum(w * moved[:, block] for w, block in blocks) + Qbar
    moved = moved.at[:, :n].set(corner)
    return s, P.at[:n].set(moved).at[n:, :n].set(moved[:, n:].T)


class Jax:
    """`step` compiled for the shapes of `case`."""

    def __init__(self, case: Case, step, scan: bool):
        step = partial(step, Shapes(case))
        if scan:
            carried = lambda state, zu: (step(state, zu), None)
            self.scan = jax.jit(lambda state, z, u: jax.lax.scan(carried, state, (z, u))[0])
        else:
            self.scan = None
            self.step = jax.jit(lambda state, z, u: step(state, (z, u)), donate_argnums=0)

    def load(self, s, P):
        self.state = jax.block_until_ready((jnp.array(s), jnp.array(P)))

    def run(self, z, u):
        if self.scan:
            self.state = self.scan(self.state, z, u)
        else:
            for k in range(len(z)):
                self.state = self.step(self.state, z[k], u[k])
        jax.block_until_ready(self.state)

    def estimate(self):
        return tuple(np.asarray(part) for part in self.state)
