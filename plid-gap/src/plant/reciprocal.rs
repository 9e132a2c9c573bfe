use nalgebra::{DMatrix, DVector};

use super::motion::{Motion, ROUNDING, Row};
use super::{CasePort, Mode, Plant, Port, PortScale, lowest};
use plid_fourier::C;

/// Infers the axis of each input, and the motion that each further output measures, as ports of a structure whose
/// outputs are positions and velocities; `None` if an input has no collocated output, or if its force does more than
/// accelerate the axis.
///
/// A sensor is collocated with an actuator if all modes respond in phase there: the residue of each mode is then the
/// square of a single shape. A force at another output follows from reciprocity (Maxwell, Betti): it moves the
/// collocated sensor as the input moves the other output.
pub(super) fn infer(plant: &Plant, inputs: &[String], outputs: &[String]) -> Option<Vec<Port>> {
    if plant.rest.continuous.is_none() || plant.sensed.iter().any(|sensed| sensed.order() > Some(1)) {
        return None;
    }
    let at = collocated_outputs(plant, &EXACT)?;
    let mut axes = Vec::new();
    for (input, (name, &output)) in inputs.iter().zip(&at).enumerate() {
        let port = plant.between(&CasePort { name: name.clone(), input, output }).ok()?;
        if !only_accelerates(plant, &port, output, input) {
            return None;
        }
        axes.push(Port { input: Some(input), ..port });
    }
    let axis = axes.first()?;
    let further = (0..plant.p).filter(|output| !at.contains(output));
    let further: Vec<Port> = further.filter_map(|to| beside(plant, axis, to, &outputs[to])).collect();
    Some(axes.into_iter().chain(further).collect())
}

/// The tolerances within which the modes are those of a collocated sensor.
pub(super) struct Tolerance {
    /// Largest apparent advance or delay of the inputs, in samples.
    shift: f64,
    /// Share of the largest residue below which the residue of a mode is ignored.
    negligible: f64,
}

/// Tolerances for a simulation that was built from equations, not identified from records.
const EXACT: Tolerance = Tolerance { shift: 0.0, negligible: 0.0 };

/// Tolerances for a simulation that may have been identified from records, as if inputs were held over each sample.
/// Inputs that change within a sample then seem to act half a sample early.
pub(super) const IDENTIFIED: Tolerance = Tolerance { shift: 0.75, negligible: 0.02 };

/// Returns the collocated output of each input; `None` if an input has none.
pub(super) fn collocated_outputs(plant: &Plant, tolerance: &Tolerance) -> Option<Vec<usize>> {
    let mut at: Vec<usize> = Vec::new();
    for input in 0..plant.m {
        let size = |output: &usize| plant.modes.iter().map(|mode| residue(plant, mode, *output, input).norm()).sum();
        let sizes = |a: &usize, b: &usize| f64::total_cmp(&size(a), &size(b));
        let is_motion = |output: usize| plant.sensed[output].is_motion();
        let may_be =
            |output: &usize| is_motion(*output) && !at.contains(output) && collocated(plant, *output, input, tolerance);
        let output = (0..plant.p).filter(may_be).max_by(sizes)?;
        at.push(output);
    }
    Some(at)
}

/// Returns the residue of a mode in the response of a displacement to a force, times 2 j times its damped frequency:
/// a positive number for a collocated sensor.
fn residue(plant: &Plant, mode: &Mode, output: usize, input: usize) -> C {
    let Some(order) = plant.sensed.get(output).and_then(|sensed| sensed.order()) else { return C::ZERO };
    let passed = plant.chain.before(input, mode.pole) * plant.chain.behind(output, mode.pole);
    mode.c[output] * mode.b[input] * C::new(0.0, 2.0 * mode.pole.im) / (passed * mode.pole.powi(order))
}

fn collocated(plant: &Plant, output: usize, input: usize, tolerance: &Tolerance) -> bool {
    let of = |mode: &Mode| (mode.pole.im, residue(plant, mode, output, input));
    let residues: Vec<(f64, C)> = plant.modes.iter().map(of).collect();
    let least = tolerance.negligible * residues.iter().map(|(_, residue)| residue.norm()).fold(0.0, f64::max);
    let residues = || residues.iter().filter(|(_, residue)| residue.norm() >= least);
    // The common shift in time, by least squares over the phases, with the residues as weights.
    let product = |by: fn(f64, f64) -> f64| residues().map(|(w, x)| x.norm() * w * by(*w, x.arg())).sum::<f64>();
    let most = tolerance.shift / plant.rate;
    let shift = (product(|_, phase| phase) / product(|w, _| w).max(f64::MIN_POSITIVE)).clamp(-most, most);
    residues().all(|(w, x)| (x * C::cis(-w * shift)).arg().abs() < plant.settings.collocated_phase)
}

/// Returns whether a force at a port immediately changes its velocity, and not its displacement, as in any mechanical
/// simulation. In a model that was identified from records, the force changes both to some degree.
fn only_accelerates(plant: &Plant, port: &Port, output: usize, input: usize) -> bool {
    let acceleration = port.at_once(&port.velocity, &port.velocity_rest);
    let other = match plant.sensed[output].order() {
        Some(0) => port.at_once(&port.displacement, &port.displacement_rest),
        _ => plant.d[(output, input)],
    };
    acceleration > 0.0 && lowest(&plant.modes) * other.abs() < plant.settings.at_once * acceleration
}

/// Returns the port at the motion that an output measures, by reciprocity with the axis of an input; `None` if the
/// motion of the axis does not contain all that the output observes.
fn beside(plant: &Plant, axis: &Port, to: usize, name: &str) -> Option<Port> {
    let (a, _) = plant.rest.continuous.as_ref()?;
    let Motion { displacement, velocity } = plant.motion(to)?;
    let (modes, rest, shown) = match &displacement {
        Some(displacement) if axis.sees_displacement() => (&axis.displacement, &axis.displacement_rest, displacement),
        _ => (&axis.velocity, &axis.velocity_rest, &velocity),
    };
    let force: Vec<C> = (0..plant.modes.len()).map(|k| shown.modes[k] * axis.force[k] / modes[k]).collect();
    let force_rest = exchanged(a, rest, &shown.rest, &axis.force_rest)?;
    let displacement = displacement.unwrap_or_else(|| Row::none(plant));
    Some(Port {
        name: name.into(),
        input: None,
        scale: match axis.scale {
            PortScale::Shown { input, output } => PortScale::Reciprocal { input, axis: output, output: to },
            _ => PortScale::Inferred(None),
        },
        force: force.iter().all(|x| x.is_finite()).then_some(force)?,
        force_rest,
        displacement: displacement.modes,
        velocity: velocity.modes,
        displacement_rest: displacement.rest,
        velocity_rest: velocity.rest,
        output: Vec::new(),
    })
}

/// Returns g with c1 A^k g = c2 A^k b for all k, so that g moves c1 as b moves c2; `None` if there is no such g.
fn exchanged(a: &DMatrix<f64>, c1: &DVector<f64>, c2: &DVector<f64>, b: &DVector<f64>) -> Option<DVector<f64>> {
    let r = a.nrows();
    if r == 0 {
        return Some(DVector::zeros(0));
    }
    // The unit of time is chosen so that the powers of A have similar sizes.
    let scaled = a / a.norm().max(f64::MIN_POSITIVE);
    let (mut rows, mut wanted) = (DMatrix::zeros(r, r), DVector::zeros(r));
    let mut column = b.clone();
    let mut row = c1.clone();
    for k in 0..r {
        rows.row_mut(k).copy_from(&row.transpose());
        wanted[k] = c2.dot(&column);
        row = scaled.tr_mul(&row);
        column = &scaled * column;
    }
    let svd = rows.clone().svd(true, true);
    let found = svd.solve(&wanted, ROUNDING * svd.singular_values.max()).ok()?;
    let left = (&rows * &found - &wanted).norm();
    (left <= 1e-6 * wanted.norm()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::PortSource;
    use nalgebra::dmatrix;
    use plid_model::{Model, OutputKind};

    /// Returns the state matrix of a motor of inertia 0.02 with a bearing, an elastic joint and a link, and the input
    /// columns of the motor and of the joint. The coordinates are the angle of the motor and the twist of the joint.
    fn arm() -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        // T = j1 q1'^2 / 2 + j2 (q1' + q2')^2 / 2.
        let (j1, j2, k, c1, c2) = (0.02, 0.05, 30.0, 0.3, 0.04);
        let inverse = dmatrix![j1 + j2, j2; j2, j2].try_inverse().unwrap();
        let mut a = DMatrix::zeros(4, 4);
        a.view_mut((0, 2), (2, 2)).copy_from(&DMatrix::identity(2, 2));
        a.view_mut((2, 0), (2, 2)).copy_from(&(-&inverse * dmatrix![0.0, 0.0; 0.0, k]));
        a.view_mut((2, 2), (2, 2)).copy_from(&(-&inverse * dmatrix![c1, 0.0; 0.0, c2]));
        let mut pushes = DMatrix::zeros(4, 2);
        pushes.view_mut((2, 0), (2, 2)).copy_from(&inverse);
        (a, pushes.columns(0, 1).into_owned(), pushes.columns(1, 1).into_owned())
    }

    /// The port of the elastic joint, which no input drives, agrees with the matrices: a spring there changes the
    /// poles as a stiffer joint does.
    #[test]
    fn a_force_at_a_joint_follows_from_reciprocity() {
        let (a, b, _) = arm();
        let (held_a, held_b) = crate::testing::held(&a, &b, 2e-3);
        let c = dmatrix![1.0, 0.0, 0.0, 0.0; 0.0, 1.0, 0.0, 0.0];
        let mut model = Model::new(500.0, held_a, held_b, c, DMatrix::zeros(2, 1)).unwrap();
        model.output_kinds = vec![Some(OutputKind::Position); model.p()];
        let mut plant = Plant::new(&model).unwrap();
        assert_eq!((plant.modes.len(), plant.port_source), (1, PortSource::Axis));
        let names: Vec<(&str, Option<usize>)> =
            plant.ports.iter().map(|port| (port.name.as_str(), port.input)).collect();
        assert_eq!(names, [("u1", Some(0)), ("y2", None)]);
        let stiffness = plant.stiffness(&plant.ports[1]);
        // This is the stiffness of the mode alone. The bearing couples the mode slightly with the rigid-body motion.
        assert!((stiffness / 30.0 - 1.0).abs() < 0.03, "{stiffness}");
        plant.load(1, &crate::plant::Load { stiffness: 6.0, ..Default::default() });
        let (mut stiffer, _, push) = arm();
        stiffer.set_column(1, &(stiffer.column(1) - push.column(0) * 6.0));
        let (expected, _) = crate::testing::held(&stiffer, &b, 2e-3);
        let sorted = |matrix: &DMatrix<f64>| {
            let mut all: Vec<C> = matrix.complex_eigenvalues().iter().copied().collect();
            all.sort_by(|x, y| x.re.total_cmp(&y.re).then(x.im.total_cmp(&y.im)));
            all
        };
        for (found, right) in sorted(&plant.rest.a).iter().zip(sorted(&expected)) {
            assert!((found - right).norm() < 1e-6, "{found} {right}");
        }
    }

    /// An identified model whose position responds to a force at once keeps the ports that are inferred from its
    /// modes.
    #[test]
    fn a_position_that_jumps_is_no_axis() {
        let a = dmatrix![0.0, 1.0; -2.0e5, -45.0];
        for (jump, source) in [(0.0, PortSource::Axis), (5e-4, PortSource::Inferred)] {
            let (held_a, held_b) = crate::testing::held(&a, &dmatrix![jump; 1.0], 1e-3);
            let mut model = Model::new(1000.0, held_a, held_b, dmatrix![1.0, 0.0], DMatrix::zeros(1, 1)).unwrap();
            model.output_kinds = vec![Some(OutputKind::Position)];
            assert_eq!(Plant::new(&model).unwrap().port_source, source, "{jump}");
        }
    }

    /// A sensor at the far end moves in antiphase with the motor in the elastic mode, so it is not collocated.
    #[test]
    fn without_a_collocated_sensor_there_is_no_axis() {
        let (a, b, _) = arm();
        let (held_a, held_b) = crate::testing::held(&a, &b, 2e-3);
        let c = dmatrix![1.0, 1.0, 0.0, 0.0];
        let mut model = Model::new(500.0, held_a, held_b, c, DMatrix::zeros(1, 1)).unwrap();
        model.output_kinds = vec![Some(OutputKind::Position); model.p()];
        assert_eq!(Plant::new(&model).unwrap().port_source, PortSource::Inferred);
    }
}
