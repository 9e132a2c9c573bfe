use super::{Action, Effect, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};
use plid_fourier::C;
use std::f64::consts::{PI, TAU};

/// Mains frequencies in Hz.
const MAINS: [f64; 2] = [50.0, 60.0];

/// Relative distance from a mains frequency within which a line may be hum: grids stay within 1 % of their frequency
/// for 99.5 % of a year (EN 50160).
const MAINS_WIDTH: f64 = 0.01;

/// Harmonics in addition to the mains frequency: rectifiers cause odd ones; half-wave loads and poor symmetry cause
/// the second.
const HARMONICS: [u32; 3] = [2, 3, 5];

/// Mains hum on a sensor line, with its harmonics.
pub struct MainsHum;

impl Effect for MainsHum {
    fn name(&self) -> &'static str {
        "mains-hum"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn equation(&self) -> &'static str {
        "y' = y + a sin(2 pi f t + phi) + sum_h a_h sin(2 pi h f t + phi_h), h = 2, 3, 5"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        let mut parameters = vec![
            Parameter::new("a", "V", Range::Signed),
            Parameter::new("f", "Hz", Range::Hz),
            Parameter::new("phi", "rad", Range::Angle),
        ];
        for h in HARMONICS {
            parameters.push(Parameter::new(format!("a{h}"), "V", Range::Signed));
            parameters.push(Parameter::new(format!("phi{h}"), "rad", Range::Angle));
        }
        parameters
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let Place::Output(o) = *place else { return Vec::new() };
        let lines = || setting.tones.iter().map(|tone| tone.hz);
        let near = |mains: f64| lines().filter(move |hz| (hz / mains - 1.0).abs() < MAINS_WIDTH);
        let hz = MAINS.iter().flat_map(|&mains| near(mains).chain([mains]).take(2));
        let a = 0.02 * setting.y_rms[o];
        let start = |hz: f64, turns: f64| {
            let harmonics = HARMONICS.iter().flat_map(|_| [0.01 * a, 0.0]);
            [a, hz, turns * PI].into_iter().chain(harmonics).collect()
        };
        hz.flat_map(|hz| [0.0, 0.5].map(|turns| start(hz, turns))).collect()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn act(&self, _setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        let [a, f, phi] = [0, 1, 2].map(|k| parameters[k]);
        let mut lines = vec![(a, f, phi)];
        lines.extend(HARMONICS.iter().zip(parameters[3..].chunks(2)).map(|(&h, x)| (x[0], f64::from(h) * f, x[1])));
        vec![Action::Sensor(Box::new(Hum { o, lines }))]
    }
}

struct Hum {
    o: usize,
    /// Amplitude, frequency in Hz, phase.
    lines: Vec<(f64, f64, f64)>,
}

/// Number of samples after which a sine is recomputed. Between these samples, a complex product advances its phase,
/// which is many times faster and loses less than a digit.
const TURNED: usize = 64;

impl Sensor for Hum {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, _memory: &mut Memory) {
        for &(a, f, phi) in &self.lines {
            let turn = C::cis(TAU * f / sampling.rate);
            for (number, y) in y[self.o].chunks_mut(TURNED).enumerate() {
                let mut line = C::from_polar(a, TAU * f * sampling.time(number * TURNED) + phi);
                for y in y {
                    *y += line.im;
                    line *= turn;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lines_are_sines() {
        let lines = vec![(0.3, 49.97, 0.4), (-0.02, 149.91, 5.0)];
        let sampling = Sampling { t0: 17.3, rate: 1600.0, at_rest: false };
        let mut y = vec![vec![1.0; 1000]];
        Hum { o: 0, lines: lines.clone() }.apply(&mut y, sampling, &mut Memory::default());
        for (k, y) in y[0].iter().enumerate() {
            let line = |(a, f, phi): &(f64, f64, f64)| a * (TAU * f * sampling.time(k) + phi).sin();
            let exact = 1.0 + lines.iter().map(line).sum::<f64>();
            assert!((y - exact).abs() < 1e-12, "{k}: {y} {exact}");
        }
    }
}
