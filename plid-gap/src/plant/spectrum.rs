use nalgebra::{DMatrix, DVector};

use super::{KindSource, NonModal, Plant, eigenvectors, phi1};
use crate::case::limits::Limit;
use plid_fourier::C;

/// Largest relative error of the matrix that is reconstructed from its eigenvectors. The eigenvectors of nearly
/// coincident poles do not reconstruct it, and such poles cannot be moved one by one.
const RECONSTRUCTION_TOLERANCE: f64 = 1e-6;

/// A parameter of the rest that may have a relative error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RestNumber {
    /// A real pole in rad/s.
    Rate(usize),
    /// The magnitude of a pair in rad/s.
    Frequency(usize),
    /// The damping ratio of a pair.
    Damping(usize),
    /// The gain of an input.
    Input(usize),
    /// The gain of an output.
    Output(usize),
    /// Factor on the non-modal contribution to the outputs.
    Contribution,
}

impl RestNumber {
    /// Returns the limit that applies to it. That of damping ratios also applies to rates and to the contribution.
    pub(crate) fn limit(self) -> Limit {
        match self {
            Self::Frequency(_) => Limit::Frequency,
            Self::Rate(_) | Self::Damping(_) | Self::Contribution => Limit::Damping,
            Self::Input(_) | Self::Output(_) => Limit::Shape,
        }
    }
}

/// A real pole, or the upper one of a pair, with its eigenvectors (left . right = 1).
#[derive(Debug, Clone)]
struct Pole {
    /// Continuous pole in rad/s.
    pole: C,
    right: DVector<C>,
    left: DVector<C>,
}

/// The poles of the rest with their eigenvectors, for a plant without structural modes. Each pole can be moved by
/// itself. If there are modes and neither actuators nor filters, only the contribution of the rest as a whole may
/// have an error, because a model that was identified from records has poles that imitate an effect. States that no
/// output depends on keep their equations.
#[derive(Debug, Clone)]
pub struct Spectrum {
    poles: Vec<Pole>,
    /// For each output, its displacement as a combination of the states, if it is one.
    displacements: Vec<Option<DVector<f64>>>,
    /// The parameters in their order.
    pub numbers: Vec<RestNumber>,
}

impl Spectrum {
    /// Decomposes the rest of a plant. `None` if the plant has modes and also actuators or filters, if the rest has
    /// no continuous form, or if its poles cannot be computed or are too close to each other to be moved one by one.
    pub fn of(plant: &Plant) -> Option<Self> {
        let rest = plant.rest.leading();
        if rest.a.nrows() == 0 || rest.continuous.is_none() {
            return None;
        }
        if !plant.modes.is_empty() {
            let alone = !plant.chain.known();
            return alone.then(|| Self {
                poles: Vec::new(),
                displacements: Vec::new(),
                numbers: vec![RestNumber::Contribution],
            });
        }
        let upper = plid_model::eigenvalues(&rest.a).ok()?.into_iter().filter(|z| z.im >= 0.0);
        let poles = upper.map(|z| Pole::of(&rest.a, z, plant.rate)).collect::<Option<Vec<_>>>()?;
        let back = sum(&poles, |pole| (pole * (1.0 / plant.rate)).exp());
        if !((back - &rest.a).norm() < RECONSTRUCTION_TOLERANCE * rest.a.norm()) {
            return None;
        }
        let mut numbers = Vec::new();
        for (k, Pole { pole, .. }) in poles.iter().enumerate() {
            if pole.norm() < plant.settings.integrator * plant.rate {
                continue;
            }
            if pole.im == 0.0 {
                numbers.push(RestNumber::Rate(k));
            } else {
                numbers.extend([RestNumber::Frequency(k), RestNumber::Damping(k)]);
            }
        }
        numbers.extend((0..plant.m).map(RestNumber::Input));
        numbers.extend((0..plant.p).map(RestNumber::Output));
        let displacements = (0..plant.p).map(|o| displacement(plant, o)).collect();
        Some(Self { poles, displacements, numbers })
    }

    /// Multiplies each parameter of a plant's rest by e^eta; gains also act on D. The contribution as a whole is
    /// multiplied by 1 + eta.
    ///
    /// The acceleration that a force causes at once depends on the mass alone, not on what holds or brakes it. So a
    /// moved pole does not change this acceleration at any output or port whose displacement is known, just as the
    /// moved pole of a mode does not. The outputs there remain the derivatives of that displacement.
    pub fn change(&self, plant: &mut Plant, eta: &[f64]) {
        if let ([RestNumber::Contribution], [eta]) = (self.numbers.as_slice(), eta) {
            return contribute(plant, 1.0 + eta);
        }
        let mut poles = self.poles.clone();
        let (mut inputs, mut outputs) = (vec![1.0; plant.m], vec![1.0; plant.p]);
        for (number, eta) in self.numbers.iter().zip(eta) {
            // A diverging fit must not overflow.
            let factor = eta.clamp(-3.0, 3.0).exp();
            match *number {
                RestNumber::Rate(k) | RestNumber::Frequency(k) => poles[k].pole *= factor,
                RestNumber::Damping(k) => poles[k].pole = damped(poles[k].pole, factor),
                RestNumber::Input(i) => inputs[i] = factor,
                RestNumber::Output(o) => outputs[o] = factor,
                RestNumber::Contribution => {}
            }
        }
        let step = 1.0 / plant.rate;
        let Some((given, b)) = &plant.rest.continuous else { return };
        let with_poles_of = |poles: &[Pole]| {
            let leading = sum(poles, |pole| pole);
            let mut all = given.clone();
            all.view_mut((0, 0), leading.shape()).copy_from(&leading);
            all
        };
        let mut b = b.clone();
        b.column_iter_mut().zip(&inputs).for_each(|(mut column, gain)| column *= *gain);
        let mut c = plant.rest.c.clone();
        c.row_iter_mut().zip(&outputs).for_each(|(mut row, gain)| row *= *gain);
        let d = DMatrix::from_fn(plant.p, plant.m, |o, i| plant.d[(o, i)] * outputs[o] * inputs[i]);
        let a = sum(&poles, |pole| (pole * step).exp());
        let held = sum(&poles, |pole| phi1(pole * step) * step);
        let a_time = with_poles_of(&poles);
        if poles.iter().zip(&self.poles).any(|(now, before)| now.pole != before.pole) {
            let before = with_poles_of(&self.poles);
            let entered = plant.rest.continuous.as_ref().map(|(_, b)| b.clone()).unwrap_or_default();
            for (o, row) in self.displacements.iter().enumerate() {
                let Some(row) = row.as_ref().and_then(|row| Some(row * inertia_kept(row, &before, &a_time, &entered)?))
                else {
                    continue;
                };
                let order = plant.sensed[o].order().unwrap_or(0);
                let sensed = (0..order).fold(row, |row, _| a_time.tr_mul(&row));
                c.row_mut(o).copy_from(&(sensed * outputs[o]).transpose());
            }
            for port in plant.ports.iter_mut().filter(|port| port.sees_displacement() && port.moved_by().is_none()) {
                let force = DMatrix::from_columns(std::slice::from_ref(&port.force_rest));
                let Some(factor) = inertia_kept(&port.displacement_rest, &before, &a_time, &force) else { continue };
                port.displacement_rest *= factor;
                port.velocity_rest = a_time.tr_mul(&port.displacement_rest);
            }
        }
        let seen = a.nrows();
        let mut rest = NonModal { a: plant.rest.a.clone(), b: b.clone(), c, continuous: Some((a_time, b)) };
        rest.a.view_mut((0, 0), (seen, seen)).copy_from(&a);
        let entered = held * rest.b.rows(0, seen);
        rest.b.rows_mut(0, seen).copy_from(&entered);
        rest.renew_from(seen, step);
        (plant.rest, plant.d) = (rest, d);
    }

    /// Describes a parameter and its new value for the report.
    pub fn words(&self, number: RestNumber, eta: f64, inputs: &[String], outputs: &[String]) -> String {
        let hz = |k: usize| self.poles[k].pole.norm() / std::f64::consts::TAU;
        let factor = eta.exp();
        match number {
            RestNumber::Rate(k) => format!("real pole {:.3} Hz -> {:.3} Hz", hz(k), hz(k) * factor),
            RestNumber::Frequency(k) => format!("pair of poles {:.3} Hz -> {:.3} Hz", hz(k), hz(k) * factor),
            RestNumber::Damping(k) => {
                format!("pair of poles at {:.3} Hz: damping ratio multiplied by {factor:.3}", hz(k))
            }
            RestNumber::Input(i) => format!("gain of {} multiplied by {factor:.4}", inputs[i]),
            RestNumber::Output(o) => format!("gain of {} multiplied by {factor:.4}", outputs[o]),
            RestNumber::Contribution => format!("non-modal part of the response multiplied by {:.4}", 1.0 + eta),
        }
    }
}

/// Multiplies the contribution of the rest to the outputs and to the motion of the ports by a factor.
fn contribute(plant: &mut Plant, factor: f64) {
    plant.rest.c *= factor;
    plant.d *= factor;
    for port in &mut plant.ports {
        port.displacement_rest *= factor;
        port.velocity_rest *= factor;
    }
}

/// Returns the displacement that an output measures, as a row of the states; `None` if the output's kind is only
/// assumed, or if the row's derivative is not the velocity because a force changes the displacement at once.
fn displacement(plant: &Plant, output: usize) -> Option<DVector<f64>> {
    if plant.sensed[output].source == KindSource::Assumed {
        return None;
    }
    let motion = plant.motion(output)?;
    let row = motion.displacement?;
    plant.is_integral(&motion.velocity, &row).then_some(row.rest)
}

/// Ratio of two accelerations below which the smaller one is a rounding error of the matrix logarithm: poles that move
/// within their limits change an acceleration by much less.
const ROUNDING: f64 = 1e-6;

/// Returns the factor on a displacement with which a force causes the same acceleration at once after the poles have
/// moved. Of several columns, the one with the largest acceleration counts. `None` if no force causes an acceleration
/// at once, up to rounding: it may pass the lag of a drive.
fn inertia_kept(
    row: &DVector<f64>,
    before: &DMatrix<f64>,
    after: &DMatrix<f64>,
    columns: &DMatrix<f64>,
) -> Option<f64> {
    let [before, after] = [before, after].map(|a| columns.tr_mul(&a.tr_mul(row)));
    let at = before.iamax();
    let factor = before[at] / after[at];
    (factor > ROUNDING && factor * ROUNDING < 1.0).then_some(factor)
}

/// Returns a pair of poles with its damping ratio multiplied by a factor.
fn damped(pole: C, factor: f64) -> C {
    let size = pole.norm();
    let zeta = (-pole.re / size * factor).min(0.999);
    C::new(-zeta * size, size * (1.0 - zeta * zeta).sqrt())
}

impl Pole {
    /// Returns the continuous pole that belongs to an eigenvalue of a discrete-time matrix.
    fn of(a: &DMatrix<f64>, z: C, rate: f64) -> Option<Self> {
        let (refined, right, left) = eigenvectors(a, z)?;
        // Rounding gives a real eigenvalue a small imaginary part.
        let z = if z.im == 0.0 { C::from(refined.re) } else { refined };
        Some(Self { pole: z.ln() * rate, right, left })
    }
}

/// Returns the real matrix with eigenvalue f(pole) on the eigenvectors of each pole and of its conjugate.
fn sum(poles: &[Pole], f: impl Fn(C) -> C) -> DMatrix<f64> {
    let n = poles.first().map_or(0, |pole| pole.right.len());
    poles.iter().fold(DMatrix::zeros(n, n), |sum, Pole { pole, right, left }| {
        let both = if pole.im == 0.0 { 1.0 } else { 2.0 };
        sum + (right * left.transpose()).map(|rl| both * (f(*pole) * rl).re)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;
    use plid_model::Model;

    /// A mass with a damper and a spring, whose position is measured at 500 Hz.
    fn servo(k: f64, c: f64) -> Plant {
        let (a, b) = crate::testing::held(&dmatrix![0.0, 1.0; -k, -c], &dmatrix![0.0; 1.0], 2e-3);
        Plant::new(&Model::new(500.0, a, b, dmatrix![1.0, 0.0], dmatrix![0.0]).unwrap()).unwrap()
    }

    fn far(one: &Plant, other: &Plant) -> f64 {
        let difference = |hz: &f64| (one.response(*hz) - other.response(*hz)).norm() / other.response(*hz).norm();
        [0.1, 1.0, 10.0, 100.0].iter().map(difference).fold(0.0, f64::max)
    }

    /// A well-damped pair that is moved by e^eta equals the servo that is built with the new frequency and damping
    /// ratio.
    #[test]
    fn a_moved_pair_is_a_servo_built_so() {
        let (w, zeta) = (30.0_f64, 0.7);
        let nominal = servo(w * w, 2.0 * zeta * w);
        let spectrum = Spectrum::of(&nominal).unwrap();
        assert_eq!(spectrum.numbers[..2], [RestNumber::Frequency(0), RestNumber::Damping(0)]);
        let mut moved = nominal.clone();
        // A unit force accelerates the unit mass, whatever holds the mass.
        spectrum.change(&mut moved, &[0.1, -0.2, 0.0, 0.0]);
        let w = w * 0.1_f64.exp();
        let built = servo(w * w, 2.0 * zeta * (-0.2_f64).exp() * w);
        assert!(far(&moved, &built) < 1e-6, "{}", far(&moved, &built));
        let [moved, built] = [&moved, &built].map(|plant| [plant.mobility(0), plant.stiffness(&plant.ports[0])]);
        assert!(moved.iter().zip(&built).all(|(a, b)| (a / b - 1.0).abs() < 1e-5), "{moved:?} {built:?}");
    }

    /// The current of a motor lags, so the voltage accelerates the shaft only through the current. Whichever pole
    /// moves, the response at low frequency changes by no more than the poles.
    #[test]
    fn a_lag_before_the_inertia_does_not_change_the_gain_by_rounding() {
        let motor = dmatrix![0.0, 1.0, 0.0; 0.0, -4.0, 50.0; 0.0, -30.0, -300.0];
        let (a, b) = crate::testing::held(&motor, &dmatrix![0.0; 0.0; 200.0], 1e-3);
        let nominal = Plant::new(&Model::new(1000.0, a, b, dmatrix![1.0, 0.0, 0.0], dmatrix![0.0]).unwrap()).unwrap();
        let spectrum = Spectrum::of(&nominal).unwrap();
        for k in 0..spectrum.numbers.len() {
            for step in [-0.1, 0.1] {
                let mut moved = nominal.clone();
                let mut eta = vec![0.0; spectrum.numbers.len()];
                eta[k] = step;
                spectrum.change(&mut moved, &eta);
                let ratio = moved.response(1.0).norm() / nominal.response(1.0).norm();
                assert!((0.7..1.4).contains(&ratio), "{:?} {step}: {ratio}", spectrum.numbers[k]);
            }
        }
    }

    /// The pole of a slider is its damper over its mass. The pole moves as if the damper had changed.
    #[test]
    fn a_sliders_pole_moves_by_its_damper() {
        let nominal = servo(0.0, 4.0);
        let spectrum = Spectrum::of(&nominal).unwrap();
        let mut moved = nominal.clone();
        spectrum.change(&mut moved, &[0.3, 0.0, 0.0]);
        let built = servo(0.0, 4.0 * 0.3_f64.exp());
        assert!(far(&moved, &built) < 1e-5, "{}", far(&moved, &built));
    }

    /// The contribution of a slow pole to a plant with a mode can vanish; nothing else changes.
    #[test]
    fn a_pole_beside_a_mode_can_lose_its_part() {
        let (w, rate) = (250.0, 750.0);
        let oscillator = |slow: f64| {
            let a = dmatrix![0.0, 1.0, 0.0; -w * w, -0.1 * w, 0.0; 0.0, 0.0, -19.0];
            let (a, b) = crate::testing::held(&a, &dmatrix![0.0; 1.0; 19.0 / (w * w)], 1.0 / rate);
            let model = Model::new(rate, a, b, dmatrix![1.0, 0.0, slow], DMatrix::zeros(1, 1)).unwrap();
            Plant::new(&model).unwrap()
        };
        let mut plant = oscillator(1.0);
        let spectrum = Spectrum::of(&plant).unwrap();
        assert_eq!(spectrum.numbers, [RestNumber::Contribution]);
        spectrum.change(&mut plant, &[-1.0]);
        let (found, alone) = (plant.response(20.0), oscillator(1e-12).response(20.0));
        assert!((found[(0, 0)] - alone[(0, 0)]).norm() < 1e-6 * alone[(0, 0)].norm());
    }

    #[test]
    fn zero_changes_nothing_and_an_integrator_has_no_rate() {
        let slider = servo(0.0, 4.0);
        let spectrum = Spectrum::of(&slider).unwrap();
        assert_eq!(spectrum.numbers.len(), 3, "{:?}", spectrum.numbers);
        let mut same = slider.clone();
        spectrum.change(&mut same, &[0.0; 3]);
        assert!(far(&same, &slider) < 1e-8, "{}", far(&same, &slider));
        let mut louder = slider.clone();
        spectrum.change(&mut louder, &[0.0, 0.1, 0.05]);
        let ratio = louder.response(3.0)[(0, 0)] / slider.response(3.0)[(0, 0)];
        assert!((ratio - 0.15_f64.exp()).norm() < 1e-8, "{ratio}");
    }
}
