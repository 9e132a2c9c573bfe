//! Forces between the steps of an external simulator.
//!
//! A law gives the force at a port from its motion, but a simulator accepts a force only before a step and returns
//! the motion only after it. A stiff law (dry friction, a stop, an added mass) would be unstable if it used the
//! motion before the step. The velocity after the step is therefore predicted: the acceleration without the port's
//! force is assumed to be that of the last step, and a unit of force adds the port's measured mobility. The law is
//! solved for the force that agrees with the velocity in the middle of the step, or at its end where the law is steep
//! (a linearly implicit step; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996, IV.7).

use plid_simulator::Motion;

use crate::effects::Force;
use crate::plant::Load;

/// The response of a port's velocity to a force, and the relation between its displacement and its velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Response {
    /// Change of the velocity over a step per unit of force.
    pub mobility: f64,
    /// Weight of the velocity after a step in the change of the displacement over that step: one half for an exact
    /// integration, one for a symplectic one.
    pub weight: f64,
    /// Length of a step in s.
    pub step: f64,
}

/// The laws at one port over a run.
pub(super) struct Coupling<'a> {
    response: Response,
    laws: Vec<(&'a dyn Force, Vec<f64>)>,
    load: Load,
    /// The displacement to which the states of the laws belong, and the velocity and the force of the last step.
    before: Option<(f64, f64, f64)>,
}

/// Slope of a law times the mobility, above which the law is solved at the end of a step.
const STEEP: f64 = 0.5;

/// Largest number of halvings of the interval in which the force lies.
const HALVINGS: usize = 40;

/// Relative accuracy of the force.
const ACCURACY: f64 = 1e-9;

impl<'a> Coupling<'a> {
    /// Creates the laws at a port, at rest.
    pub fn new(response: Response, laws: Vec<&'a dyn Force>, loads: &[Load]) -> Self {
        let sum = |of: fn(&Load) -> f64| loads.iter().map(of).sum();
        let load =
            Load { stiffness: sum(|load| load.stiffness), damping: sum(|load| load.damping), mass: sum(|l| l.mass) };
        Self {
            response,
            laws: laws.into_iter().map(|law| (law, vec![0.0; law.states()])).collect(),
            load,
            before: None,
        }
    }

    /// Returns the force over the next step from the motion before it. `pushed` is a force that acts in addition.
    pub fn force(&mut self, motion: Motion, pushed: f64) -> f64 {
        let Response { mobility, weight, step } = self.response;
        let Motion { displacement, velocity } = motion;
        let last = self.before.map_or(0.0, |(_, before, force)| velocity - before - mobility * force);
        let middle = displacement + (1.0 - weight) * step * velocity;
        let from = self.before.map_or(0.0, |(d, _, _)| d);
        for (law, state) in &mut self.laws {
            law.advance(from, middle, state);
        }
        let free = velocity + last + mobility * pushed;
        let mut force = self.moving(middle, velocity, free);
        for (law, state) in &self.laws {
            if let Some(most) = law.holds() {
                force += held(*law, state, most, middle, velocity, free + mobility * force, mobility);
            }
        }
        self.before = Some((middle, velocity, force + pushed));
        force + pushed
    }

    /// Returns the force of the laws that depend on the motion alone.
    fn moving(&self, d: f64, v: f64, free: f64) -> f64 {
        let Response { mobility, step, .. } = self.response;
        let Load { stiffness, damping, mass } = self.load;
        let laws = |v: f64| {
            let moving = self.laws.iter().filter(|(law, _)| law.holds().is_none());
            moving.map(|(law, state)| law.force(d, v, state)).sum::<f64>() - stiffness * d - damping * v
        };
        // The inertia of an added mass is solved for exactly.
        let inertia = (1.0 + mass * mobility / step).max(Load::LEAST_INERTIA);
        let pull = mass * (free - v) / step;
        let solved = |share: f64| {
            let at = |force: f64| (laws(v + share * (free + mobility * force - v)) - pull) / inertia;
            solve(at)
        };
        let ahead = free - v;
        let slope = if ahead == 0.0 { 0.0 } else { (laws(free) - laws(v)) / ahead };
        if slope.abs() * mobility > STEEP { solved(1.0) } else { solved(0.5) }
    }
}

/// Returns the solution of x = f(x) for a function f that does not increase.
fn solve(f: impl Fn(f64) -> f64) -> f64 {
    let first = f(0.0);
    let second = f(first);
    let scale = first.abs().max(second.abs());
    if (second - first).abs() <= ACCURACY * scale {
        return second;
    }
    // f(0) - 0 and f(first) - first have different signs, because f does not increase.
    let (mut low, mut high) = if first > 0.0 { (0.0, first) } else { (first, 0.0) };
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if f(middle) > middle {
            low = middle
        } else {
            high = middle
        }
        if high - low <= ACCURACY * scale {
            break;
        }
    }
    0.5 * (low + high)
}

/// Returns the force of dry friction. It is the sliding force, unless the port is at rest or this force would reverse
/// its motion. In that case, the force is the one that stops the port, limited to the friction force.
fn held(law: &dyn Force, state: &[f64], most: f64, d: f64, v: f64, free: f64, mobility: f64) -> f64 {
    let slides = law.force(d, v, state);
    if v != 0.0 && (free + mobility * slides) * v > 0.0 {
        return slides;
    }
    let stops = if mobility > 0.0 { -free / mobility } else { 0.0 };
    if stops.abs() <= most { stops } else { law.force(d, free, state) }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Law(fn(f64, f64) -> f64, Option<f64>);

    impl Force for Law {
        fn force(&self, d: f64, v: f64, _state: &[f64]) -> f64 {
            self.0(d, v)
        }

        fn holds(&self) -> Option<f64> {
            self.1
        }
    }

    /// Returns the motion after each step of a mass of 1 kg with a law at its port, which is pushed by `push` in N,
    /// at 1 kHz. The force is held over a step, and the motion is exact.
    fn pushed(law: &Law, loads: &[Load], push: f64, steps: usize) -> Vec<Motion> {
        let step = 1e-3;
        let laws = if law.0(1.0, 1.0) == 0.0 { Vec::new() } else { vec![law as &dyn Force] };
        let mut coupling = Coupling::new(Response { mobility: step, weight: 0.5, step }, laws, loads);
        let mut at = Motion::default();
        let mut motions = Vec::new();
        for _ in 0..steps {
            let force = coupling.force(at, 0.0) + push;
            at.displacement += step * at.velocity + 0.5 * step * step * force;
            at.velocity += step * force;
            motions.push(at);
        }
        motions
    }

    #[test]
    fn an_added_mass_halves_the_acceleration() {
        let load = Load { mass: 1.0, ..Load::default() };
        let motions = pushed(&Law(|_, _| 0.0, None), &[load], 1.0, 1000);
        assert!((motions[999].velocity - 0.5).abs() < 1e-3, "{:?}", motions[999]);
    }

    /// A damper a hundred times too stiff for the step holds the velocity at force / c.
    #[test]
    fn a_stiff_law_is_stable() {
        let motions = pushed(&Law(|_, v| -1e5 * v, None), &[], 1.0, 100);
        assert!((motions[99].velocity - 1e-5).abs() < 1e-7, "{:?}", motions[99]);
    }

    /// A spring neither gains nor loses energy to first order: the motion agrees with the exact one over six periods.
    #[test]
    fn a_spring_keeps_its_energy() {
        let omega = 40.0_f64;
        let load = Load { stiffness: omega * omega, ..Load::default() };
        let motions = pushed(&Law(|_, _| 0.0, None), &[load], 1.0, 1000);
        let exact = |k: usize| (1.0 - (omega * 1e-3 * (k as f64 + 1.0)).cos()) / (omega * omega);
        let largest = (0..1000).map(|k| (motions[k].displacement - exact(k)).abs()).fold(0.0, f64::max);
        assert!(largest < 0.02 / (omega * omega), "{largest}");
    }

    #[test]
    fn dry_friction_holds_up_to_its_limit() {
        let law = || Law(|_, v| -2.0 * v.signum(), Some(2.0));
        // The push is not known in the first step, and the velocity gained there takes twenty steps to vanish.
        let holds = pushed(&law(), &[], 1.9, 100);
        assert!(holds[30..].iter().all(|motion| motion.velocity.abs() < 1e-12), "{:?}", holds[99]);
        let slides = pushed(&law(), &[], 2.5, 1000)[999].velocity;
        assert!((slides - 0.5).abs() < 5e-3, "{slides}");
    }
}
