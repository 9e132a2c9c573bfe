//! Signals that follow from a record's inputs, computed one block of samples at a time. All signals of all samples
//! would take tens of times the memory of the record and would be read from main memory, whereas a block stays in the
//! cache.

use std::ops::Range;

use crate::plant::Mode;
use crate::simulate::lanes::{Quad, WIDE};
use plid_fourier::C;

/// Number of samples in a block. It is not a power of two, because the same sample of many signals would then share a
/// few sets of the cache.
const BLOCK: usize = 248;

/// The signals of a record, in the order of their sources.
#[derive(Clone, Default)]
pub struct Signals {
    sources: Vec<Source>,
    count: usize,
}

/// A signal: its source, and its number among the signals of that source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signal {
    pub source: usize,
    pub number: usize,
}

impl Signal {
    /// Returns the imaginary part of a complex signal, which follows its real part.
    pub fn imaginary(self) -> Self {
        Self { number: self.number + 1, ..self }
    }
}

#[derive(Clone)]
struct Source {
    /// Number of the first signal among all.
    first: usize,
    kind: Kind,
}

#[derive(Clone)]
enum Kind {
    /// An input.
    Input(usize),
    Recurrence(Recurrence),
    Poles(Box<Poles>),
    /// A signal that was computed otherwise.
    Kept(Vec<f64>),
}

/// The recurrence z = turn z + held u, from a start: a complex signal, or its real part alone.
#[derive(Clone)]
pub struct Recurrence {
    pub turn: C,
    /// The input, and its factor.
    pub driven: Option<(usize, C)>,
    pub start: C,
    pub real: bool,
}

/// Complex numbers in lanes: the real parts, then the imaginary parts.
type Complex = [Quad; 2];

/// Up to four poles. The signals of a pole are its state under each input alone, with a shape of one. For a mode,
/// there is also the derivative, with respect to the pole, of the state under all inputs, with the mode's shape. All
/// signals are complex.
#[derive(Clone)]
struct Poles {
    lanes: usize,
    /// Number of inputs.
    m: usize,
    turn: Complex,
    held: Complex,
    slope: Option<Slope>,
}

/// The derivatives of `turn` and `held` with respect to the poles, and the input shape (m).
#[derive(Clone)]
struct Slope {
    turn: Complex,
    held: Complex,
    b: Vec<Complex>,
}

/// Returns one complex number for each pole, in lanes.
fn in_lanes(values: impl Iterator<Item = C>) -> Complex {
    let mut lanes = Complex::default();
    for (l, value) in values.enumerate() {
        (lanes[0].0[l], lanes[1].0[l]) = (value.re, value.im);
    }
    lanes
}

impl Poles {
    fn new(poles: &[C], m: usize, step: f64) -> Self {
        let of = |f: fn(C, f64) -> C| in_lanes(poles.iter().map(|&pole| f(pole, step)));
        Self { lanes: poles.len(), m, turn: of(turn), held: of(held), slope: None }
    }

    fn of_modes(modes: &[Mode], step: f64) -> Self {
        let poles: Vec<C> = modes.iter().map(|mode| mode.pole).collect();
        let m = modes[0].b.len();
        let of = |f: &dyn Fn(C) -> C| in_lanes(poles.iter().map(|&pole| f(pole)));
        let slope = Slope {
            turn: of(&|pole| turn(pole, step) * step),
            held: of(&|pole| (turn(pole, step) * step - held(pole, step)) / pole),
            b: (0..m).map(|i| in_lanes(modes.iter().map(|mode| mode.b[i]))).collect(),
        };
        Self { slope: Some(slope), ..Self::new(&poles, m, step) }
    }

    /// Returns the number of complex signals of a pole.
    fn each(&self) -> usize {
        self.m + usize::from(self.slope.is_some())
    }
}

/// Returns e^(pole step).
fn turn(pole: C, step: f64) -> C {
    (pole * step).exp()
}

/// Returns the increment of a state by a unit input that is held over a sample.
fn held(pole: C, step: f64) -> C {
    (turn(pole, step) - 1.0) / pole
}

/// The states of all sources before the next sample.
type States = Vec<Vec<Complex>>;

impl Signals {
    /// Adds an input.
    pub fn input(&mut self, input: usize) -> Signal {
        self.add(Kind::Input(input), 1)
    }

    /// Adds a recurrence.
    pub fn recurrence(&mut self, recurrence: Recurrence) -> Signal {
        let count = if recurrence.real { 1 } else { 2 };
        self.add(Kind::Recurrence(recurrence), count)
    }

    /// Adds a signal that was computed otherwise.
    pub fn kept(&mut self, signal: Vec<f64>) -> Signal {
        self.add(Kind::Kept(signal), 1)
    }

    /// Adds modes and returns, for each, its state under each input and the derivative with respect to its pole.
    pub fn modes(&mut self, modes: &[Mode], step: f64) -> Vec<(Vec<Signal>, Signal)> {
        let groups = modes.chunks(WIDE).flat_map(|modes| self.poles(Poles::of_modes(modes, step)));
        let split = |mut signals: Vec<Signal>| {
            let slope = signals.pop().expect("a mode has a derivative by its pole");
            (signals, slope)
        };
        groups.map(split).collect()
    }

    /// Adds the states of filters with these poles, and returns, for each pole, the state under each input.
    pub fn filters(&mut self, poles: &[C], m: usize, step: f64) -> Vec<Vec<Signal>> {
        poles.chunks(WIDE).flat_map(|poles| self.poles(Poles::new(poles, m, step))).collect()
    }

    fn poles(&mut self, source: Poles) -> Vec<Vec<Signal>> {
        let (lanes, each) = (source.lanes, source.each());
        let first = self.add(Kind::Poles(Box::new(source)), 2 * lanes * each);
        let of = |lane: usize| (0..each).map(|k| Signal { number: 2 * (lane * each + k), ..first }).collect();
        (0..lanes).map(of).collect()
    }

    fn add(&mut self, kind: Kind, count: usize) -> Signal {
        self.sources.push(Source { first: self.count, kind });
        self.count += count;
        Signal { source: self.sources.len() - 1, number: 0 }
    }

    /// Returns the number of signals.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the place of a signal among all.
    pub fn place(&self, signal: Signal) -> usize {
        self.sources[signal.source].first + signal.number
    }

    /// Returns the number of signals of a source.
    fn signals_of(&self, source: usize) -> usize {
        self.sources.get(source + 1).map_or(self.count, |next| next.first) - self.sources[source].first
    }

    /// Computes all signals of the first samples, block by block. `work` receives the range of samples, and one
    /// column for each signal.
    pub fn for_each_block(&self, u: &[Vec<f64>], samples: usize, mut work: impl FnMut(Range<usize>, &[f64])) {
        let mut states = self.start();
        let mut block = vec![0.0; BLOCK.min(samples) * self.count];
        for from in (0..samples).step_by(BLOCK) {
            let range = from..samples.min(from + BLOCK);
            for (source, state) in self.sources.iter().zip(&mut states) {
                source.advance(state, u, range.clone(), &mut block[source.first * range.len()..]);
            }
            work(range.clone(), &block[..self.count * range.len()]);
        }
    }

    /// Computes the signals of one source over the first samples, one column for each signal.
    pub fn whole(&self, source: usize, u: &[Vec<f64>], samples: usize) -> Vec<f64> {
        let mut signals = vec![0.0; samples * self.signals_of(source)];
        let source = &self.sources[source];
        source.advance(&mut source.start(), u, 0..samples, &mut signals);
        signals
    }

    fn start(&self) -> States {
        self.sources.iter().map(Source::start).collect()
    }
}

impl Source {
    fn start(&self) -> Vec<Complex> {
        match &self.kind {
            Kind::Recurrence(Recurrence { start, .. }) => {
                let lane = |x: f64| Quad([x, 0.0, 0.0, 0.0]);
                vec![[lane(start.re), lane(start.im)]]
            }
            Kind::Poles(poles) => vec![Complex::default(); poles.each()],
            Kind::Input(_) | Kind::Kept(_) => Vec::new(),
        }
    }

    /// Writes the signals of a range of samples, one column after the other, and renews the state.
    fn advance(&self, state: &mut [Complex], u: &[Vec<f64>], range: Range<usize>, to: &mut [f64]) {
        let length = range.len();
        match &self.kind {
            Kind::Input(input) => to[..length].copy_from_slice(&u[*input][range]),
            Kind::Kept(signal) => to[..length].copy_from_slice(&signal[range]),
            Kind::Poles(poles) => advance_poles(poles, state, u, range, to),
            Kind::Recurrence(recurrence) => recurrence.advance(&mut state[0], u, range, to),
        }
    }
}

impl Recurrence {
    fn advance(&self, state: &mut Complex, u: &[Vec<f64>], range: Range<usize>, to: &mut [f64]) {
        let length = range.len();
        let mut z = C::new(state[0].0[0], state[1].0[0]);
        for (k, n) in range.enumerate() {
            to[k] = z.re;
            if !self.real {
                to[length + k] = z.im;
            }
            z *= self.turn;
            if let Some((input, held)) = self.driven {
                z += held * u[input][n];
            }
        }
        (state[0].0[0], state[1].0[0]) = (z.re, z.im);
    }
}

/// Advances four poles at a time. The next state of a pole has to wait for the previous one, and meanwhile the
/// processor works on other poles.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
fn advance_poles(poles: &Poles, state: &mut [Complex], u: &[Vec<f64>], range: Range<usize>, to: &mut [f64]) {
    let (length, each) = (range.len(), poles.each());
    for (k, n) in range.enumerate() {
        for (signal, z) in state.iter().enumerate() {
            for lane in 0..poles.lanes {
                let at = 2 * (lane * each + signal) * length + k;
                (to[at], to[at + length]) = (z[0].0[lane], z[1].0[lane]);
            }
        }
        let (units, last) = state.split_at_mut(poles.m);
        if let (Some(slope), [last]) = (&poles.slope, last) {
            let (mut z, mut driven) = (Complex::default(), Complex::default());
            for ((unit, b), u) in units.iter().zip(&slope.b).zip(u) {
                z = sum(z, times(*b, *unit));
                driven = sum(driven, scaled(*b, u[n]));
            }
            let change = sum(times(slope.turn, z), times(slope.held, driven));
            *last = sum(times(poles.turn, *last), change);
        }
        for (unit, u) in units.iter_mut().zip(u) {
            *unit = sum(times(poles.turn, *unit), scaled(poles.held, u[n]));
        }
    }
}

#[inline(always)]
fn times(a: Complex, b: Complex) -> Complex {
    let [(ar, ai), (br, bi)] = [(a[0].0, a[1].0), (b[0].0, b[1].0)];
    [
        Quad(std::array::from_fn(|l| ar[l] * br[l] - ai[l] * bi[l])),
        Quad(std::array::from_fn(|l| ar[l] * bi[l] + ai[l] * br[l])),
    ]
}

#[inline(always)]
fn sum(a: Complex, b: Complex) -> Complex {
    std::array::from_fn(|part| Quad(std::array::from_fn(|l| a[part].0[l] + b[part].0[l])))
}

#[inline(always)]
fn scaled(a: Complex, factor: f64) -> Complex {
    std::array::from_fn(|part| Quad(std::array::from_fn(|l| a[part].0[l] * factor)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// The blocks are parts of the whole signals, and the states of modes are those of the recurrence.
    #[test]
    fn blocks_are_parts_of_the_whole() {
        let mode = |k: f64| Mode { pole: C::new(-2.0 * k, 40.0 * k), b: vec![C::new(1.0, k), C::ONE], c: vec![C::ONE] };
        let modes: Vec<Mode> = [1.0, 2.0, 3.0, 4.0, 5.0].map(mode).to_vec();
        let (u, samples, step) = (testing::random_input(1, 700, 2), 700, 1e-3);
        let mut signals = Signals::default();
        let of_modes = signals.modes(&modes, step);
        let last = &modes[4];
        let turn = (last.pole * step).exp();
        let held = (turn - 1.0) / last.pole;
        let alone = signals.recurrence(Recurrence { turn, driven: Some((1, held)), start: C::ZERO, real: false });
        signals.kept(u[0].clone());
        signals.input(1);
        let wholes: Vec<f64> = (0..signals.sources.len()).flat_map(|k| signals.whole(k, &u, samples)).collect();
        let mut seen = 0;
        signals.for_each_block(&u, samples, |range, block| {
            for (k, part) in block.chunks(range.len()).enumerate() {
                assert_eq!(part, &wholes[k * samples..][range.clone()], "signal {k}, {range:?}");
            }
            seen += range.len();
        });
        assert_eq!((seen, wholes.len()), (samples, signals.count() * samples));
        let column = |signal: Signal| &wholes[signals.place(signal) * samples..][..samples];
        for (a, b) in [(of_modes[4].0[1], alone), (of_modes[4].0[1].imaginary(), alone.imaginary())] {
            for (a, b) in column(a).iter().zip(column(b)) {
                assert!((a - b).abs() < 1e-15, "{a} {b}");
            }
        }
    }
}
