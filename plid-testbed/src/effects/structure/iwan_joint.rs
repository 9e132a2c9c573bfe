//! A joint that slips little by little: Iwan's model, by its closed form and the turning points that it remembers.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::config::{finite, not_negative, positive};
use crate::effects::chain::{Chain, Site, StructureEffect, add_scaled, dot};
use crate::effects::family::{Halves, Shape};
use crate::effects::law::{Law, Limits};
use crate::effects::place::Input;
use crate::effects::written::{self, Laws};
use crate::effects::{At, Described, Draw, Family, On};
use crate::error::TestbedError;
use crate::plant::StrutPort;

/// f = k s d - F, where F is the force of sliders in parallel, each in series with a spring. The density of their
/// stiffness over the displacements x at which they yield is R x^chi, up to `slip_v` (D. J. Segalman, J. Appl. Mech.
/// 72, 2005, 752).
///
/// At its first loading, F is k d - R d^(2 + chi) / ((1 + chi) (2 + chi)). After every turn, it follows this curve at
/// twice its size until it reaches the previous turn. These are Masing's rules, which hold exactly for such sliders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IwanJoint {
    /// The input at whose strut it acts.
    pub at: Input,
    /// k, V/V; positive: the stiffness while it sticks.
    pub stiffness: f64,
    /// The displacement from rest at which all sliders slip, V; positive.
    pub slip_v: f64,
    /// chi, above -1.
    pub exponent: f64,
    /// s, the share of k that the plant contains without the effect; the effect removes it.
    #[serde(default)]
    pub held: f64,
    /// The density of the sliders.
    #[serde(default, with = "written")]
    pub law: SliderLaw,
}

/// The density of the sliders over the displacements at which they yield.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SliderLaw {
    /// A power up to the largest displacement.
    #[default]
    Power,
    /// A share of the stiffness yields at the largest displacement alone. For Segalman's beta, the share is
    /// beta / (1 + beta).
    Kink {
        /// The share, from zero to one.
        share: f64,
    },
}

impl Laws for SliderLaw {
    /// When the last part of a joint begins to slip, its stiffness falls suddenly: by little if the bolts press
    /// evenly, and by most of it if they press hard at one place. Without this share, the joint is the vocabulary's.
    const SHAPES: &'static [Shape] = &[Shape {
        law: "kink",
        number: "share",
        fixed: 1.0 / 3.0,
        ranges: Halves { development: &[[0.25, 0.42]], reported: &[[0.1, 0.18], [0.55, 0.8]] },
    }];
}

impl SliderLaw {
    /// Returns the share of the stiffness that yields at the largest displacement alone.
    fn together(self) -> f64 {
        match self {
            Self::Power => 0.0,
            Self::Kink { share } => share,
        }
    }
}

impl IwanJoint {
    /// Returns the force of the joint at its first loading, an odd function of the displacement.
    fn first_loading(&self, d: f64) -> f64 {
        let (chi, most, together) = (self.exponent, self.slip_v, self.law.together());
        let x = (d.abs() / most).min(1.0);
        let spread = x - x.powf(2.0 + chi) / (2.0 + chi);
        d.signum() * self.stiffness * most * ((1.0 - together) * spread + together * x)
    }
}

/// A turning point of the motion: the displacement, and the joint's force there.
#[derive(Clone, Copy)]
struct Turn {
    d: f64,
    force: f64,
}

/// The joint with the turns of its motion that it remembers, the outermost first. Their directions alternate.
struct Remembering {
    joint: IwanJoint,
    port: StrutPort,
    turns: Vec<Turn>,
    /// The displacement and the force at the end of the last step.
    now: Turn,
}

impl Remembering {
    /// Returns the present point as a turn, if a motion from here to `d` reverses the direction.
    fn turn(&self, d: f64) -> Option<Turn> {
        let from = self.turns.last().map_or(0.0, |turn| turn.d);
        ((self.now.d - from) * (d - self.now.d) < 0.0).then_some(self.now)
    }

    /// Returns the number of turns that remain at `d`, including `turn`. A motion that reaches the turn before the
    /// last one closes a loop. A motion that leaves all turns behind follows its first loading again.
    fn remaining(&self, d: f64, turn: Option<Turn>) -> usize {
        let mut left = self.turns.len() + usize::from(turn.is_some());
        let at = |j: usize| self.turns.get(j).copied().or(turn).map_or(0.0, |turn| turn.d);
        while left >= 2 && (d - at(left - 2)) * (at(left - 2) - at(left - 1)) >= 0.0 {
            left -= 2;
        }
        if left == 1 && d.abs() >= at(0).abs() { 0 } else { left }
    }

    fn force(&self, d: f64) -> f64 {
        let turn = self.turn(d);
        let left = self.remaining(d, turn);
        let last = left.checked_sub(1).and_then(|j| self.turns.get(j).copied().or(turn));
        match last {
            Some(turn) => turn.force + 2.0 * self.joint.first_loading((d - turn.d) / 2.0),
            None => self.joint.first_loading(d),
        }
    }

    fn move_to(&mut self, d: f64) {
        let (force, turn) = (self.force(d), self.turn(d));
        let left = self.remaining(d, turn);
        self.turns.extend(turn);
        self.turns.truncate(left);
        self.now = Turn { d, force };
    }
}

impl StructureEffect for Remembering {
    fn add_rate(&self, _t_s: f64, x: &[f64], rate: &mut [f64]) {
        let d = dot(&self.port.displacement, x);
        add_scaled(rate, &self.port.force, self.joint.stiffness * self.joint.held * d - self.force(d));
    }

    fn end_step(&mut self, _h_s: f64, x: &[f64]) {
        self.move_to(dot(&self.port.displacement, x));
    }
}

impl Law for IwanJoint {
    fn check(&self, _limits: &Limits) -> Result<(), TestbedError> {
        positive("stiffness", self.stiffness)?;
        positive("slip_v", self.slip_v)?;
        finite("held", self.held)?;
        positive("exponent + 1", self.exponent + 1.0)?;
        not_negative("law.share", self.law.together())?;
        not_negative("1 - law.share", 1.0 - self.law.together())
    }

    fn install(&self, site: Site, chain: &mut Chain) {
        let port = site.truss.ports[self.at.0].clone();
        let now = Turn { d: 0.0, force: 0.0 };
        chain.structure.push(Box::new(Remembering { joint: self.clone(), port, turns: Vec::new(), now }));
    }

    fn strengthen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    fn place(&self) -> usize {
        self.at.0
    }

    fn parameters(&self) -> Vec<f64> {
        let held = (self.held != 0.0).then_some(self.held);
        [self.stiffness, self.slip_v, self.exponent].into_iter().chain(held).collect()
    }

    fn own_equation(&self) -> bool {
        self.law == SliderLaw::Power
    }
}

impl Described for IwanJoint {
    const FAMILY: Family = Family::NonlinearStructure;
    const AT: At = At::Port;
    const ON: &'static [On] = &[On::Structure];
    /// The last parameter is present only if it is not zero.
    const PARAMETERS: &'static [&'static str] = &["k", "dm", "chi", "s"];
    const NEAR_MISSES: &'static [&'static str] = &["kink"];
    const SHAPES: &'static [Shape] = SliderLaw::SHAPES;

    fn start(draw: &mut Draw<'_>) -> Value {
        let slip_v = draw.within(1.5..4.0) * draw.level.displacement;
        // The simulation lacks the joint, or contains it as a spring.
        let held = draw.sign.max(0.0);
        json!({ "stiffness": 0.01, "slip_v": slip_v, "exponent": draw.within(-0.8..-0.2), "held": held })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the force with the sum of twenty thousand sliders.
    #[test]
    fn masing_s_rules_are_the_sliders_sum() {
        const SLIDERS: usize = 20_000;
        let kinks = [0.0, 0.1, 1.0 / 3.0, 0.8].map(|share| (-0.3, SliderLaw::Kink { share }));
        for (exponent, law) in [(-0.6, SliderLaw::Power), (0.0, SliderLaw::Power)].into_iter().chain(kinks) {
            let joint = IwanJoint { at: Input(0), stiffness: 1.7, slip_v: 0.9, exponent, held: 0.0, law };
            let port = StrutPort { input: 0, force: Vec::new(), displacement: Vec::new(), velocity: Vec::new() };
            let now = Turn { d: 0.0, force: 0.0 };
            let mut remembering = Remembering { joint, port, turns: Vec::new(), now };
            let together = law.together();
            let edge = |j: usize| (j as f64 / SLIDERS as f64).powf(3.0);
            let share = |j: usize| edge(j + 1).powf(1.0 + exponent) - edge(j).powf(1.0 + exponent);
            let mut sliders: Vec<(f64, f64, f64)> = (0..SLIDERS)
                .map(|j| (0.0, 0.45 * (edge(j) + edge(j + 1)), 1.7 * (1.0 - together) * share(j)))
                .chain([(0.0, 0.9, 1.7 * together)])
                .collect();
            let mut before = 0.0;
            let turns = [0.3, -0.2, 0.1, 0.05, 0.08, -0.4, 0.5, 0.45, 0.47, 0.2, 1.4, 1.2, 1.3, -0.6, 0.0, -1.9, 0.7];
            for to in turns {
                let from = before;
                for part in 1..=7 {
                    let d = from + (to - from) * f64::from(part) / 7.0;
                    for (z, most, _) in &mut sliders {
                        *z = (*z + d - before).clamp(-*most, *most);
                    }
                    before = d;
                    let sum: f64 = sliders.iter().map(|(z, _, k)| k * z).sum();
                    let force = remembering.force(d);
                    assert!((force - sum).abs() < 1e-6, "{exponent} at {d}: {force} and {sum}");
                    remembering.move_to(d);
                }
            }
        }
    }
}
