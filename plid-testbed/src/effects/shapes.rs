//! Curves that more than one effect uses.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

/// How a signal is kept within plus and minus a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// a tanh(x / a)
    Tanh,
    /// min(max(x, -a), a)
    Clip,
    /// (2 a / pi) arctan(pi x / (2 a))
    Arctangent,
}

impl Limit {
    pub(crate) fn of(self, x: f64, a: f64) -> f64 {
        match self {
            Limit::Tanh => a * (x / a).tanh(),
            Limit::Clip => x.clamp(-a, a),
            Limit::Arctangent => 2.0 * a / PI * (PI * x / (2.0 * a)).atan(),
        }
    }
}

/// The part beyond a gap around zero: x - g above g, x + g below -g.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gap {
    /// With a corner at plus and minus g.
    #[default]
    Sharp,
    /// The corners are hyperbolae that leave it by g / 6 at most.
    Rounded,
    /// The lower edge is at -g / 2.
    Asymmetric,
}

impl Gap {
    pub(crate) fn beyond(self, x: f64, g: f64) -> f64 {
        match self {
            Gap::Sharp => (x - g).max(0.0) + (x + g).min(0.0),
            Gap::Rounded => {
                let ramp = |over: f64| (over + over.hypot(g / 3.0)) / 2.0;
                ramp(x - g) - ramp(-x - g)
            }
            Gap::Asymmetric => (x - g).max(0.0) + (x + g / 2.0).min(0.0),
        }
    }
}

/// The force of a spring k with a damper c that is pressed in by x at the speed dx/dt: a stop pushes and never pulls.
pub(crate) fn stop(k: f64, c: f64, x: f64, speed: f64) -> f64 {
    if x > 0.0 { (k * x + c * speed).max(0.0) } else { 0.0 }
}

/// The course of a slow change in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Course {
    /// As t.
    #[default]
    Linear,
    /// As T (1 - exp(-t / T)) with T of 10 s: the same slope at first, then it settles.
    Settling,
}

impl Course {
    pub(crate) fn at(self, t_s: f64) -> f64 {
        const SETTLING_S: f64 = 10.0;
        match self {
            Course::Linear => t_s,
            Course::Settling => SETTLING_S * (1.0 - (-t_s / SETTLING_S).exp()),
        }
    }
}

/// The evolution of a displacement that yields: dz/dx with x the displacement, s the slope at first and +-`most` the
/// bounds of z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Yielding {
    /// dz = s dx - s (|dx| z + dx |z|) / (2 most): straight while it unloads.
    #[default]
    BoucWen,
    /// dz = s dx - s |dx| z / most: Dahl's friction, curved while it unloads too.
    Dahl,
    /// dz = s dx - s (|dx| z |z| + dx z^2) / (2 most^2): with a sharper knee.
    Sharp,
}

impl Yielding {
    /// dz/dt at dx/dt.
    pub(crate) fn rate(self, z: f64, slope: f64, most: f64, rate: f64) -> f64 {
        let yielded = match self {
            Yielding::BoucWen => (rate.abs() * z + rate * z.abs()) / (2.0 * most),
            Yielding::Dahl => rate.abs() * z / most,
            Yielding::Sharp => (rate.abs() * z * z.abs() + rate * z * z) / (2.0 * most * most),
        };
        slope * (rate - yielded)
    }

    /// z after a step of x: the closed form of the above, for it does not depend on the step's speed.
    pub(crate) fn step(self, z: f64, slope: f64, most: f64, dx: f64) -> f64 {
        // The law is odd: a step down is a step up of -z.
        let sign = if dx < 0.0 { -1.0 } else { 1.0 };
        let (z, way) = (sign * z, slope * dx.abs());
        // Below zero z unloads straight, except in Dahl's law; what is left of the way then loads.
        let straight = if self == Yielding::Dahl { 0.0 } else { (-z).clamp(0.0, way) };
        let (z, way) = (z + straight, way - straight);
        let end = match self {
            Yielding::BoucWen | Yielding::Dahl => most + (z - most) * (-way / most).exp(),
            Yielding::Sharp => {
                let t = (way / most).tanh();
                (z + most * t) / (1.0 + z / most * t)
            }
        };
        sign * if way > 0.0 { end } else { z }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_agree_with_a_fine_integration_of_their_rate() {
        for law in [Yielding::BoucWen, Yielding::Dahl, Yielding::Sharp] {
            let (slope, most) = (0.7, 0.5);
            let (mut closed, mut fine) = (0.0, 0.0);
            for dx in [0.9, -0.4, -1.3, 0.2, 2.0, -3.0] {
                closed = law.step(closed, slope, most, dx);
                let steps = 200_000;
                for _ in 0..steps {
                    let h = dx / f64::from(steps);
                    let middle = fine + law.rate(fine, slope, most, h) / 2.0;
                    fine += law.rate(middle, slope, most, h);
                }
                assert!((closed - fine).abs() < 1e-6, "{law:?}: {closed} and {fine}");
                assert!(closed.abs() <= most);
            }
        }
    }
}
