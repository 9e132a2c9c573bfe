//! The scales of the modes at inferred ports. They follow from reciprocity until the response of an effect at a port
//! determines them.

use crate::effects::{Action, Effect, Parameter, Place, Range, Setting, Side};
use crate::fit::problem::{Effort, Fit, Placed, Problem};
use crate::plant::{Plant, PortSource};
use crate::simulate::Fineness;

/// Scales of the modes' displacements at all ports: an effect that is fitted once and never named.
struct ModeScales;

static SCALES: ModeScales = ModeScales;

impl Effect for ModeScales {
    fn name(&self) -> &'static str {
        "mode-scales"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn equation(&self) -> &'static str {
        "displacements of each mode at the ports times e^s"
    }

    fn parameters(&self, setting: &Setting) -> Vec<Parameter> {
        (1..=setting.plant.modes.len()).map(|k| Parameter::new(format!("s{k}"), "1", Range::Signed)).collect()
    }

    fn places(&self, _setting: &Setting) -> Vec<Place> {
        Vec::new()
    }

    fn starts(&self, setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
        vec![vec![0.0; setting.plant.modes.len()]]
    }

    fn act(&self, _setting: &Setting, _place: &Place, scales: &[f64]) -> Vec<Action> {
        let scales = scales.to_vec();
        vec![Action::Plant(Box::new(move |plant| scale(plant, &scales)))]
    }
}

fn scale(plant: &mut Plant, scales: &[f64]) {
    for port in &mut plant.ports {
        for (k, s) in scales.iter().enumerate() {
            // A mode that hardly moves the port does not determine its scale.
            let factor = s.clamp(-2.0, 2.0).exp();
            port.displacement[k] *= factor;
            port.velocity[k] *= factor;
        }
    }
}

const QUICK: Effort = Effort { steps: 8, gain: 1.0, fineness: Fineness::COARSE };
const WHOLE: Effort = Effort { steps: 6, gain: 0.1, fineness: Fineness::FINE };

/// Fits the scales together with the effects, and keeps them in both problems if they gain more than their price.
pub fn fit_ports<'a>(problem: &mut Problem, quick: &mut Problem, best: Fit<'a>) -> Fit<'a> {
    let at_port = |placed: &Placed| {
        let acts = placed.effect.act(&problem.setting, &placed.place, &placed.parameters);
        acts.iter().any(|action| matches!(action, Action::Force(..)))
    };
    if problem.plant.port_source != PortSource::Inferred || !best.effects.iter().any(at_port) {
        return best;
    }
    let start = SCALES.starts(&problem.setting, &Place::Structure).remove(0);
    let count = start.len();
    let mut effects = best.effects.clone();
    effects.push(Placed { effect: &SCALES, place: Place::Structure, parameters: start });
    let jacobian = quick.jacobian(&quick.nuisance.apply(&quick.plant, &best.eta));
    let scaled = quick.fit(&jacobian, &best.eta, &effects, QUICK);
    let scales = scaled.effects.last().expect("just put there").parameters.clone();
    let (old, old_quick, old_setting) = (problem.plant.clone(), quick.plant.clone(), problem.setting.plant.clone());
    for plant in [&mut problem.plant, &mut quick.plant, &mut problem.setting.plant, &mut quick.setting.plant] {
        scale(plant, &scales);
    }
    let jacobian = problem.jacobian(&problem.nuisance.apply(&problem.plant, &scaled.eta));
    let effects = &scaled.effects[..best.effects.len()];
    let whole = problem.fit(&jacobian, &scaled.eta, effects, WHOLE);
    let price = count as f64 * (problem.rows() as f64).ln();
    if whole.cost.is_finite() && whole.cost + price < best.cost {
        return whole;
    }
    (problem.plant, quick.plant) = (old, old_quick);
    problem.setting.plant = old_setting.clone();
    quick.setting.plant = old_setting;
    best
}
