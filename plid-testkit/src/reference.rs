//! The recursion with F, G and H as dense matrices. It contains Eq. 8-10 in one phase, and the moment-matched and
//! extended filters with explicit sums over parameter pairs.

use plid_core::{InitialCovariance, NoiseModel, Scalar, Settings};

use crate::dense::Mat;

/// The kind of conditional expectation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Prior,
    Posterior,
    CertaintyEquivalent,
    MomentMatched,
    JointEkf,
}

pub const KINDS: [Kind; 5] =
    [Kind::Prior, Kind::Posterior, Kind::CertaintyEquivalent, Kind::MomentMatched, Kind::JointEkf];

/// Estimate and covariance of s = [x; a_1 .. a_p; b_1 .. b_m].
#[derive(Clone, Debug)]
pub struct Reference<S> {
    kind: Kind,
    n: usize,
    m: usize,
    /// The last state of each block.
    rows: Vec<usize>,
    /// J as a dense matrix.
    shift: Mat<S>,
    pub s: Mat<S>,
    pub p: Mat<S>,
    forgetting: S,
}

/// The update by the measurement z_k of the available outputs.
struct Measured<S> {
    there: Vec<usize>,
    h: Mat<S>,
    innovation: Mat<S>,
    re_inverse: Mat<S>,
    re: Mat<S>,
    s: Mat<S>,
    p: Mat<S>,
}

/// Returns E[eta eta^T] of eta = [w; v; xi] with all outputs.
pub fn joint_covariance(noise: &NoiseModel) -> Mat<f64> {
    let (p, m, n) = (noise.sensor.rows(), noise.actuator.rows(), noise.state.rows());
    let mut q = Mat::zeros(p + m + n, p + m + n);
    let cross = [
        (p, 0, Mat::from_f64(&noise.actuator_sensor)),
        (0, p + m, Mat::from_f64(&noise.sensor_state)),
        (p, p + m, Mat::from_f64(&noise.actuator_state)),
    ];
    for (row, column, block) in &cross {
        q.add_block(*row, *column, block);
        q.add_block(*column, *row, &block.t());
    }
    q.add_block(0, 0, &Mat::from_f64(&noise.sensor));
    q.add_block(p, p, &Mat::from_f64(&noise.actuator));
    q.add_block(p + m, p + m, &Mat::from_f64(&noise.state));
    q
}

/// Returns F P F^T for a symmetric P, with the sparse F on the left of both products.
fn congruence<S: Scalar>(f: &Mat<S>, p: &Mat<S>) -> Mat<S> {
    f * &(f * p).t()
}

/// Actuator noise v and state noise xi, given the noise w of the available outputs.
struct Decorrelated<S> {
    /// E[v w^T] R^{-1} and E[xi w^T] R^{-1}.
    l: Mat<S>,
    big_m: Mat<S>,
    /// Their covariances given w.
    q: Mat<S>,
    sigma: Mat<S>,
    s_vxi: Mat<S>,
}

impl<S: Scalar> Decorrelated<S> {
    /// Computes them from the joint covariance of eta = [w; v; xi], whose parts have p, m and n entries.
    fn of(joint: &Mat<f64>, (p, m, n): (usize, usize, usize), there: &[usize]) -> Self {
        let k = there.len();
        let part = |rows: &[usize], columns: &[usize]| {
            Mat::from_fn(rows.len(), columns.len(), |i, j| S::from_f64(joint[(rows[i], columns[j])]))
        };
        let (vs, xis): (Vec<usize>, Vec<usize>) = ((p..p + m).collect(), (p + m..p + m + n).collect());
        let (s_vw, s_wxi) = (part(&vs, there), part(there, &xis));
        // Without cross-covariances, L = M = 0 for any R, including zero.
        let correlated = s_vw.norm() > 0.0 || s_wxi.norm() > 0.0;
        let r_inverse = if correlated { part(there, there).inverse() } else { Mat::zeros(k, k) };
        let l = &s_vw * &r_inverse;
        let big_m = &s_wxi.t() * &r_inverse;
        let q = &part(&vs, &vs) - &(&l * &s_vw.t());
        let sigma = &part(&xis, &xis) - &(&big_m * &s_wxi);
        let s_vxi = &part(&vs, &xis) - &(&l * &s_wxi);
        Self { l, big_m, q, sigma, s_vxi }
    }
}

impl<S: Scalar> Reference<S> {
    pub fn new(kind: Kind, indices: &[usize], m: usize, settings: &Settings) -> Self {
        let n = indices.iter().sum();
        let mut shift = Mat::zeros(n, n);
        let (mut rows, mut start) = (Vec::new(), 0);
        for &size in indices {
            for i in 1..size {
                shift[(start + i, start + i - 1)] = S::one();
            }
            start += size;
            rows.push(start - 1);
        }
        let p = match &settings.initial_covariance {
            InitialCovariance::Diagonal(d) => {
                Mat::from_fn(d.len(), d.len(), |i, j| if i == j { S::from_f64(d[i]) } else { S::zero() })
            }
            InitialCovariance::Full(p) => Mat::from_f64(p),
        };
        let s = Mat::from_fn(p.rows, 1, |i, _| S::from_f64(settings.initial_estimate[i]));
        Self { kind, n, m, rows, shift, s, p, forgetting: S::from_f64(1.0 / settings.forgetting) }
    }

    pub fn step(&mut self, z: &[f64], u: &[f64], noise: &NoiseModel) {
        let joint = joint_covariance(noise);
        let measured = self.measure(z, &joint);
        match self.kind {
            Kind::Prior => {
                let (s, p) = (self.s.clone(), self.p.clone());
                self.one_phase(&measured, &s, &p, z, u, &joint);
            }
            Kind::Posterior => self.one_phase(&measured, &measured.s, &measured.p, z, u, &joint),
            Kind::CertaintyEquivalent => {
                let certain = Mat::zeros(self.p.rows, self.p.rows);
                self.one_phase(&measured, &measured.s, &certain, z, u, &joint);
            }
            Kind::MomentMatched => self.moments(&measured, true, z, u, &joint),
            Kind::JointEkf => self.moments(&measured, false, z, u, &joint),
        }
        // The gain would not damp an antisymmetric rounding error, which would grow with the estimated A.
        let half = self.forgetting * S::from_f64(0.5);
        self.p = (&self.p + &self.p.t()).scaled(half);
    }

    fn measure(&self, z: &[f64], joint: &Mat<f64>) -> Measured<S> {
        let there: Vec<usize> = (0..z.len()).filter(|&i| !z[i].is_nan()).collect();
        let k = there.len();
        let mut h = Mat::zeros(k, self.s.rows);
        for (row, &i) in there.iter().enumerate() {
            h[(row, self.rows[i])] = S::one();
        }
        let r = Mat::from_fn(k, k, |i, j| S::from_f64(joint[(there[i], there[j])]));
        let z = Mat::from_fn(k, 1, |i, _| S::from_f64(z[there[i]]));
        let innovation = &z - &(&h * &self.s);
        let cross = &self.p * &h.t();
        let re = &(&h * &cross) + &r;
        let re_inverse = re.inverse();
        let gain = &cross * &re_inverse;
        let s = &self.s + &(&gain * &innovation);
        let p = &self.p - &(&(&gain * &re) * &gain.t());
        Measured { there, h, innovation, re_inverse, re, s, p }
    }

    /// Returns the position in s of entry r of parameter column t.
    fn place(&self, t: usize, r: usize) -> usize {
        (1 + t) * self.n + r
    }

    /// Applies Eq. 8-10 with E[G] from the parameters `theta` and E[G Q0 G^T] from these and their covariance `cov`.
    fn one_phase(
        &mut self,
        measured: &Measured<S>,
        theta: &Mat<S>,
        cov: &Mat<S>,
        z: &[f64],
        u: &[f64],
        joint: &Mat<f64>,
    ) {
        let (n, m, p, size) = (self.n, self.m, z.len(), self.s.rows);
        let there = &measured.there;
        let k = there.len();
        // eta = [w of the available outputs; v; xi].
        let kept: Vec<usize> = there.iter().copied().chain(p..p + m + n).collect();
        let q0 = Mat::from_fn(kept.len(), kept.len(), |a, b| S::from_f64(joint[(kept[a], kept[b])]));
        // Returns the parameter column that noise a multiplies, and its sign in G.
        let parameter = |a: usize| -> Option<(S, usize)> {
            if a < k {
                Some((-S::one(), there[a]))
            } else if a < k + m {
                Some((S::one(), p + a - k))
            } else {
                None
            }
        };
        let mean_g = Mat::from_fn(size, kept.len(), |r, a| match parameter(a) {
            _ if r >= n => S::zero(),
            Some((sign, t)) => sign * theta[(self.place(t, r), 0)],
            None if r == a - k - m => S::one(),
            None => S::zero(),
        });
        let mut mean_gqg = Mat::zeros(size, size);
        for r in 0..n {
            for c in 0..n {
                for a in 0..kept.len() {
                    for b in 0..kept.len() {
                        let mut product = mean_g[(r, a)] * mean_g[(c, b)];
                        if let (Some((sign_a, t_a)), Some((sign_b, t_b))) = (parameter(a), parameter(b)) {
                            product += sign_a * sign_b * cov[(self.place(t_a, r), self.place(t_b, c))];
                        }
                        mean_gqg[(r, c)] += q0[(a, b)] * product;
                    }
                }
            }
        }
        let g_s = &mean_g * &q0.block(0, 0, kept.len(), k);
        // F_k with z_i, or with x+_{c_i} if z_i is missing.
        let mut f = Mat::identity(size);
        for r in 0..n {
            f[(r, r)] = S::zero();
            for c in 0..n {
                f[(r, c)] = self.shift[(r, c)];
            }
            for i in 0..p {
                let output = if there.contains(&i) { S::from_f64(z[i]) } else { measured.s[(self.rows[i], 0)] };
                f[(r, self.place(i, r))] = output;
            }
            for j in 0..m {
                f[(r, self.place(p + j, r))] = S::from_f64(u[j]);
            }
        }
        let ph = &self.p * &measured.h.t();
        let gain = &(&(&f * &ph) + &g_s) * &measured.re_inverse;
        self.s = &(&f * &self.s) + &(&gain * &measured.innovation);
        // With a missing output, a_i x_{c_i} is a product of unknowns, whose derivative with respect to x_{c_i} is
        // a_i.
        for i in (0..p).filter(|i| !there.contains(i)) {
            for r in 0..n {
                f[(r, self.rows[i])] += theta[(self.place(i, r), 0)];
            }
        }
        let gain = &(&(&f * &ph) + &g_s) * &measured.re_inverse;
        let advanced = &congruence(&f, &self.p) + &mean_gqg;
        self.p = &advanced - &(&(&gain * &measured.re) * &gain.t());
    }

    /// Adds the contribution of the parameters' covariances to the mean and the covariance of the next state.
    fn add_covariance_terms(&self, cov: &Mat<S>, g: &[Mat<S>], q: &Mat<S>, drift: &mut Mat<S>, qbar: &mut Mat<S>) {
        let (n, m) = (self.n, self.m);
        let p = g.len() - m;
        let p_xx = cov.block(0, 0, n, n);
        let p_tt = |s: usize, t: usize| cov.block(self.place(s, 0), self.place(t, 0), n, n);
        let p_tx = |t: usize| cov.block(self.place(t, 0), 0, n, n);
        for t in 0..p + m {
            *drift = &*drift + &(&p_tx(t) * &g[t].t());
        }
        for j in 0..m {
            for l in 0..m {
                *qbar = &*qbar + &p_tt(p + j, p + l).scaled(q[(j, l)]);
            }
        }
        for s in 0..p + m {
            for t in 0..p + m {
                let seen = (&(&g[s] * &p_xx) * &g[t].t())[(0, 0)];
                *qbar = &*qbar + &p_tt(s, t).scaled(seen);
                let (left, right) = (&p_tx(s) * &g[t].t(), &p_tx(t) * &g[s].t());
                *qbar = &*qbar + &(&left * &right.t());
            }
        }
    }

    /// Applies the moments of the next state if s given z_k is Gaussian, with or without the terms from the
    /// parameters' covariances.
    fn moments(&mut self, measured: &Measured<S>, covariances: bool, z: &[f64], u: &[f64], joint: &Mat<f64>) {
        let (n, m, p, size) = (self.n, self.m, z.len(), self.s.rows);
        let Measured { there, s, p: cov, .. } = measured;
        let k = there.len();
        let Decorrelated { l, big_m, q, sigma, s_vxi } = Decorrelated::of(joint, (p, m, n), there);
        let c = Mat::from_fn(k, n, |i, j| if j == self.rows[there[i]] { S::one() } else { S::zero() });
        let residual = Mat::from_fn(k, 1, |i, _| S::from_f64(z[there[i]]) - s[(self.rows[there[i]], 0)]);

        let theta = |t: usize| s.block(self.place(t, 0), 0, n, 1);
        let mut b = Mat::zeros(n, m);
        for j in 0..m {
            b.add_block(0, j, &theta(p + j));
        }
        let mut a = self.shift.clone();
        for i in 0..p {
            a.add_block(0, self.rows[i], &theta(i));
        }
        let abar = &a - &(&(&(&b * &l) + &big_m) * &c);
        let mut phi: Vec<S> = self.rows.iter().map(|&row| s[(row, 0)]).collect();
        let lr = &l * &residual;
        phi.extend((0..m).map(|j| S::from_f64(u[j]) + lr[(j, 0)]));
        // g_t is the factor of parameter column t, as a row that multiplies x.
        let lc = &l * &c;
        let g: Vec<Mat<S>> = (0..p + m)
            .map(|t| {
                if t < p {
                    Mat::from_fn(1, n, |_, j| if j == self.rows[t] { S::one() } else { S::zero() })
                } else {
                    lc.block(t - p, 0, 1, n).scaled(-S::one())
                }
            })
            .collect();
        let mut drift = &big_m * &residual;
        let mut qbar = sigma;
        qbar = &qbar + &(&(&b * &q) * &b.t());
        let bs = &b * &s_vxi;
        qbar = &(&qbar + &bs) + &bs.t();
        if covariances {
            self.add_covariance_terms(cov, &g, &q, &mut drift, &mut qbar);
        }

        let mut fbar = Mat::identity(size);
        for r in 0..n {
            fbar[(r, r)] = S::zero();
            for j in 0..n {
                fbar[(r, j)] = abar[(r, j)];
            }
            for (t, &weight) in phi.iter().enumerate() {
                fbar[(r, self.place(t, r))] = weight;
            }
        }
        let mut mean = &self.shift * &s.block(0, 0, n, 1);
        for (t, &weight) in phi.iter().enumerate() {
            mean = &mean + &theta(t).scaled(weight);
        }
        mean = &mean + &drift;
        self.s = s.clone();
        for r in 0..n {
            self.s[(r, 0)] = mean[(r, 0)];
        }
        self.p = congruence(&fbar, cov);
        self.p.add_block(0, 0, &qbar);
    }
}
