use super::taps::Taps;
use super::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};
use std::f64::consts::{PI, TAU};

use plid_fourier::C;

/// A delay of an output.
pub struct SensorDelay;

impl Effect for SensorDelay {
    fn name(&self) -> &'static str {
        "sensor-delay"
    }

    fn side(&self) -> Side {
        Side::Sensor
    }

    fn family(&self) -> Option<&'static str> {
        Some("a delayed measurement")
    }

    fn equation(&self) -> &'static str {
        "y'(t_k) = y(t_k - tau)"
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![Parameter::new("tau", "samples", Range::Positive)]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.outputs()
    }

    fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        [0.1, 0.5, 1.5, 4.0, 10.0].map(|samples| vec![samples]).to_vec()
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::SensorPath)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let Place::Output(o) = *place else { return Vec::new() };
        let (tau, past) = (parameters[0], setting.plant.controller.is_some());
        vec![Action::Sensor(Box::new(Delay { o, tau, past }))]
    }
}

struct Delay {
    o: usize,
    tau: f64,
    /// Whether values between samples depend on earlier samples alone, as they do for a controller that reads them.
    past: bool,
}

impl Sensor for Delay {
    fn apply(&self, y: &mut [Vec<f64>], sampling: Sampling, memory: &mut Memory) {
        let before = sampling.before(&y[self.o]);
        if self.past {
            // The first value of the record also sets the value before it.
            let [before] = *memory.values([before]);
            return Taps::of_measurement(self.tau).apply((self.o, &mut y[self.o]), before, memory);
        }
        delay(&mut y[self.o], self.tau, before);
    }
}

/// Least number of samples by which a record is continued beyond its end.
const BEYOND: usize = 64;

/// Delays a channel by any number of samples, with linear phase over the whole band. The channel had the value `before`
/// before the record.
///
/// The values between samples depend on samples on both sides, so the last ones depend on what follows the record. A
/// record that ended with a jump would cause ringing there. The record is therefore continued by its point reflection
/// about the last sample, which keeps the value and the slope. The continuation fades to the value before the record,
/// because the transform repeats the record periodically.
fn delay(y: &mut [f64], samples: f64, before: f64) {
    let Some(&last) = y.last() else { return };
    let beyond = BEYOND + samples.ceil() as usize;
    let length = plid_fourier::good_length(y.len() + beyond);
    let reflected = |k: usize| 2.0 * last - y.len().checked_sub(2 + k).map_or(last, |at| y[at]);
    let mut continued: Vec<f64> = y.iter().map(|y| y - before).collect();
    continued.extend((0..length - y.len()).map(|k| {
        let fading = 0.5 * (1.0 + (PI * (k as f64 / BEYOND as f64).min(1.0)).cos());
        fading * (reflected(k) - before)
    }));
    let mut spectrum = plid_fourier::forward(&continued);
    for (k, bin) in spectrum.iter_mut().enumerate() {
        *bin *= C::cis(-TAU * k as f64 * samples / length as f64);
    }
    let delayed = plid_fourier::backward(&spectrum, length);
    y.iter_mut().zip(&delayed).for_each(|(y, delayed)| *y = before + delayed);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::ActuatorDelay;
    use crate::plant::Plant;
    use crate::simulate::{Fineness, State, simulate};
    use nalgebra::dmatrix;

    /// Returns a damped mass whose position is measured.
    fn cart() -> (Plant, Setting) {
        let (a, b) = crate::testing::held(&dmatrix![0.0, 1.0; 0.0, -2.0], &dmatrix![0.0; 1.0], 1.0 / 500.0);
        let model = plid_model::Model::new(500.0, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap();
        let plant = Plant::new(&model).unwrap();
        let setting = Setting::bare(&plant, &model);
        (plant, setting)
    }

    /// With one input and one output, a delay of the command and a delay of the measurement are equivalent, even if
    /// the record ends far from where it began.
    #[test]
    fn a_late_sensor_is_a_late_command() {
        let (plant, setting) = cart();
        let u = crate::testing::random_input(4, 1500, 1);
        let delayed = |effect: &dyn Effect, place: Place| {
            let actions = effect.act(&setting, &place, &[1.6]);
            simulate(&plant, &actions, &u, 0.0, None, Fineness::FINE).remove(0)
        };
        let command = delayed(&ActuatorDelay, Place::Input(0));
        let sensor = delayed(&SensorDelay, Place::Output(0));
        let undelayed = simulate(&plant, &[], &u, 0.0, None, Fineness::FINE).remove(0);
        let most = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // The kinks that a held command leaves in the motion lie between the samples.
        let apart = most(&command, &sensor) / most(&command, &undelayed);
        assert!(apart < 5e-3, "{apart}");
    }

    /// A plant that was displaced before the record began does not cause a step in the signal of its sensor.
    #[test]
    fn a_displaced_plant_begins_without_a_step() {
        let (plant, setting) = cart();
        let start = State { rest: vec![3.0, 0.0], ..State::rest(&plant) };
        for (effect, parameter) in [(&SensorDelay as &dyn Effect, 1.6), (&crate::effects::SensorLag, 20.0)] {
            let actions = effect.act(&setting, &Place::Output(0), &[parameter]);
            let still = simulate(&plant, &actions, &[vec![0.0; 400]], 0.0, Some(&start), Fineness::FINE).remove(0);
            let (low, high) = still.iter().fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(*y), high.max(*y)));
            assert!(high - low < 1e-9 * high.abs() && high.abs() > 0.1, "{}: {low} {high}", effect.name());
        }
    }
}
