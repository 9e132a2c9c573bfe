//! Numbers in lanes of four, padded with zeros. Loops over them have no remainder, so they vectorise.

/// Number of values in a lane.
pub const WIDE: usize = 4;

/// Four numbers, which are read by one load of a register.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(32))]
pub struct Quad(pub [f64; WIDE]);

/// Returns `count` zeros in lanes.
pub fn zeros(count: usize) -> Vec<Quad> {
    vec![Quad::default(); count.div_ceil(WIDE)]
}

/// Returns these numbers in lanes.
pub fn of(values: &[f64]) -> Vec<Quad> {
    values.chunks(WIDE).map(|some| Quad(std::array::from_fn(|l| some.get(l).copied().unwrap_or(0.0)))).collect()
}

/// Returns the k-th number.
#[inline(always)]
pub fn get(lanes: &[Quad], k: usize) -> f64 {
    lanes[k / WIDE].0[k % WIDE]
}

/// Returns a mutable reference to the k-th number.
#[inline(always)]
pub fn get_mut(lanes: &mut [Quad], k: usize) -> &mut f64 {
    &mut lanes[k / WIDE].0[k % WIDE]
}

/// The same lane of several runs.
pub type Lane<const R: usize> = [Quad; R];

/// Returns `count` zeros for each run, in lanes.
pub fn zeros_of<const R: usize>(count: usize) -> Vec<Lane<R>> {
    vec![[Quad::default(); R]; count.div_ceil(WIDE)]
}

/// Returns the k-th number of a run.
#[inline(always)]
pub fn get_of<const R: usize>(lanes: &[Lane<R>], k: usize, run: usize) -> f64 {
    lanes[k / WIDE][run].0[k % WIDE]
}

/// Returns a mutable reference to the k-th number of a run.
#[inline(always)]
pub fn get_mut_of<const R: usize>(lanes: &mut [Lane<R>], k: usize, run: usize) -> &mut f64 {
    &mut lanes[k / WIDE][run].0[k % WIDE]
}

/// Returns the k-th number of each run.
#[inline(always)]
pub fn all<const R: usize>(lanes: &[Lane<R>], k: usize) -> [f64; R] {
    std::array::from_fn(|r| get_of(lanes, k, r))
}

/// Sets the k-th number of each run.
#[inline(always)]
pub fn set<const R: usize>(lanes: &mut [Lane<R>], k: usize, to: [f64; R]) {
    (0..R).for_each(|r| *get_mut_of(lanes, k, r) = to[r]);
}

/// Computes to += from * factor, with a factor for each run.
#[inline(always)]
pub fn add_each<const R: usize>(to: &mut [Lane<R>], from: &[Quad], factor: [f64; R]) {
    for (to, from) in to.iter_mut().zip(from) {
        // All values are read before any is written, so the compiler need not assume that they overlap.
        *to = std::array::from_fn(|r| Quad(std::array::from_fn(|l| to[r].0[l] + from.0[l] * factor[r])));
    }
}

/// Computes to += from * factor in one run.
#[inline(always)]
pub fn add<const R: usize>(to: &mut [Lane<R>], from: &[Quad], run: usize, factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        to[run] = Quad(std::array::from_fn(|l| to[run].0[l] + from.0[l] * factor));
    }
}

/// Computes z = z * turn + more for complex numbers: four real parts, then the four imaginary parts.
#[inline(always)]
pub fn turn<const R: usize>(z: &mut [Lane<R>], turn: &[Quad], more: &[Lane<R>]) {
    for ((z, turn), more) in z.chunks_exact_mut(2).zip(turn.chunks_exact(2)).zip(more.chunks_exact(2)) {
        let [c, s] = [turn[0].0, turn[1].0];
        for r in 0..R {
            let ([re, im], [x, y]) = ([z[0][r].0, z[1][r].0], [more[0][r].0, more[1][r].0]);
            z[0][r] = Quad(std::array::from_fn(|l| x[l] + (re[l] * c[l] - im[l] * s[l])));
            z[1][r] = Quad(std::array::from_fn(|l| y[l] + (im[l] * c[l] + re[l] * s[l])));
        }
    }
}

/// A matrix in groups of four rows.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// Number of groups of four columns.
    fours: usize,
    /// The columns of each group of four rows, four columns at a time.
    values: Vec<[Quad; WIDE]>,
}

impl Rows {
    /// Returns the rows of a matrix with these entries.
    pub fn new(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let fours = columns.div_ceil(WIDE);
        let entry = |i: usize, j: usize| if i < rows && j < columns { entry(i, j) } else { 0.0 };
        let column = |i: usize, j: usize| Quad(std::array::from_fn(|l| entry(WIDE * i + l, j)));
        let four = |i: usize, j: usize| std::array::from_fn(|l| column(i, WIDE * j + l));
        let values = (0..rows.div_ceil(WIDE)).flat_map(|i| (0..fours).map(move |j| (i, j)));
        Self { fours, values: values.map(|(i, j)| four(i, j)).collect() }
    }

    /// Computes to += matrix * x in each run.
    #[inline(always)]
    pub fn add_times<const R: usize>(&self, x: &[Lane<R>], to: &mut [Lane<R>]) {
        for (rows, to) in self.values.chunks_exact(self.fours.max(1)).zip(to) {
            *to = plus_times(*to, rows, x);
        }
    }

    /// Computes to = from + matrix * x in each run.
    #[inline(always)]
    pub fn sum_times<const R: usize>(&self, from: &[Lane<R>], x: &[Lane<R>], to: &mut [Lane<R>]) {
        if self.values.is_empty() {
            to.copy_from_slice(from);
        }
        for ((rows, from), to) in self.values.chunks_exact(self.fours.max(1)).zip(from).zip(to) {
            *to = plus_times(*from, rows, x);
        }
    }
}

/// Returns from + rows * x for four rows.
#[inline(always)]
fn plus_times<const R: usize>(from: Lane<R>, rows: &[[Quad; WIDE]], x: &[Lane<R>]) -> Lane<R> {
    // There are two sums, so that an addition need not wait for the previous one.
    let (mut even, mut odd) = (from, [Quad::default(); R]);
    for (columns, x) in rows.iter().zip(x) {
        for r in 0..R {
            for l in 0..WIDE {
                even[r].0[l] += columns[0].0[l] * x[r].0[0];
                odd[r].0[l] += columns[1].0[l] * x[r].0[1];
            }
            for l in 0..WIDE {
                even[r].0[l] += columns[2].0[l] * x[r].0[2];
                odd[r].0[l] += columns[3].0[l] * x[r].0[3];
            }
        }
    }
    std::array::from_fn(|r| Quad(std::array::from_fn(|l| even[r].0[l] + odd[r].0[l])))
}
