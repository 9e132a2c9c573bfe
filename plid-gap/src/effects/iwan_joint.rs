use super::{Action, Effect, Flexible, Force, Parameter, Place, Range, Setting, Side};

/// Number of Jenkins elements. For chi up to 0, the backbone then agrees with its closed form to within 0.05 % of the
/// largest force. The energy lost in a cycle agrees to within 0.5 % down to an amplitude of dm / 10, and to within
/// 2.5 % down to dm / 100.
const ELEMENTS: usize = 64;

/// Displacements of full slip from which fits start, over the RMS displacement of the linear simulation: one within
/// the motion, and one beyond it.
const SLIPS: [f64; 2] = [1.5, 5.0];

/// Further ones for a prescribed motion, which may be far beyond full slip because only the testing machine limits
/// it.
const SLIPS_BEYOND: [f64; 2] = [0.01, 0.1];

/// The exponent from which fits start. Those of bolted joints lie between -1 and 0.
const EXPONENT: f64 = -0.5;

/// The least exponent. At -1, all elements would slip immediately.
const LEAST_EXPONENT: f64 = -0.95;

/// The largest exponent. Segalman's exponents are at most 0; values above 0 allow for errors of a fit. Far above this
/// limit, most elements slip together, and the joint yields at a single displacement: it is then a joint-hysteresis
/// with another knee.
const LARGEST_EXPONENT: f64 = 0.2;

/// Displacement of full slip, over the RMS displacement, above which the joint is almost a spring.
const LARGEST_SLIP: f64 = 30.0;

/// A joint that slips gradually: Jenkins elements (sliders in series with springs) in parallel, which yield at all
/// displacements up to dm. The density of the springs' stiffness over the displacements at which they yield is a
/// power law of exponent chi. A cycle of amplitude A below dm therefore loses an energy in proportion to A^(3 + chi).
///
/// This is the model of Iwan with the density of Segalman (J. Appl. Mech. 72, 2005, 752), without the share of
/// sliders that all yield at full slip (his beta is 0). Here, k is his K_T, and k dm (1 + chi) / (2 + chi) is the
/// force of full slip, his F_S. With chi = 0, all yield displacements are equally frequent (W. D. Iwan, J. Appl.
/// Mech. 33, 1966, 893).
///
/// The simulation may contain a share s of the stiffness k of the stuck joint, which is then removed from it. On a
/// single mode and on a structure of a single mode, s is 1 if it is omitted: the simulation was identified at a low
/// level, or has the joint as a spring. At other ports, it is 0 if it is omitted: the simulation lacks the joint.
pub struct IwanJoint;

impl Effect for IwanJoint {
    fn name(&self) -> &'static str {
        "iwan-joint"
    }

    fn side(&self) -> Side {
        Side::Structure
    }

    fn family(&self) -> Option<&'static str> {
        Some("dry friction")
    }

    fn refines(&self) -> Option<&'static str> {
        Some("joint-hysteresis")
    }

    fn equation(&self) -> &'static str {
        "f = k (s d - (1 + chi) int z_x x^chi dx), x = 0..1; dz_x/dt = v where abs(z_x) < x dm or z_x returns, else 0; \
        without s it is 0, on a mode 1"
    }

    fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
        vec![
            Parameter::new("k", "force/displacement", Range::Positive),
            Parameter::new("dm", "displacement", Range::Positive),
            Parameter::new("chi", "1", Range::Signed),
            Parameter::new("s", "1", Range::Signed).or_left_out(),
        ]
    }

    fn places(&self, setting: &Setting) -> Vec<Place> {
        setting.springs()
    }

    fn starts(&self, setting: &Setting, place: &Place) -> Vec<Vec<f64>> {
        let port = setting.port(place);
        let (force, d) = (setting.force[port], setting.d_rms[port]);
        let moved = setting.plant.ports[port].moved_by().is_some();
        let far: &[f64] = if moved { &SLIPS_BEYOND } else { &[] };
        let lacking = SLIPS.iter().chain(far).map(|share| vec![0.01 * force / d, share * d, EXPONENT]);
        let held = SLIPS
            .iter()
            .filter(|_| setting.may_contain_joints(port))
            .map(|share| vec![0.01 * force / d, share * d, EXPONENT, 1.0]);
        lacking.chain(held).collect()
    }

    fn amplitude(&self) -> Option<(usize, f64)> {
        Some((0, 0.0))
    }

    fn sound(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> bool {
        let port = setting.port(place);
        let moved = setting.plant.ports[port].moved_by().is_some();
        let least = if moved { 1e-3 } else { 0.01 };
        let s = held_share(setting, port, parameters);
        (least..LARGEST_SLIP).contains(&(parameters[1] / setting.d_rms[port]))
            && (LEAST_EXPONENT..LARGEST_EXPONENT).contains(&parameters[2])
            && setting.may_contain(port, s, parameters[0])
    }

    fn free_shape(&self) -> Option<&'static Flexible> {
        Some(&Flexible::Joint)
    }

    fn act(&self, setting: &Setting, place: &Place, parameters: &[f64]) -> Vec<Action> {
        let port = setting.port(place);
        let s = held_share(setting, port, parameters);
        vec![Action::Force(port, Box::new(Sliders::new(parameters[0], parameters[1], parameters[2], s)))]
    }
}

/// Returns the share of the joint's stiffness that the simulation contains.
fn held_share(setting: &Setting, port: usize, parameters: &[f64]) -> f64 {
    let unsaid = if setting.contains_joints(port) { 1.0 } else { 0.0 };
    parameters.get(3).copied().unwrap_or(unsaid)
}

/// Jenkins elements in parallel. The state contains the stretch of each element's spring.
struct Sliders {
    k: f64,
    s: f64,
    /// The stretch at which each slider yields.
    yields: [f64; ELEMENTS],
    /// Share of each spring in k.
    shares: [f64; ELEMENTS],
}

impl Sliders {
    /// Divides the yield displacements into intervals that become shorter towards zero. Each interval has one element
    /// with the stiffness and the force of full slip of the interval, so that the backbone is exact where intervals
    /// meet.
    fn new(k: f64, dm: f64, chi: f64, s: f64) -> Self {
        let power = 1.0 + chi.max(LEAST_EXPONENT);
        let edge = |j: usize| (j as f64 / ELEMENTS as f64).powi(3);
        let between = |j: usize, power: f64| edge(j + 1).powf(power) - edge(j).powf(power);
        let shares = std::array::from_fn(|j| between(j, power));
        let yields = std::array::from_fn(|j| dm * power / (power + 1.0) * between(j, power + 1.0) / between(j, power));
        Self { k, s, yields, shares }
    }
}

impl Force for Sliders {
    fn force(&self, d: f64, _v: f64, state: &[f64]) -> f64 {
        self.k * (self.s * d - stretch(&self.shares, state))
    }

    fn states(&self) -> usize {
        ELEMENTS
    }

    /// Advances the state exactly for a motion in one direction.
    fn advance(&self, from: f64, to: f64, state: &mut [f64]) {
        slide(state, &self.yields, to - from);
    }
}

/// Number of partial sums over the springs, so that the processor can work on several at once.
const SUMS: usize = 8;

#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
fn stretch(shares: &[f64; ELEMENTS], state: &[f64]) -> f64 {
    let mut sums = [0.0; SUMS];
    for (shares, state) in shares.chunks_exact(SUMS).zip(state.chunks_exact(SUMS)) {
        for ((sum, share), z) in sums.iter_mut().zip(shares).zip(state) {
            *sum += share * z;
        }
    }
    sums.iter().sum()
}

/// Moves all sliders by this displacement.
#[multiversion::multiversion(targets("x86_64+avx2+fma"))]
fn slide(state: &mut [f64], yields: &[f64; ELEMENTS], by: f64) {
    for (z, most) in state.iter_mut().zip(yields) {
        *z = (*z + by).max(-most).min(*most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPONENTS: [f64; 4] = [-0.9, -0.5, 0.0, 0.5];

    /// Returns the force of the joint itself along a path from rest.
    fn along(chi: f64, way: impl Iterator<Item = f64>) -> Vec<f64> {
        let joint = Sliders::new(3.0, 2.0, chi, 0.0);
        let (mut state, mut before) = (vec![0.0; joint.states()], 0.0);
        let step = |d: f64| {
            joint.advance(before, d, &mut state);
            before = d;
            -joint.force(d, 0.0, &state)
        };
        way.map(step).collect()
    }

    /// Returns the force of Segalman's joint when it is loaded for the first time, with k = 3 and dm = 2: from the
    /// density R x^chi, k x - R x^(2 + chi) / ((1 + chi) (2 + chi)).
    fn backbone(chi: f64, d: f64) -> f64 {
        let (k, dm) = (3.0, 2.0_f64);
        let density = k * (1.0 + chi) / dm.powf(1.0 + chi);
        let d = d.min(dm);
        k * d - density * d.powf(2.0 + chi) / ((1.0 + chi) * (2.0 + chi))
    }

    #[test]
    fn the_backbone_is_that_of_the_closed_form() {
        for chi in EXPONENTS {
            let way = || (1..=500).map(|j| f64::from(j) * 0.005);
            let slip = 3.0 * 2.0 * (1.0 + chi) / (2.0 + chi);
            let far = |(force, d): (f64, f64)| (force - backbone(chi, d)).abs() / slip;
            let far = along(chi, way()).into_iter().zip(way()).map(far).fold(0.0, f64::max);
            assert!(far < 7e-4, "{chi}: {far:.1e}");
            assert!((backbone(chi, 2.5) / slip - 1.0).abs() < 1e-12);
        }
    }

    /// The energy lost in a cycle of amplitude A is 4 R A^(3 + chi) / ((3 + chi) (2 + chi)).
    #[test]
    fn the_energy_lost_in_a_cycle_grows_with_the_power_three_plus_chi() {
        const STEPS: i32 = 20_000;
        for chi in EXPONENTS {
            let lost = |amplitude: f64| {
                let at = move |j: i32| amplitude * (std::f64::consts::TAU * f64::from(j) / f64::from(STEPS)).sin();
                let forces = along(chi, (0..=2 * STEPS).map(at));
                let work = |j: i32| 0.5 * (forces[j as usize] + forces[j as usize + 1]) * (at(j + 1) - at(j));
                (STEPS..2 * STEPS).map(work).sum::<f64>()
            };
            let expected = |amplitude: f64| {
                let density = 3.0 * (1.0 + chi) / 2.0_f64.powf(1.0 + chi);
                4.0 * density * amplitude.powf(3.0 + chi) / ((3.0 + chi) * (2.0 + chi))
            };
            for (amplitude, limit) in [(2.0, 0.0015), (0.9, 0.004), (0.2, 0.008), (0.02, 0.04)] {
                let off = lost(amplitude) / expected(amplitude) - 1.0;
                println!("{chi} {amplitude} {off:.1e}");
                assert!(off.abs() < limit, "{chi}, {amplitude}: {off:.1e}");
            }
            let exponent = (lost(1.6) / lost(0.16)).log10();
            assert!((exponent - 3.0 - chi).abs() < 0.02, "{chi}: {exponent}");
        }
    }

    /// A motion back and forth closes its loop, and the force continues where it was interrupted (Masing, 1926).
    #[test]
    fn a_loop_closes() {
        let forces = along(-0.3, [1.2, -0.4, 0.7, 0.1, 0.7, -0.4, 1.2].into_iter());
        assert!((forces[2] - forces[4]).abs() < 1e-12 && (forces[1] - forces[5]).abs() < 1e-12);
        assert!((forces[0] - forces[6]).abs() < 1e-12);
        let back = |from: f64, to: f64| 2.0 * backbone(-0.3, 0.5 * (from - to));
        assert!((forces[0] - forces[1] - back(1.2, -0.4)).abs() < 0.02);
    }

    /// While it sticks, a joint whose stiffness the simulation contains has no effect.
    #[test]
    fn a_stuck_joint_that_the_simulation_holds_has_no_force() {
        let joint = Sliders::new(3.0, 2.0, 0.0, 1.0);
        let mut state = vec![0.0; joint.states()];
        let d = 0.9 * joint.yields[0];
        joint.advance(0.0, d, &mut state);
        assert!(joint.force(d, 0.0, &state).abs() < 1e-12 * d);
        joint.advance(d, 1.0, &mut state);
        assert!((joint.force(1.0, 0.0, &state) - (3.0 - backbone(0.0, 1.0))).abs() < 0.02);
    }
}
