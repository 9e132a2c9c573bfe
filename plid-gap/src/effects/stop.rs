//! The common part of stops on one side and on both sides.

use super::{Force, Parameter, Place, Range, Setting};

/// Frequencies over the sample rate at which an axis would bounce on the stops from which fits start. A structure
/// with several modes takes longer to simulate, so only one frequency is tried for it.
const BOUNCES: [f64; 4] = [0.02, 0.05, 0.12, 0.3];
const BOUNCE_OF_MODES: [f64; 1] = [0.12];

/// Depth to which an axis enters the stops from which fits start, over the depth at which an axis that arrives with
/// its RMS velocity reverses. The stop is placed this far before the largest measured displacement.
const DEPTHS: [f64; 2] = [0.5, 1.5];

/// Least position of these stops, over the largest measured displacement.
const NEAREST: f64 = 0.3;

/// Positions of the stops from which fits start where no output measures the displacement, over the RMS of the
/// displacement in the linear simulation.
const OF_SIMULATED: [f64; 2] = [0.5, 1.2];

/// Damping ratio of the bounce from which fits start.
const BOUNCE_DAMPING: f64 = 0.3;

/// Highest bounce frequency over the sample rate. If the axis bounces within a sample or two, the records do not
/// determine the stiffness of the stop.
const FASTEST: f64 = 0.5;

/// Range of the position of a stop, over the largest displacement that was measured on its side, or over the RMS of the
/// displacement in the linear simulation where no output measures it. A stop nearer to rest is a spring or a clamp, and
/// one farther away is not reached.
const REACHED: [f64; 2] = [0.02, 1.05];
const REACHED_OF_SIMULATED: [f64; 2] = [0.02, 5.0];

/// Returns k, c and the position of stops from which fits start. `ends` are the largest displacements that were
/// measured on the sides where there may be a stop. Without them, `signs` gives the signs of the positions.
pub(super) fn starts(setting: &Setting, place: &Place, ends: Option<&[f64]>, signs: &[f64]) -> Vec<Vec<f64>> {
    let port = setting.port(place);
    let mobility = setting.plant.mobility(port);
    let bounces = if setting.plant.modes.len() <= 1 { &BOUNCES[..] } else { &BOUNCE_OF_MODES[..] };
    let mut starts = Vec::new();
    for share in bounces {
        let w = std::f64::consts::TAU * share * setting.plant.rate;
        let before = |end: &f64, depth: f64| {
            let size = (end.abs() - depth * setting.v_rms[port] / w).max(NEAREST * end.abs());
            size.copysign(*end)
        };
        let positions: Vec<f64> = match ends {
            Some(ends) => ends.iter().flat_map(|end| DEPTHS.map(|depth| before(end, depth))).collect(),
            None => signs.iter().flat_map(|sign| OF_SIMULATED.map(|x| sign * x * setting.d_rms[port])).collect(),
        };
        let stop = |position: f64| vec![w * w / mobility, 2.0 * BOUNCE_DAMPING * w / mobility, position];
        starts.extend(positions.into_iter().map(stop));
    }
    starts
}

/// Returns k, c and the position of the stop that is closest to another law of contact; `None` if the other law is
/// not a contact, or if its stiffness is negative.
pub(super) fn start_from(setting: &Setting, place: &Place, (name, found): (&str, &[f64])) -> Option<[f64; 3]> {
    match (name, found) {
        ("clearance", &[k, g]) if k > 0.0 => {
            let mobility = setting.plant.mobility(setting.port(place));
            Some([k, 2.0 * BOUNCE_DAMPING * (k / mobility).sqrt(), g])
        }
        ("end-stop" | "one-sided-stop", &[k, c, at]) => Some([k, c, at]),
        _ => None,
    }
}

/// Returns whether records can determine a stop with these parameters, on both sides or on the side of its position.
pub(super) fn sound(setting: &Setting, place: &Place, parameters: &[f64], sides: Sides) -> bool {
    let port = setting.port(place);
    let bounce = (parameters[0] * setting.plant.mobility(port)).sqrt() / std::f64::consts::TAU;
    let end = |[low, high]: [f64; 2]| match sides {
        Sides::Both => high.max(-low),
        Sides::Above => high,
        Sides::Below => -low,
    };
    let (size, [nearest, farthest]) = match setting.d_range[port] {
        Some(range) => (end(range), REACHED),
        None => (setting.d_rms[port], REACHED_OF_SIMULATED),
    };
    bounce < FASTEST * setting.plant.rate && (nearest * size..farthest * size).contains(&parameters[2].abs())
}

/// Returns the locations at which there may be a stop: those of linear forces at which a force accelerates the axis
/// immediately and the displacement is known.
pub(super) fn places(setting: &Setting) -> Vec<Place> {
    setting.inertias().into_iter().filter(|place| setting.sees_displacement(place)).collect()
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

impl Sides {
    /// Returns the side of a position.
    pub fn of(position: f64) -> Self {
        if position >= 0.0 { Self::Above } else { Self::Below }
    }
}

/// A spring k with a damper c beyond a distance g from rest.
pub(super) struct Stop {
    pub k: f64,
    pub c: f64,
    pub g: f64,
    pub sides: Sides,
}

impl Stop {
    /// Returns the side on which a displacement may meet the stop.
    fn side(&self, d: f64) -> f64 {
        match self.sides {
            Sides::Both => d.signum(),
            Sides::Above => 1.0,
            Sides::Below => -1.0,
        }
    }
}

impl Force for Stop {
    fn force(&self, d: f64, v: f64, _state: &[f64]) -> f64 {
        let side = self.side(d);
        let x = side * d - self.g;
        // A stop pushes and never pulls.
        if x > 0.0 { -side * (self.k * x + self.c * side * v).max(0.0) } else { 0.0 }
    }

    /// If the stop is reached within the step, the damper's force begins at that moment, with the speed at contact.
    /// If this force counted for the whole step, the motion would not depend smoothly on the position of the stop.
    fn at_end(&self, [before, v_before]: [f64; 2], [d, v]: [f64; 2], state: &[f64]) -> f64 {
        let (side, end) = (self.side(d), self.force(d, v, state));
        let [from, to] = [before, d].map(|d| side * d - self.g);
        if from >= 0.0 || to <= 0.0 {
            return end;
        }
        let since = to / (to - from);
        let speed = v + since * (v_before - v);
        since * (end - side * (self.c * side * speed).max(0.0))
    }

    fn steepest(&self) -> [f64; 2] {
        [self.k, self.c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean force over a step in which a stop is reached grows with the share of the step after the contact, from
    /// zero to the mean of the forces at the contact and at the end.
    #[test]
    fn a_stop_acts_from_where_it_is_reached() {
        let (k, c, step, speed) = (50.0, 3.0, 0.01, 2.0);
        for (sides, side) in [(Sides::Both, 1.0), (Sides::Both, -1.0), (Sides::Above, 1.0), (Sides::Below, -1.0)] {
            let stop = Stop { k, c, g: 0.4, sides };
            let mean = |since: f64| {
                let to = 0.4 + since * step * speed;
                let at = |d: f64| [side * d, side * speed];
                stop.at_end(at(to - step * speed), at(to), &[]) / 2.0
            };
            for since in [1e-9, 0.1, 0.5, 0.9, 1.0 - 1e-9] {
                let exact = -side * since * (c * speed + 0.5 * k * since * step * speed);
                assert!((mean(since) - exact).abs() < 1e-9, "{since}: {} {exact}", mean(since));
            }
        }
    }
}
