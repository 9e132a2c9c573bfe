//! The regressors of the black box: curves and products of signals of the linear simulation.

use nalgebra::{Complex, DVector};
use plid_gap::case::Channels;
use plid_gap::research::{Fineness, Plant, simulate};
use serde::{Deserialize, Serialize};

/// The curves of a signal that is scaled to unit RMS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// One, whatever the signal is.
    One,
    /// The signal itself.
    Linear,
    /// Its square.
    Square,
    /// Its cube.
    Cube,
    /// Its magnitude.
    Magnitude,
    /// A smooth approximation of its sign.
    Sign,
    /// Its part beyond one RMS.
    BeyondOne,
    /// Its part beyond two RMS.
    BeyondTwo,
    /// The output of a play operator (backlash) with half an RMS on either side.
    Play,
}

/// The curves that apply to every signal.
const CURVES: [Curve; 8] = [
    Curve::Linear,
    Curve::Square,
    Curve::Cube,
    Curve::Magnitude,
    Curve::Sign,
    Curve::BeyondOne,
    Curve::BeyondTwo,
    Curve::Play,
];
/// The curves of a displacement by which the velocity at the same port is multiplied.
const FACTORS: [Curve; 3] = [Curve::Linear, Curve::Magnitude, Curve::Square];
/// Width in RMS over which the sign changes.
const SIGN_WIDTH: f64 = 0.1;
/// Half of the play in RMS.
const PLAY: f64 = 0.5;

impl Curve {
    fn of(self, signal: impl Iterator<Item = f64>) -> Vec<f64> {
        let beyond = |x: f64, limit: f64| x - x.clamp(-limit, limit);
        let mut follower = 0.0_f64;
        let value = |x: f64| match self {
            Self::One => 1.0,
            Self::Linear => x,
            Self::Square => x * x,
            Self::Cube => x * x * x,
            Self::Magnitude => x.abs(),
            Self::Sign => x / x.hypot(SIGN_WIDTH),
            Self::BeyondOne => beyond(x, 1.0),
            Self::BeyondTwo => beyond(x, 2.0),
            Self::Play => {
                follower = follower.clamp(x - PLAY, x + PLAY);
                follower
            }
        };
        signal.map(value).collect()
    }
}

/// The second factor of a regressor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Factor {
    /// The signal with this number.
    Signal(usize),
    /// Time.
    Time,
}

/// A curve of a signal, which may be multiplied by a second factor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regressor {
    /// The curve.
    pub curve: Curve,
    /// The number of the signal.
    pub of: usize,
    /// The second factor, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<Factor>,
}

/// The range of a signal in the records from which the black box learns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Extent {
    /// The RMS.
    pub rms: f64,
    /// The largest magnitude. Outside it, curves are continued as constants, so that a prediction is bounded.
    pub peak: f64,
}

/// Returns the signals of a linear run from rest: the inputs, the outputs, the displacement and the velocity of each
/// port, and the change of each input since the last sample.
pub(super) fn signals(plant: &Plant, u: &[Vec<f64>]) -> Channels {
    let outputs = simulate(plant, &[], u, 0.0, None, Fineness::COARSE);
    let changes = u.iter().map(|x| (0..x.len()).map(|k| x[k] - if k == 0 { 0.0 } else { x[k - 1] }).collect());
    u.iter().cloned().chain(outputs).chain(motions(plant, u)).chain(changes).collect()
}

/// Returns the displacement and the velocity of each port in turn.
fn motions(plant: &Plant, u: &[Vec<f64>]) -> Channels {
    let samples = u.first().map_or(0, Vec::len);
    let step = 1.0 / plant.rate;
    let poles: Vec<Complex<f64>> = plant.modes.iter().map(|mode| (mode.pole * step).exp()).collect();
    let gains: Vec<Complex<f64>> = poles.iter().zip(&plant.modes).map(|(z, mode)| (z - 1.0) / mode.pole).collect();
    let mut modes = vec![Complex::new(0.0, 0.0); poles.len()];
    let mut rest = DVector::zeros(plant.rest.a.nrows());
    let mut motions = vec![vec![0.0; samples]; 2 * plant.ports.len()];
    for k in 0..samples {
        for (port, motion) in plant.ports.iter().zip(motions.chunks_mut(2)) {
            let of_modes =
                |row: &[Complex<f64>]| -> f64 { row.iter().zip(&modes).map(|(row, z)| 2.0 * (row * z).re).sum() };
            motion[0][k] = of_modes(&port.displacement) + port.displacement_rest.dot(&rest);
            motion[1][k] = of_modes(&port.velocity) + port.velocity_rest.dot(&rest);
        }
        let now = DVector::from_iterator(u.len(), u.iter().map(|channel| channel[k]));
        for ((z, mode), (pole, gain)) in modes.iter_mut().zip(&plant.modes).zip(poles.iter().zip(&gains)) {
            let driven: Complex<f64> = mode.b.iter().zip(now.iter()).map(|(b, u)| b * *u).sum();
            *z = pole * *z + gain * driven;
        }
        rest = &plant.rest.a * rest + &plant.rest.b * now;
    }
    motions
}

/// Returns all regressors of a plant whose signals have these extents. A signal that is always zero has none.
pub(super) fn all(plant: &Plant, extents: &[Extent]) -> Vec<Regressor> {
    let lively = |signal: &usize| extents[*signal].rms > 0.0;
    let mut all = [None, Some(Factor::Time)].map(|times| Regressor { curve: Curve::One, of: 0, times }).to_vec();
    for of in (0..extents.len()).filter(lively) {
        all.extend(CURVES.map(|curve| Regressor { curve, of, times: None }));
    }
    let channels = plant.m + plant.p;
    let motions = 2 * plant.ports.len();
    for of in (0..channels).filter(lively) {
        all.push(Regressor { curve: Curve::Linear, of, times: Some(Factor::Time) });
    }
    for of in (channels..channels + motions).step_by(2).filter(lively) {
        all.extend(FACTORS.map(|curve| Regressor { curve, of, times: Some(Factor::Signal(of + 1)) }));
    }
    all
}

/// The signals of a record and its times relative to the end of the records from which the black box learns.
pub(super) struct Run {
    pub signals: Channels,
    pub times: Vec<f64>,
}

impl Regressor {
    /// Returns the values of the regressor in a run.
    pub(super) fn values(&self, run: &Run, extents: &[Extent]) -> Vec<f64> {
        let scaled = |signal: usize| {
            let Extent { rms, peak } = extents[signal];
            run.signals[signal].iter().map(move |x| x.clamp(-peak, peak) / rms)
        };
        let mut values = match self.curve {
            Curve::One => vec![1.0; run.times.len()],
            curve => curve.of(scaled(self.of)),
        };
        match self.times {
            None => {}
            Some(Factor::Signal(other)) => values.iter_mut().zip(scaled(other)).for_each(|(x, by)| *x *= by),
            Some(Factor::Time) => values.iter_mut().zip(&run.times).for_each(|(x, by)| *x *= by),
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_what_they_are_called() {
        let x = [0.0, 1.5, -3.0, 2.5];
        let of = |curve: Curve| curve.of(x.into_iter());
        assert_eq!(of(Curve::Cube), [0.0, 3.375, -27.0, 15.625]);
        assert_eq!(of(Curve::BeyondOne), [0.0, 0.5, -2.0, 1.5]);
        assert_eq!(of(Curve::BeyondTwo), [0.0, 0.0, -1.0, 0.5]);
        // The follower trails by half an RMS in either direction.
        assert_eq!(of(Curve::Play), [0.0, 1.0, -2.5, 2.0]);
        assert!(of(Curve::Sign).iter().zip([0.0, 1.0, -1.0, 1.0]).all(|(a, b): (&f64, f64)| (a - b).abs() < 0.01));
    }

    /// Once the input has ended, the velocity at an inferred port of a slow mode is the slope of the displacement. The
    /// change of the input is the last signal.
    #[test]
    fn signals_are_in_their_order() {
        let (sin, cos) = 0.1_f64.sin_cos();
        let text = serde_json::json!({
            "format": "state-space", "sample_rate_hz": 100.0, "inputs": ["u1"], "outputs": ["y1"],
            "A": [[0.99 * cos, 0.99 * sin], [-0.99 * sin, 0.99 * cos]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]],
            "D": [[0.0]],
        });
        let plant = Plant::new(&plid_model::Model::from_json(&text, "here").unwrap()).unwrap();
        let u: Vec<f64> = (0..400).map(|k| if k < 200 { (0.05 * k as f64).sin() } else { 0.0 }).collect();
        let found = signals(&plant, std::slice::from_ref(&u));
        let [input, _, d, v, change] = found.as_slice() else { panic!("{} signals", found.len()) };
        assert_eq!((input, change[7]), (&u, u[7] - u[6]));
        let largest = v[201..].iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let off = (201..399).map(|k| (v[k] - 50.0 * (d[k + 1] - d[k - 1])).abs()).fold(0.0, f64::max);
        assert!(largest > 0.0 && off < 0.01 * largest, "{off} {largest}");
    }

    #[test]
    fn beyond_what_was_seen_a_curve_is_constant() {
        let extents = [Extent { rms: 2.0, peak: 4.0 }, Extent { rms: 1.0, peak: 10.0 }];
        let run = Run { signals: vec![vec![2.0, 40.0, -40.0], vec![1.0, 2.0, 3.0]], times: vec![0.0, 0.5, 1.0] };
        let regressor = |times| Regressor { curve: Curve::Square, of: 0, times };
        assert_eq!(regressor(None).values(&run, &extents), [1.0, 4.0, 4.0]);
        assert_eq!(regressor(Some(Factor::Signal(1))).values(&run, &extents), [1.0, 8.0, 12.0]);
        assert_eq!(regressor(Some(Factor::Time)).values(&run, &extents), [0.0, 2.0, 4.0]);
    }
}
