//! The kernels of the factored forms against plain triple loops in double-double.

use plid_core::kernels::{DEPTH, Kernels, PanelLayout, Support, Tails};
use plid_core::{Dense, Matrix, Scalar};
use qd::Quad;

type Reference = Dense<Quad>;

fn quad(x: f64) -> Quad {
    Quad::from_f64(x)
}

/// Numbers without a pattern that a wrong index could share.
fn entry(i: usize, j: usize, seed: usize) -> f64 {
    ((1 + seed + 7 * i + 31 * j).pow(2) as f64 * 0.129898).sin()
}

fn entries<S: Scalar>(rows: usize, columns: usize, seed: usize) -> Dense<S> {
    Dense::from_fn(rows, columns, |i, j| S::from_f64(entry(i, j, seed)))
}

fn product(a: &Reference, b: &Reference) -> Reference {
    Dense::from_fn(a.rows(), b.columns(), |i, j| {
        (0..a.columns()).fold(quad(0.0), |sum, k| sum + a.at(i, k) * b.at(k, j))
    })
}

fn transposed(a: &Reference) -> Reference {
    Dense::from_fn(a.columns(), a.rows(), |i, j| a.at(j, i))
}

/// A diag(d) A^T
fn weighted_square(a: &Reference, d: &[Quad]) -> Reference {
    let scaled = Dense::from_fn(a.rows(), a.columns(), |i, j| a.at(i, j) * d[j]);
    product(&scaled, &transposed(a))
}

fn assert_close<S: Scalar>(found: Quad, expected: Quad, scale: f64, place: &str) {
    let error = (found - expected).to_f64().abs();
    assert!(error <= 100.0 * S::EPSILON * scale, "{place}: {found:?}, not {expected:?}");
}

fn assert_same<S: Scalar>(found: &Reference, expected: &Reference, place: &str) {
    let largest = expected.data().iter().fold(1.0_f64, |m, x| m.max(x.to_f64().abs()));
    for j in 0..expected.columns() {
        for i in 0..expected.rows() {
            assert_close::<S>(found.at(i, j), expected.at(i, j), largest, &format!("{place}, ({i}, {j})"));
        }
    }
}

fn exact<S: Scalar>(a: &Dense<S>) -> Reference {
    Dense::from_fn(a.rows(), a.columns(), |i, j| quad(a.at(i, j).to_f64()))
}

fn exact_all<S: Scalar>(d: &[S]) -> Vec<Quad> {
    d.iter().map(|x| quad(x.to_f64())).collect()
}

/// An upper triangular matrix with `diagonal` on its diagonal.
fn triangle<S: Scalar>(size: usize, diagonal: impl Fn(usize) -> f64) -> Dense<S> {
    Dense::from_fn(size, size, |i, j| {
        S::from_f64(if i == j {
            diagonal(i)
        } else if i < j {
            0.3 * entry(i, j, 3)
        } else {
            0.0
        })
    })
}

fn into_panels<S: Scalar>(layout: PanelLayout, u: &Dense<S>) -> Dense<S> {
    let mut panels = Dense::zeros(layout.rows(), layout.start(layout.count()));
    for k in 0..layout.count() {
        for j in k * layout.n()..layout.size() {
            for i in 0..layout.n() {
                *panels.at_mut(i, layout.column(k, j)) = u.at(k * layout.n() + i, j);
            }
        }
    }
    panels
}

/// The triangular matrix, after a look at what must have stayed zero.
fn from_panels<S: Scalar>(layout: PanelLayout, panels: &Dense<S>) -> Dense<S> {
    let n = layout.n();
    for c in 0..panels.columns() {
        assert!(panels.column(c)[n..].iter().all(|x| x.to_f64() == 0.0), "rows that fill a panel up, column {c}");
    }
    let u = Dense::from_fn(layout.size(), layout.size(), |i, j| {
        if j < i / n * n { S::from_f64(0.0) } else { panels.at(i % n, layout.column(i / n, j)) }
    });
    for j in 0..layout.size() {
        assert!(u.column(j)[j + 1..].iter().all(|x| x.to_f64() == 0.0), "below the diagonal, column {j}");
    }
    u
}

const LAYOUTS: [(usize, usize); 8] = [(1, 3), (3, 2), (8, 3), (11, 2), (16, 2), (21, 3), (40, 2), (67, 2)];

fn variance(i: usize) -> f64 {
    0.2 + 0.1 * (i % 5) as f64
}

/// P - P H^T (H P H^T + R)^-1 H P for a diagonal R, an output after the other; also the gains of the sequence.
fn corrected(p: &Reference, h: &Reference, r: &[f64]) -> (Reference, Reference) {
    let (mut p, size) = (p.clone(), p.rows());
    let mut gains = Reference::zeros(size, r.len());
    for (k, &r) in r.iter().enumerate() {
        let cross: Vec<Quad> =
            (0..size).map(|i| (0..size).fold(quad(0.0), |sum, j| sum + p.at(i, j) * h.at(k, j))).collect();
        let spread = (0..size).fold(quad(r), |sum, i| sum + cross[i] * h.at(k, i));
        for j in 0..size {
            *gains.at_mut(j, k) = cross[j] / spread;
            for i in 0..size {
                *p.at_mut(i, j) -= cross[i] * cross[j] / spread;
            }
        }
    }
    (p, gains)
}

/// All scalar updates in one sweep, for 1 to 6 outputs that pick rows of the first panel, in every number of rows.
fn sweep<S: Kernels>(rotations: bool) {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let size = layout.size();
        for outputs in 1..=6.min(n) {
            let place = format!("n = {n}, {count} panels, {outputs} outputs");
            let u: Dense<S> = triangle(size, |i| if rotations { variance(i) } else { 1.0 });
            let mut d: Vec<S> = (0..size).map(|i| S::from_f64(if rotations { 1.0 } else { variance(i) })).collect();
            let mut panels = into_panels(layout, &u);
            let picked: Vec<usize> = (0..outputs).map(|k| (k + 1) * n / outputs - 1).collect();
            let h = Dense::from_fn(outputs, size, |k, j| quad(f64::from(u8::from(picked[k] == j))));
            // Exact in every scalar, with exact roots.
            let r: Vec<f64> = (0..outputs).map(|k| if k == 1 { 0.0625 } else { 0.25 }).collect();
            let (expected, expected_gains) = corrected(&weighted_square(&exact(&u), &exact_all(&d)), &h, &r);

            let mut rows = Dense::from_fn(outputs, size, |k, j| u.at(picked[k], j));
            let mut spreads: Vec<S> = r.iter().map(|&r| S::from_f64(if rotations { r.sqrt() } else { r })).collect();
            let (mut changes, mut seen) = (Dense::zeros(2 * outputs, size), Dense::zeros(outputs, outputs));
            let recursion = if rotations { S::givens_recursion } else { S::bierman_recursion };
            recursion(rows.view_mut(), &mut spreads, &mut d, changes.view_mut(), seen.view_mut());
            let mut found_gains = Reference::zeros(size, outputs);
            for k in 0..count {
                let columns = size - k * n;
                let mut gains = entries::<S>(layout.rows(), outputs, 8);
                let kernel = if rotations { S::givens_sweep } else { S::bierman_sweep };
                kernel(
                    panels.view_mut().block_mut(0, layout.start(k), layout.rows(), columns),
                    changes.view().block(0, k * n, 2 * outputs, columns),
                    gains.view_mut(),
                );
                for q in 0..outputs {
                    for i in 0..n {
                        *found_gains.at_mut(k * n + i, q) = quad(gains.at(i, q).to_f64()) / quad(spreads[q].to_f64());
                    }
                }
            }
            let u = from_panels(layout, &panels);
            assert_same::<S>(&weighted_square(&exact(&u), &exact_all(&d)), &expected, &place);
            assert_same::<S>(&found_gains, &expected_gains, &format!("{place}, gains"));
            for k in 0..outputs {
                for (l, &row) in picked.iter().enumerate().skip(k + 1) {
                    let seen = quad(seen.at(l, k).to_f64()) / quad(spreads[k].to_f64());
                    assert_close::<S>(seen, expected_gains.at(row, k), 1.0, &format!("{place}, gain {k} seen by {l}"));
                }
            }
        }
    }
}

/// [Abar Ux, Abar Uxt + (phi (x) I) Ut], with J of one subdiagonal and of several, in any split of the columns.
fn advance<S: Kernels>() {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let size = layout.size();
        for offsets in [vec![1], vec![1, 4], vec![]] {
            let u: Dense<S> = triangle(size, |_| 1.0);
            let mut panels = into_panels(layout, &u);
            let has = |i: usize, k: usize| i < n && i >= offsets[k] && i % offsets.len() == k && i % 5 != 3;
            let shifts =
                Dense::from_fn(layout.rows(), offsets.len(), |i, k| S::from_f64(f64::from(u8::from(has(i, k)))));
            let outputs: Vec<usize> = (0..3.min(n)).map(|k| n - 1 - k * n / 4).collect();
            let abar = Dense::from_fn(layout.rows(), outputs.len(), |i, k| {
                S::from_f64(if i < n { entry(i, k, 6) } else { 0.0 })
            });
            let phi: Vec<S> = (1..count).map(|k| S::from_f64(0.3 * k as f64 - 0.7)).collect();
            let f = Dense::from_fn(n, size, |i, j| {
                let mut sum = quad(0.0);
                if j < n {
                    for (k, offset) in offsets.iter().enumerate() {
                        sum += quad(f64::from(u8::from(has(i, k) && i - offset == j)));
                    }
                    for (k, &row) in outputs.iter().enumerate() {
                        sum += if row == j { quad(abar.at(i, k).to_f64()) } else { quad(0.0) };
                    }
                } else if j % n == i {
                    sum += quad(phi[j / n - 1].to_f64());
                }
                sum
            });
            let expected = product(&f, &exact(&u));
            let (first, rest) = panels.view_mut().split_at_column(layout.start(1));
            let mut work = vec![S::from_f64(f64::NAN); outputs.len()];
            let split = n / 2 + 1;
            let (left, right) = first.split_at_column(split);
            for (first, x) in [(0, left), (split, right)] {
                let (shifts, abar) = (shifts.view(), abar.view());
                S::advance_panel(layout, rest.view(), &phi, &offsets, shifts, &outputs, abar, first, x, &mut work);
            }
            let found = Dense::from_fn(n, size, |i, j| quad(panels.at(i, j).to_f64()));
            assert_same::<S>(&found, &expected, &format!("n = {n}, {count} panels, J {offsets:?}"));
            assert!((0..size).all(|j| panels.column(j)[n..].iter().all(|x| x.to_f64() == 0.0)));
        }
    }
}

fn output_columns<S: Kernels>() {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let u: Dense<S> = triangle(layout.size(), |_| 1.0);
        let d: Vec<S> = (0..layout.size()).map(|i| S::from_f64(variance(i))).collect();
        let p = weighted_square(&exact(&u), &exact_all(&d));
        for outputs in 1..=6.min(n) {
            let rows: Vec<usize> = (0..outputs).map(|k| (k + 1) * n / outputs - 1).collect();
            let mut out = entries::<S>(layout.size(), outputs, 2);
            S::output_columns(layout, into_panels(layout, &u).view(), &d, &rows, out.view_mut());
            let expected = Dense::from_fn(layout.size(), outputs, |i, k| p.at(i, rows[k]));
            assert_same::<S>(&exact(&out), &expected, &format!("n = {n}, {count} panels, rows {rows:?}"));
        }
    }
}

/// sum_st W_st P_{theta_s theta_t} with W = V V^T, V triangular, diagonal, or neither; the columns in two parts.
fn parameter_blocks<S: Kernels>() {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let (size, columns) = (layout.size(), count - 1);
        let u: Dense<S> = triangle(size, |_| 1.0);
        let d: Vec<S> = (0..size).map(|i| S::from_f64(if i % 7 == 2 { 0.0 } else { variance(i) })).collect();
        let p = weighted_square(&exact(&u), &exact_all(&d));
        let panels = into_panels(layout, &u);
        let theta = panels.view();
        let theta = theta.block(0, layout.start(1), theta.rows(), theta.columns() - layout.start(1));
        for (kind, kept) in [
            ("triangular", (|s, k| s >= k) as fn(usize, usize) -> bool),
            ("diagonal", |s, k| s == k),
            ("full", |_, _| true),
        ] {
            let v = Dense::from_fn(columns, columns, |s, k| S::from_f64(if kept(s, k) { entry(s, k, 4) } else { 0.0 }));
            let (mut sum, mut work) =
                (Dense::<S>::zeros(layout.rows(), layout.rows()), entries(layout.rows(), DEPTH, 5));
            let split = columns * n / 3;
            for (from, to) in [(0, split), (split, columns * n)] {
                S::add_parameter_blocks(layout, theta, &d[n..], v.view(), from, to, sum.view_mut(), work.view_mut());
            }
            let w = product(&exact(&v), &transposed(&exact(&v)));
            let expected = Dense::from_fn(n, n, |i, j| {
                let mut total = quad(0.0);
                for s in 0..columns {
                    for t in 0..columns {
                        total += w.at(s, t) * p.at((s + 1) * n + i, (t + 1) * n + j);
                    }
                }
                total
            });
            let found = Dense::from_fn(n, n, |i, j| quad(sum.at(i.max(j), i.min(j)).to_f64()));
            assert_same::<S>(&found, &expected, &format!("n = {n}, {count} panels, {kind}"));
        }
    }
}

/// Both triangularisations of [A, L] with a triangular L, whose zeros they pass over.
fn triangularised<S: Kernels>() {
    for n in [1, 2, 5, 8, 13, 24, 33, 50] {
        let rows = PanelLayout::new(n, 1).rows();
        let start = |i: usize| i.saturating_sub(1).min(n / 3);
        let array: Dense<S> = Dense::from_fn(rows, 2 * n, |i, j| {
            let kept = i < n && if j < n { j >= start(i) } else { j - n >= i };
            S::from_f64(if kept { entry(i, j, 1) + f64::from(u8::from(j == n + i)) } else { 0.0 })
        });
        let weights: Vec<S> = (0..2 * n).map(|j| S::from_f64(if j == 2 { 0.0 } else { variance(j) })).collect();
        let top = Dense::from_fn(n, 2 * n, |i, j| quad(array.at(i, j).to_f64()));
        let starts: Vec<[usize; 2]> = (0..n).map(|i| [start(i), n + i]).collect();

        let (mut w, mut u) = (array.clone(), entries::<S>(rows, n, 7));
        let mut work = vec![S::from_f64(f64::NAN); 8 * n + rows];
        let mut d = vec![S::from_f64(f64::NAN); n];
        let support = Support { starts: &starts, middle: n };
        S::weighted_gram_schmidt(w.view_mut(), support, &weights, u.view_mut(), &mut d, &mut work);
        let u = from_panels(PanelLayout::new(n, 1), &u);
        assert!((0..n).all(|i| u.at(i, i).to_f64() == 1.0));
        let found = weighted_square(&exact(&u), &exact_all(&d));
        assert_same::<S>(&found, &weighted_square(&top, &exact_all(&weights)), &format!("Gram-Schmidt, n = {n}"));

        let (mut w, mut s) = (array, entries::<S>(rows, n, 7));
        let left: Vec<usize> = (0..n).map(start).collect();
        let tails = Tails { starts: &left, ends: &vec![n; n] };
        S::triangular_factor(w.view_mut(), n, tails, s.view_mut(), &mut work);
        let s = from_panels(PanelLayout::new(n, 1), &s);
        let ones = vec![quad(1.0); 2 * n];
        let found = weighted_square(&exact(&s), &ones[..n]);
        assert_same::<S>(&found, &weighted_square(&top, &ones), &format!("reflections, n = {n}"));
    }
}

/// A definite matrix is V diag(d) V^T; a zero pivot is told by a zero in d.
fn upper_ldl<S: Kernels>() {
    for n in [1, 2, 5, 8, 13, 24, 33, 50] {
        let rows = PanelLayout::new(n, 1).rows();
        let root: Dense<S> = triangle(n, |i| 1.0 + variance(i));
        let q = weighted_square(&exact(&root), &vec![quad(1.0); n]);
        let lower = Dense::from_fn(n, n, |i, j| S::from_f64(if i >= j { q.at(i, j).to_f64() } else { f64::NAN }));
        let (mut v, mut d) = (entries::<S>(rows, n, 1), vec![S::from_f64(f64::NAN); n]);
        let mut work = vec![S::from_f64(f64::NAN); n];
        S::upper_ldl(lower.view(), v.view_mut(), &mut d, S::from_f64(1e3 * S::EPSILON), &mut work);
        let v = from_panels(PanelLayout::new(n, 1), &v);
        assert!((0..n).all(|i| v.at(i, i).to_f64() == 1.0 && d[i].to_f64() > 0.0));
        let rounded = Dense::from_fn(n, n, |i, j| quad(lower.at(i.max(j), i.min(j)).to_f64()));
        assert_same::<S>(&weighted_square(&exact(&v), &exact_all(&d)), &rounded, &format!("n = {n}"));
    }
    // [1 1; 1 1] from the last row up: nothing is left of the first pivot.
    let q = Dense::from_fn(2, 2, |_, _| S::from_f64(1.0));
    let (mut v, mut d) = (entries::<S>(8, 2, 1), vec![S::from_f64(f64::NAN); 2]);
    S::upper_ldl(q.view(), v.view_mut(), &mut d, S::from_f64(1e3 * S::EPSILON), &mut [S::from_f64(0.0); 2]);
    assert_eq!((d[0].to_f64(), d[1].to_f64()), (0.0, 1.0));
    assert!(v.column(0).iter().all(|x| x.to_f64() == 0.0));
}

/// One direction more in the covariance, whatever its last entry.
fn rank_one<S: Kernels>() {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let size = layout.size();
        for place in [0, size / 2, size - 1] {
            let a = |i: usize| if i <= place { entry(i, 1, 6) } else { 0.0 };
            let vector =
                || Dense::from_fn(layout.rows(), count, |i, k| S::from_f64(if i < n { a(k * n + i) } else { 0.0 }));
            for rotations in [false, true] {
                let u: Dense<S> = triangle(size, |i| if rotations { variance(i) } else { 1.0 });
                let mut d: Vec<S> = (0..size).map(|i| S::from_f64(if rotations { 1.0 } else { variance(i) })).collect();
                let p = weighted_square(&exact(&u), &exact_all(&d));
                let mut panels = into_panels(layout, &u);
                let mut direction = vector();
                let exact_a: Vec<Quad> = (0..size).map(|i| quad(direction.at(i % n, i / n).to_f64())).collect();
                let c = if rotations { 1.0 } else { 0.75 };
                if rotations {
                    S::rotate_in(layout, panels.view_mut(), direction.view_mut(), place);
                } else {
                    S::agee_turner(layout, panels.view_mut(), &mut d, direction.view_mut(), place, S::from_f64(c));
                }
                let expected = Dense::from_fn(size, size, |i, j| p.at(i, j) + quad(c) * exact_a[i] * exact_a[j]);
                let found = weighted_square(&exact(&from_panels(layout, &panels)), &exact_all(&d));
                assert_same::<S>(&found, &expected, &format!("n = {n}, {count} panels, place {place}, {rotations}"));
            }
        }
    }
}

#[test]
fn panels_hold_each_entry_once() {
    for (n, count) in LAYOUTS {
        let layout = PanelLayout::new(n, count);
        let mut places: Vec<usize> =
            (0..count).flat_map(|k| (k * n..count * n).map(move |j| layout.column(k, j))).collect();
        places.sort_unstable();
        assert!(places.iter().copied().eq(0..layout.start(count)));
        assert!(layout.rows() >= n && layout.rows() < n + PanelLayout::ROWS && layout.half() <= count);
    }
}

macro_rules! in_both_precisions {
    ($($name:ident: $check:expr, $check32:expr;)*) => {
        $(
            #[test]
            fn $name() {
                $check;
                $check32;
            }
        )*
    };
}

in_both_precisions!(
    bierman_sweep_is_the_updates_in_turn: sweep::<f64>(false), sweep::<f32>(false);
    givens_sweep_is_the_updates_in_turn: sweep::<f64>(true), sweep::<f32>(true);
    first_panel_goes_through_the_transition: advance::<f64>(), advance::<f32>();
    output_columns_are_those_of_p: output_columns::<f64>(), output_columns::<f32>();
    parameter_blocks_are_their_sum: parameter_blocks::<f64>(), parameter_blocks::<f32>();
    arrays_with_zeros_are_triangularised: triangularised::<f64>(), triangularised::<f32>();
    definite_matrices_have_an_upper_factor: upper_ldl::<f64>(), upper_ldl::<f32>();
    rank_one_is_added: rank_one::<f64>(), rank_one::<f32>();
);
