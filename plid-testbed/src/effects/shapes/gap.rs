//! The part of a signal that lies beyond a gap around zero.

use serde::{Deserialize, Serialize};

use crate::config::{not_negative, positive};
use crate::effects::family::{Halves, Shape};
use crate::effects::written::Laws;
use crate::error::TestbedError;

/// The part beyond a gap around zero: x - g above g, x + g below -g.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Gap {
    /// With a corner at plus and minus g.
    #[default]
    Sharp,
    /// The corners are hyperbolae that deviate from the sharp corners by at most g / (2 s).
    Rounded {
        /// s; positive.
        sharpness: f64,
    },
    /// The lower edge is at -e g.
    Asymmetric {
        /// e; zero or more.
        lower: f64,
    },
}

impl Laws for Gap {
    /// Surfaces that meet at a point or a line, or with a film between them, come into contact gradually: the corner
    /// spreads over a tenth of the gap to more than half of it. Parts are seldom assembled in the middle of their
    /// play, so one edge is nearer than the other. In development, the nearer edge is always the lower one.
    const SHAPES: &'static [Shape] = &[
        Shape {
            law: "rounded",
            number: "sharpness",
            fixed: 3.0,
            ranges: Halves { development: &[[2.5, 4.0]], reported: &[[1.2, 1.9], [5.5, 9.0]] },
        },
        Shape {
            law: "asymmetric",
            number: "lower",
            fixed: 0.5,
            ranges: Halves { development: &[[0.4, 0.65]], reported: &[[0.1, 0.3], [1.5, 2.5]] },
        },
    ];
}

impl Gap {
    pub(crate) fn beyond(self, x: f64, g: f64) -> f64 {
        match self {
            Self::Sharp => (x - g).max(0.0) + (x + g).min(0.0),
            Self::Rounded { sharpness } => {
                let ramp = |over: f64| (over + over.hypot(g / sharpness)) / 2.0;
                ramp(x - g) - ramp(-x - g)
            }
            Self::Asymmetric { lower } => (x - g).max(0.0) + (x + g * lower).min(0.0),
        }
    }

    pub(crate) fn check(self) -> Result<(), TestbedError> {
        match self {
            Self::Sharp => Ok(()),
            Self::Rounded { sharpness } => positive("law.sharpness", sharpness),
            Self::Asymmetric { lower } => not_negative("law.lower", lower),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_end_at_the_sharp_and_symmetric_one() {
        for x in [-3.0, -1.2, -0.4, 0.0, 0.7, 1.0, 2.5] {
            let sharp = Gap::Sharp.beyond(x, 1.1);
            assert!((Gap::Rounded { sharpness: 1e6 }.beyond(x, 1.1) - sharp).abs() < 1e-6, "{x}");
            assert!((Gap::Asymmetric { lower: 1.0 }.beyond(x, 1.1) - sharp).abs() < 1e-15, "{x}");
            // The hyperbola is farthest from the sharp curve at a corner.
            assert!((Gap::Rounded { sharpness: 2.0 }.beyond(x, 1.1) - sharp).abs() <= 1.1 / 4.0, "{x}");
        }
        assert!((Gap::Rounded { sharpness: 9.0 }.beyond(1.1, 1.1) / (1.1 / 18.0) - 1.0).abs() < 0.03);
    }
}
