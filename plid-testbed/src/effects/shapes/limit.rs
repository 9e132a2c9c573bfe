//! Curves that keep a signal within plus and minus a limit.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::signed_power;
use crate::config::{not_negative, positive};
use crate::effects::family::{Halves, Shape};
use crate::effects::written::Laws;
use crate::error::TestbedError;

/// A curve that keeps a signal within plus and minus a limit. Each curve has the slope 1 at zero.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Limit {
    /// a tanh((x / a)^q)^(1 / q), with the sign of x: a hyperbolic tangent at q = 1, and a sharp corner as q grows
    Tanh {
        /// q; positive.
        knee: f64,
    },
    /// x / (1 + |x / a|^(1 / r))^r, and min(max(x, -a), a) at r = 0
    Clip {
        /// r; zero or more.
        rounding: f64,
    },
    /// a ((2 / pi) arctan((pi / 2) (x / a)^q))^(1 / q), with the sign of x
    Arctangent {
        /// q; positive.
        knee: f64,
    },
}

impl Laws for Limit {
    /// The limits of amplifiers range from hard to soft. C. Rapp's model of a transistor amplifier (1991) is the
    /// rounded clip. Its smoothness 1 / (2 r) is large for hard amplifiers, and one or two for soft ones. From r =
    /// 0.35 to 0.4, it differs from the hyperbolic tangent by less than 3 % of the limit; nothing is drawn there,
    /// because it would not be a near miss. The knees of the other two laws range from curves that already bend at
    /// half the limit to curves that are almost straight up to it.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "tanh",
            number: "knee",
            fixed: 1.0,
            ranges: Halves { development: &[[0.8, 1.3]], reported: &[[0.55, 0.7], [1.6, 2.5]] },
        },
        Shape {
            law: "clip",
            number: "rounding",
            fixed: 0.0,
            ranges: Halves { development: &[[0.0, 0.15]], reported: &[[0.2, 0.3], [0.65, 1.0]] },
        },
        Shape {
            law: "arctangent",
            number: "knee",
            fixed: 1.0,
            ranges: Halves { development: &[[0.85, 1.2]], reported: &[[0.6, 0.75], [1.4, 2.0]] },
        },
    ];
}

impl Limit {
    pub(crate) const TANH: Self = Self::Tanh { knee: 1.0 };
    pub(crate) const CLIP: Self = Self::Clip { rounding: 0.0 };

    pub(crate) fn of(self, x: f64, a: f64) -> f64 {
        let bent = |knee: f64, curve: fn(f64, f64) -> f64| {
            let power = signed_power(x, a, knee);
            // So far below the limit, every curve is a line to the last digit, and the power itself might underflow.
            let line = knee != 1.0 && power.abs() < 1e-9 * a;
            if line { x } else { signed_power(curve(power, a), a, 1.0 / knee) }
        };
        match self {
            Self::Tanh { knee } => bent(knee, |x, a| a * (x / a).tanh()),
            Self::CLIP => x.clamp(-a, a),
            Self::Clip { rounding } => x / (1.0 + (x / a).abs().powf(1.0 / rounding)).powf(rounding),
            Self::Arctangent { knee } => bent(knee, |x, a| 2.0 * a / PI * (PI * x / (2.0 * a)).atan()),
        }
    }

    pub(crate) fn check(self) -> Result<(), TestbedError> {
        match self {
            Self::Tanh { knee } | Self::Arctangent { knee } => positive("law.knee", knee),
            Self::Clip { rounding } => not_negative("law.rounding", rounding),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All curves have the slope 1 at zero, approach the limit for large signals, and tend to the hard clip.
    #[test]
    fn limits_lie_between_a_line_and_a_clip() {
        let a = 1.5;
        let of = |limit: Limit, x: f64| limit.of(x, a);
        for knee in [0.55, 0.8, 1.0, 1.7, 2.5] {
            let laws = [Limit::Tanh { knee }, Limit::Arctangent { knee }, Limit::Clip { rounding: 0.5 / knee }];
            for law in laws {
                assert!((of(law, 1e-6) / 1e-6 - 1.0).abs() < 2e-3, "{law:?}");
                assert!(of(law, 1e6) <= a && of(law, 1e6) > 0.99 * a, "{law:?}: {}", of(law, 1e6));
                assert!(of(law, 0.0) == 0.0 && of(law, -0.7) == -of(law, 0.7), "{law:?}");
                assert!((1..40).all(|k| of(law, 0.1 * f64::from(k)) > of(law, 0.1 * f64::from(k - 1))), "{law:?}");
            }
        }
        for law in [Limit::Tanh { knee: 300.0 }, Limit::Arctangent { knee: 300.0 }, Limit::Clip { rounding: 0.003 }] {
            for x in [-3.0, -0.6, 1.3, 1.6] {
                assert!((of(law, x) - of(Limit::CLIP, x)).abs() < 0.02 * a, "{law:?} at {x}: {}", of(law, x));
            }
        }
    }

    /// Between two of its intervals, the rounded clip is almost a hyperbolic tangent. The drawn curves are farther
    /// from it.
    #[test]
    fn a_rounded_clip_that_is_drawn_is_no_hyperbolic_tangent() {
        let leaves = |rounding: f64| {
            let differ = |x: f64| (Limit::Clip { rounding }.of(x, 1.0) - Limit::TANH.of(x, 1.0)).abs();
            (1..2000).map(|k| differ(0.005 * f64::from(k))).fold(0.0, f64::max)
        };
        assert!([0.35, 0.37, 0.4].iter().all(|rounding| leaves(*rounding) < 0.03));
        let clip = Limit::SHAPES.iter().find(|shape| shape.law == "clip").unwrap();
        let drawn = [clip.ranges.development, clip.ranges.reported].concat().concat();
        assert!(drawn.iter().all(|rounding| leaves(*rounding) > 0.05), "{drawn:?}");
    }
}
