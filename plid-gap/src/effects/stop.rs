//! What stops on both sides and on one side have in common.

use super::{Force, Parameter, Place, Range, Setting};

/// Frequencies over the sample rate at which an axis would bounce on the stops from which fits start. A structure with
/// modes takes longer to simulate, and is tried with the last one alone.
const BOUNCES: [f64; 2] = [0.03, 0.12];

/// Positions of the stops from which fits start, over the largest displacement that was measured: a stop gives way.
pub(super) const OF_MEASURED: [f64; 2] = [0.97, 0.85];

/// The same over the RMS of the linear simulation, where no output measures the displacement.
pub(super) const OF_SIMULATED: [f64; 2] = [0.5, 1.2];

/// Damping ratio of the bounce from which fits start.
const BOUNCE_DAMPING: f64 = 0.3;

/// Highest frequency of a bounce over the sample rate: records do not show how hard a stop is on which the axis bounces
/// within a sample or two.
const FASTEST: f64 = 0.5;

/// Range of the position of a stop, over the RMS of the displacement in the linear simulation. A stop nearer to rest is
/// a spring or a clamp, and one farther away is not reached.
const REACHED: [f64; 2] = [0.02, 5.0];

/// Returns k and c of stops from which fits start, with each position.
pub(super) fn starts(setting: &Setting, place: &Place, positions: &[f64]) -> Vec<Vec<f64>> {
    let mobility = setting.plant.mobility(setting.port(place));
    let stop = |share: &f64, position: &f64| {
        let w = std::f64::consts::TAU * share * setting.plant.rate;
        vec![w * w / mobility, 2.0 * BOUNCE_DAMPING * w / mobility, *position]
    };
    let bounces = if setting.plant.modes.is_empty() { &BOUNCES[..] } else { &BOUNCES[1..] };
    bounces.iter().flat_map(|share| positions.iter().map(move |position| stop(share, position))).collect()
}

/// Returns whether records can show such a stop.
pub(super) fn sound(setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
    let port = setting.port(place);
    let bounce = (parameters[0] * setting.plant.mobility(port)).sqrt() / std::f64::consts::TAU;
    let at = parameters[2].abs() / setting.d_rms[port];
    bounce < FASTEST * setting.plant.rate && (REACHED[0]..REACHED[1]).contains(&at)
}

/// Stops exist where a force accelerates the axis at once and the displacement is known, at the places of linear
/// forces.
pub(super) fn places(setting: &Setting) -> Vec<Place> {
    let accelerates = |place: &Place| {
        let port = setting.port(place);
        setting.plant.ports[port].sees_displacement() && setting.plant.mobility(port) > 0.0
    };
    setting.loads().into_iter().filter(accelerates).collect()
}

/// Returns the parameters of a stop; the last one is its position.
pub(super) fn parameters(position: (&str, Range)) -> Vec<Parameter> {
    vec![
        Parameter::new("k", "force/displacement", Range::Positive),
        Parameter::new("c", "force/velocity", Range::Positive),
        Parameter::new(position.0, "displacement", position.1),
    ]
}

/// The sides of rest on which there is a stop.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sides {
    Both,
    Above,
    Below,
}

/// A spring k with a damper c beyond a distance g from rest.
pub(super) struct Stop {
    pub k: f64,
    pub c: f64,
    pub g: f64,
    pub sides: Sides,
}

impl Force for Stop {
    fn force(&self, d: f64, v: f64, _state: f64) -> f64 {
        let side = match self.sides {
            Sides::Both => d.signum(),
            Sides::Above => 1.0,
            Sides::Below => -1.0,
        };
        let x = side * d - self.g;
        // A stop pushes and never pulls.
        if x > 0.0 { -side * (self.k * x + self.c * side * v).max(0.0) } else { 0.0 }
    }

    fn steepest(&self) -> [f64; 2] {
        [self.k, self.c]
    }
}
