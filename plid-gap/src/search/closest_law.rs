//! The law of a free shape. A force whose shape was fitted freely is named by the law of the vocabulary that is nearest
//! to the fitted curve. Likelihoods rank laws by the residual of a refit, and a law with one more parameter may come
//! first with a curve that is quite unlike the fitted one.

use nalgebra::{DMatrix, DVector};

use crate::effects::{Action, Effect, Flexible, Library, Range};
use crate::fit::problem::{Placed, Problem};

/// Number of points of a curve.
const POINTS: usize = 121;

/// Returns the law that is nearest to the curve of these effects at the location of `present`, with the size that
/// fits best; `None` if this law is not clearly nearer than that of `present`.
pub fn closest_law<'a>(
    problem: &Problem,
    effects: &[Placed<'a>],
    present: &Placed<'a>,
    library: &'a Library,
    allowed: &dyn Fn(&Placed) -> bool,
) -> Option<Placed<'a>> {
    let (setting, search) = (&problem.setting, &problem.settings.search);
    let range = search.curve_range;
    let sibling = present.effect.free_shape()?;
    let port = || setting.port(&present.place);
    let rms = match sibling {
        Flexible::Stiffness => setting.d_rms[port()],
        Flexible::Damping => setting.v_rms[port()],
        _ => return None,
    };
    let at = |x: f64| if *sibling == Flexible::Stiffness { (x * rms, 0.0) } else { (0.0, x * rms) };
    let force = |actions: &[Action], x: f64| {
        let (d, v) = at(x);
        let of = |action: &Action| {
            if let Action::Force(_, force) = action { force.force(d, v, &vec![0.0; force.states()]) } else { 0.0 }
        };
        actions.iter().map(of).sum::<f64>()
    };
    let curve = |effects: &[Placed]| {
        let actions = problem.actions(effects);
        DVector::from_fn(POINTS, |k, _| force(&actions, grid(range, k)))
    };
    let alike = |placed: &&Placed| {
        placed.place == present.place
            && (placed.effect.name() == sibling.name() || placed.effect.free_shape() == Some(sibling))
    };
    let found = curve(&effects.iter().filter(alike).cloned().collect::<Vec<_>>());
    let mut laws: Vec<(f64, Placed)> = Vec::new();
    let acts =
        |effect: &&dyn Effect| effect.free_shape() == Some(sibling) && effect.places(setting).contains(&present.place);
    for effect in library.effects().filter(acts) {
        for start in effect.starts(setting, &present.place) {
            let mut placed = Placed { effect, place: present.place.clone(), parameters: start };
            let Some((index, neutral)) = effect.amplitude().filter(|_| allowed(&placed)) else { continue };
            let (left, size) = unlike(range, &found, &curve(std::slice::from_ref(&placed)));
            placed.parameters[index] = neutral + size * (placed.parameters[index] - neutral);
            if effect.sound(setting, &placed.place, &placed.parameters) && in_range(problem, &placed, index) {
                laws.push((left, placed));
            }
        }
    }
    laws.sort_by(|a, b| a.0.total_cmp(&b.0));
    let own = laws.iter().find(|(_, placed)| placed.effect.name() == present.effect.name()).map_or(1.0, |own| own.0);
    let (left, nearest) = laws.into_iter().next()?;
    (nearest.effect.name() != present.effect.name() && left < search.nearer_law * own).then_some(nearest)
}

fn in_range(problem: &Problem, placed: &Placed, index: usize) -> bool {
    let positive = placed.effect.parameters(&problem.setting)[index].range == Range::Positive;
    !positive || placed.parameters[index] > 0.0
}

fn grid(range: f64, k: usize) -> f64 {
    range * (2.0 * k as f64 / (POINTS - 1) as f64 - 1.0)
}

/// Returns the share of a curve's energy that the best multiple of a law does not reproduce, and this multiple. A
/// constant and a straight line are removed first: no acceleration shows a static force, and a refit absorbs the
/// linear part. Points are weighted by the probability density of a Gaussian motion.
fn unlike(range: f64, curve: &DVector<f64>, law: &DVector<f64>) -> (f64, f64) {
    let weight = |k: usize| (-0.25 * grid(range, k).powi(2)).exp();
    let weighted = |f: &dyn Fn(usize) -> f64| DVector::from_fn(POINTS, |k, _| weight(k) * f(k));
    let basis = DMatrix::from_columns(&[weighted(&|_| 1.0), weighted(&|k| grid(range, k))]);
    let q = basis.qr().q();
    let nonlinear = |x: &DVector<f64>| {
        let x = weighted(&|k| x[k]);
        &x - &q * q.tr_mul(&x)
    };
    let (curve, law) = (nonlinear(curve), nonlinear(law));
    let (whole, size) = (curve.norm_squared(), curve.dot(&law) / law.norm_squared().max(f64::MIN_POSITIVE));
    if whole > 0.0 { ((curve - law * size).norm_squared() / whole, size) } else { (0.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Place;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// Half a parabola, on one side only, is a quadratic spring and not a clearance; a cubic is a cubic, whatever it
    /// was called; a clearance stays a clearance.
    #[test]
    fn a_curve_is_named_by_the_law_that_it_is_like() {
        let sim = testing::truss(1);
        let case = testing::case(&sim, &sim);
        let ready = prepare(case.model.as_ref().unwrap(), &case.records, &Known::default()).unwrap();
        let (problem, library) = (&ready.problem, Library::standard());
        let rms = problem.setting.d_rms[0];
        let at = |effect, parameters| Placed { effect, place: Place::Input(0), parameters };
        let law = |name: &str, parameters: Vec<f64>| at(library.get(name).unwrap(), parameters);
        let gap = law("clearance", vec![1.0, rms]);
        // From one knot to the next, the slope of a parabola rises by twice their distance.
        let half = [0.0, 0.1, 0.2, 0.5, 0.6, 0.6, 0.8, 1.0].map(|x| 2.0 * x);
        let half = at(&Flexible::Stiffness, [half, [0.0; 8]].concat());
        let named = |effects: &[Placed], allowed: &dyn Fn(&Placed) -> bool| {
            closest_law(problem, effects, &gap, &library, allowed).map(|law| (law.effect.name(), law.parameters[0]))
        };
        let (name, k) = named(std::slice::from_ref(&half), &|_| true).unwrap();
        assert_eq!(name, "quadratic-stiffness");
        // The size is half that of the whole parabola.
        let size = problem.setting.force[0] / rms.powi(2);
        assert!((k / (0.5 * size) - 1.0).abs() < 1e-6, "{k} {size}");
        let cube = law("cubic-stiffness", vec![3.0 * size / rms]);
        let (name, k) = named(std::slice::from_ref(&cube), &|_| true).unwrap();
        assert_eq!(name, "cubic-stiffness");
        assert!((k / cube.parameters[0] - 1.0).abs() < 1e-9);
        assert_eq!(named(std::slice::from_ref(&gap), &|_| true), None);
        let not = |effect: &'static str| move |placed: &Placed| placed.effect.name() != effect;
        assert_ne!(named(&[half], &not("quadratic-stiffness")).map(|law| law.0), Some("quadratic-stiffness"));
    }
}
