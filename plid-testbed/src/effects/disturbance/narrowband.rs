//! A machine that runs nearby. It causes the force a sin(2 pi f t + phi), held over a sample.

use std::f64::consts::{PI, TAU};

use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, not_negative, positive};
use crate::effects::chain::{Chain, Disturbance, Site};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;

/// Force a sin(2 pi f t + phi) along a strut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NarrowbandDisturbance {
    /// The input along whose strut it acts.
    pub at: Input,
    /// a, V; positive.
    pub amplitude_v: f64,
    /// f, Hz; positive.
    pub frequency_hz: f64,
    /// phi, rad.
    #[serde(default)]
    pub phase_rad: f64,
    /// The steadiness of the machine.
    #[serde(default, with = "written")]
    pub law: NarrowbandLaw,
}

/// The steadiness of a machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum NarrowbandLaw {
    /// A sine.
    #[default]
    Steady,
    /// A sine whose phase is a random walk.
    Wandering {
        /// Standard deviation of the phase after a second, rad; zero or more. It grows with the square root of time.
        rad_per_root_s: f64,
    },
}

impl Laws for NarrowbandLaw {
    /// The line of such a machine is r^2 / (2 pi) Hz wide at half its power. The width ranges from a hundredth of a
    /// hertz, for a motor with controlled speed, to several hertz for a free one. Records of a structure last 2 to 8
    /// s, so the narrowest lines are hardly wider than a steady one. Without the random walk, the line is steady.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "wandering",
        number: "rad_per_root_s",
        fixed: 1.0,
        ranges: Halves { development: &[[0.7, 1.5]], reported: &[[0.25, 0.5], [2.5, 5.0]] },
    }];
}

struct Machine {
    config: NarrowbandDisturbance,
    sample_rate_hz: f64,
    walked: f64,
    rng: ChaCha12Rng,
}

impl Disturbance for Machine {
    fn force(&mut self, t_s: f64) -> f64 {
        let c = &self.config;
        if let NarrowbandLaw::Wandering { rad_per_root_s } = c.law {
            let draw: f64 = StandardNormal.sample(&mut self.rng);
            self.walked += rad_per_root_s * draw / self.sample_rate_hz.sqrt();
        }
        c.amplitude_v * (2.0 * PI * c.frequency_hz * t_s + c.phase_rad + self.walked).sin()
    }
}

impl Law for NarrowbandDisturbance {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("amplitude_v", self.amplitude_v)?;
        positive("frequency_hz", self.frequency_hz)?;
        finite("phase_rad", self.phase_rad)?;
        match self.law {
            NarrowbandLaw::Steady => Ok(()),
            NarrowbandLaw::Wandering { rad_per_root_s } => not_negative("law.rad_per_root_s", rad_per_root_s),
        }
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let sample_rate_hz = site.clock.sample_rate_hz;
        let machine = Machine { config: self.clone(), sample_rate_hz, walked: 0.0, rng: site.rng };
        chain.forces.push((self.at.0, Box::new(machine)));
    }

    fn strengthen(&mut self, factor: f64) {
        self.amplitude_v *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        vec![self.amplitude_v, self.frequency_hz, self.phase_rad]
    }

    fn own_equation(&self) -> bool {
        self.law == NarrowbandLaw::Steady
    }

    fn foretold(&self) -> bool {
        self.law == NarrowbandLaw::Steady
    }
}

impl Described for NarrowbandDisturbance {
    const FAMILY: Family = Family::Disturbance;
    const AT: At = At::Disturbance;
    const ON: &'static [On] = &[On::Structure];
    const PARAMETERS: &'static [&'static str] = &["a", "f", "phi"];
    const NEAR_MISSES: &'static [&'static str] = &["wandering"];
    const SHAPES: &'static [Shape] = NarrowbandLaw::SHAPES;
    const IMPERFECTION: bool = true;

    fn start(draw: &mut Draw<'_>) -> Value {
        let frequency_hz = draw.within(80.0..240.0);
        json!({ "amplitude_v": 0.1, "frequency_hz": frequency_hz, "phase_rad": draw.within(0.0..TAU) })
    }
}
