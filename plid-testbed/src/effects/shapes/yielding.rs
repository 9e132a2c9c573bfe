//! The evolution of a displacement that yields.

use serde::{Deserialize, Serialize};

use crate::config::{not_negative, positive};
use crate::effects::family::{Halves, Shape};
use crate::effects::written::Laws;
use crate::error::TestbedError;

/// The evolution of a displacement z that yields: dz/dx, where x is the displacement, s the initial slope, and
/// +-`most` the bounds of z. All laws are members of the family of Bouc and Wen, dz = s dx - s (beta |dx| z
/// |z|^(n - 1) + gamma dx |z|^n) / most^n, with beta + gamma = 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Yielding {
    /// n = 1, beta = gamma: straight during unloading.
    #[default]
    BoucWen,
    /// n = 1, beta - gamma = c: curved during unloading, too. With c = 1, this is Dahl's friction.
    Dahl {
        /// c; zero or more.
        unloading: f64,
    },
    /// n, beta = gamma: the knee is sharper for a larger n.
    Sharp {
        /// n; positive.
        exponent: f64,
    },
}

impl Laws for Yielding {
    /// A loop that creates no energy requires beta >= |gamma|, and thus c >= 0. At c = 0, unloading is straight;
    /// beyond 1 (gamma below zero), the flanks of the loop bulge. Fitted exponents are between 1 and 2 for smooth
    /// joints and wire ropes, and up to about 6 for metal that yields. As n tends to infinity, the knee becomes that
    /// of a dry slider on a spring.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "dahl",
            number: "unloading",
            fixed: 1.0,
            ranges: Halves { development: &[[0.75, 1.3]], reported: &[[0.3, 0.6], [1.6, 2.2]] },
        },
        Shape {
            law: "sharp",
            number: "exponent",
            fixed: 2.0,
            ranges: Halves { development: &[[1.7, 2.5]], reported: &[[1.25, 1.5], [3.0, 6.0]] },
        },
    ];
}

impl Yielding {
    /// Returns dz/dt, where `rate` is dx/dt.
    pub(crate) fn rate(self, z: f64, slope: f64, most: f64, rate: f64) -> f64 {
        let yielded = match self {
            Self::BoucWen => (rate.abs() * z + rate * z.abs()) / (2.0 * most),
            Self::Dahl { unloading } => {
                ((1.0 + unloading) * (rate.abs() * z) + (1.0 - unloading) * (rate * z.abs())) / (2.0 * most)
            }
            Self::Sharp { .. } if z == 0.0 => 0.0,
            Self::Sharp { exponent } => {
                let square = (rate.abs() * z * z.abs() + rate * z * z) / (2.0 * most * most);
                square * (z / most).abs().powf(exponent - 2.0)
            }
        };
        slope * (rate - yielded)
    }

    /// Returns z after a step of x, which does not depend on the speed of the step.
    pub(crate) fn step(self, z: f64, slope: f64, most: f64, dx: f64) -> f64 {
        // The law is odd: a step down is a step up of -z.
        let sign = if dx < 0.0 { -1.0 } else { 1.0 };
        let (z, way) = self.unloaded(sign * z, most, slope * dx.abs());
        let end = match self {
            Self::BoucWen | Self::Dahl { .. } => most + (z - most) * (-way / most).exp(),
            Self::SQUARE => {
                let t = (way / most).tanh();
                (z + most * t) / (1.0 + z / most * t)
            }
            Self::Sharp { exponent } => most * loaded(z / most, way / most, exponent),
        };
        sign * if way > 0.0 { end } else { z }
    }

    /// The sharp law whose loading is a hyperbolic tangent.
    const SQUARE: Self = Self::Sharp { exponent: 2.0 };

    /// Dahl's own law, whose loading is a single exponential from below zero to above it.
    const DAHL: Self = Self::Dahl { unloading: 1.0 };

    /// Returns z after the part of a path (a positive s dx) on which it unloads, and the rest of the path. Below
    /// zero, dz = s dx (1 + c |z| / most), which is straight for c = 0.
    fn unloaded(self, z: f64, most: f64, way: f64) -> (f64, f64) {
        match self {
            Self::DAHL => (z, way),
            Self::Dahl { unloading } if unloading > 0.0 && z < 0.0 => {
                let length = most / unloading;
                let to_zero = length * (-z / length).ln_1p();
                if way < to_zero {
                    return (z * (-way / length).exp() - length * (-way / length).exp_m1(), 0.0);
                }
                (0.0, way - to_zero)
            }
            _ => {
                let straight = (-z).clamp(0.0, way);
                (z + straight, way - straight)
            }
        }
    }

    pub(crate) fn check(self) -> Result<(), TestbedError> {
        match self {
            Self::BoucWen => Ok(()),
            Self::Dahl { unloading } => not_negative("law.unloading", unloading),
            Self::Sharp { exponent } => positive("law.exponent", exponent),
        }
    }
}

/// Returns z after a path `way` of loading from `z`, both relative to the bound, where dz = dx (1 - z^n). Except for
/// n = 1 and n = 2, there is no explicit closed form, so Runge-Kutta steps are used.
fn loaded(z: f64, way: f64, n: f64) -> f64 {
    /// The length of a step relative to the bound, and the path after which any z has reached the bound to the last
    /// digit.
    const STEP: f64 = 0.02;
    const ENOUGH: f64 = 40.0;
    let way = way.min(ENOUGH);
    let steps = (way / STEP).ceil();
    let (h, slope) = (way / steps, |z: f64| 1.0 - z.clamp(0.0, 1.0).powf(n));
    (0..steps as usize).fold(z, |z, _| {
        let a = slope(z);
        let b = slope(z + h / 2.0 * a);
        let c = slope(z + h / 2.0 * b);
        let d = slope(z + h * c);
        (z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)).min(1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOPE: f64 = 0.7;
    const MOST: f64 = 0.5;

    /// Returns z at the end of each of several steps, by the law and by a fine integration of its rate.
    fn steps(law: Yielding) -> [Vec<f64>; 2] {
        let (mut closed, mut fine) = (0.0, 0.0);
        let ends = [0.9, -0.4, -1.3, 0.2, 2.0, -3.0, 0.1].map(|dx: f64| {
            closed = law.step(closed, SLOPE, MOST, dx);
            let steps = 200_000;
            for _ in 0..steps {
                let h = dx / f64::from(steps);
                let middle = fine + law.rate(fine, SLOPE, MOST, h) / 2.0;
                fine += law.rate(middle, SLOPE, MOST, h);
            }
            (closed, fine)
        });
        [ends.map(|(closed, _)| closed).to_vec(), ends.map(|(_, fine)| fine).to_vec()]
    }

    #[test]
    fn steps_agree_with_a_fine_integration_of_their_rate() {
        let dahl = [0.0, 0.3, 0.6, 1.0, 1.6, 2.2].map(|unloading| Yielding::Dahl { unloading });
        let sharp = [1.0, 1.25, 1.7, 2.0, 2.5, 6.0].map(|exponent| Yielding::Sharp { exponent });
        for law in dahl.into_iter().chain(sharp).chain([Yielding::BoucWen]) {
            let [closed, fine] = steps(law);
            for (closed, fine) in closed.into_iter().zip(fine) {
                assert!((closed - fine).abs() < 1e-6, "{law:?}: {closed} and {fine}");
                assert!(closed.abs() <= MOST);
            }
        }
    }

    /// Both families contain the law of Bouc and Wen, and their members with closed forms agree with neighbouring
    /// members.
    #[test]
    fn both_families_contain_the_vocabulary_s_own_law() {
        let differ = |a: Yielding, b: Yielding| {
            let [a, b] = [a, b].map(|law| steps(law)[0].clone());
            a.into_iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()))
        };
        assert!(differ(Yielding::Dahl { unloading: 0.0 }, Yielding::BoucWen) < 1e-15);
        assert!(differ(Yielding::Sharp { exponent: 1.0 }, Yielding::BoucWen) < 1e-8);
        assert!(differ(Yielding::Dahl { unloading: 1.0 + 1e-9 }, Yielding::DAHL) < 1e-8);
        assert!(differ(Yielding::Sharp { exponent: 2.0 + 1e-9 }, Yielding::SQUARE) < 1e-7);
    }
}
