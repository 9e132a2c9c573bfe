//! From one sample to the next.

use crate::effects::StructureEffect;
use crate::plant::Truss;
use crate::state_space::{StateSpace, multiply_add};

/// Advances the state over a sample with the input held.
///
/// Without effects that is the exact discrete model. With effects it is the Runge-Kutta rule of fourth order in the form of
/// Lawson (1967): the linear part is exact in every sub-step and the rule acts on the effects' forces alone, so the step
/// need follow only those.
pub(crate) struct Integrator<'a> {
    exact: &'a StateSpace,
    effects: Vec<Box<dyn StructureEffect>>,
    half_step: StateSpace,
    steps: usize,
    step_s: f64,
    work: Work,
}

/// Vectors of a sub-step, allocated once.
struct Work {
    k: [Vec<f64>; 4],
    advanced: Vec<f64>,
    stage: Vec<f64>,
    transported: Vec<f64>,
}

impl<'a> Integrator<'a> {
    pub(crate) fn new(truss: &'a Truss, effects: Vec<Box<dyn StructureEffect>>, steps: usize) -> Self {
        let zeros = || vec![0.0; truss.discrete.states()];
        let step_s = 1.0 / (truss.sample_rate_hz * steps as f64);
        Self {
            exact: &truss.discrete,
            effects,
            half_step: truss.continuous.sampled(step_s / 2.0),
            steps,
            step_s,
            work: Work { k: std::array::from_fn(|_| zeros()), advanced: zeros(), stage: zeros(), transported: zeros() },
        }
    }

    /// `x` at `t_s` becomes `x` one sample later.
    pub(crate) fn advance(&mut self, x: &mut [f64], u: &[f64], t_s: f64) {
        if self.effects.is_empty() {
            self.work.advanced.fill(0.0);
            multiply_add(&self.exact.a, x, &mut self.work.advanced);
            multiply_add(&self.exact.b, u, &mut self.work.advanced);
            x.copy_from_slice(&self.work.advanced);
            return;
        }
        for i in 0..self.steps {
            sub_step(&self.effects, &self.half_step, &mut self.work, x, u, t_s + i as f64 * self.step_s, self.step_s);
        }
    }
}

/// With L the flow of the linear part over half a step and F the effects' share of dx/dt:
/// k1 = F(t, x), k2 = F(t + h/2, L(x + h/2 k1)), k3 = F(t + h/2, L(x) + h/2 k2), k4 = F(t + h, L(L(x) + h k3)),
/// and the new x is L(L(x + h/6 k1) + h/3 (k2 + k3)) + h/6 k4.
fn sub_step(
    effects: &[Box<dyn StructureEffect>],
    half: &StateSpace,
    work: &mut Work,
    x: &mut [f64],
    u: &[f64],
    t: f64,
    h: f64,
) {
    let forces = |t: f64, x: &[f64], k: &mut [f64]| {
        k.fill(0.0);
        effects.iter().for_each(|effect| effect.add_rate(t, x, k));
    };
    let flow = |from: &[f64], to: &mut [f64]| {
        to.fill(0.0);
        multiply_add(&half.a, from, to);
        multiply_add(&half.b, u, to);
    };
    let Work { k: [k1, k2, k3, k4], advanced, stage, transported } = work;
    let n = x.len();

    flow(x, advanced);
    forces(t, x, k1);
    transported.fill(0.0);
    multiply_add(&half.a, k1, transported);
    for i in 0..n {
        stage[i] = advanced[i] + h / 2.0 * transported[i];
    }
    forces(t + h / 2.0, stage, k2);
    for i in 0..n {
        stage[i] = advanced[i] + h / 2.0 * k2[i];
    }
    forces(t + h / 2.0, stage, k3);
    for i in 0..n {
        stage[i] = advanced[i] + h * k3[i];
    }
    flow(stage, x);
    forces(t + h, x, k4);
    for i in 0..n {
        stage[i] = advanced[i] + h / 6.0 * transported[i] + h / 3.0 * (k2[i] + k3[i]);
    }
    flow(stage, x);
    for i in 0..n {
        x[i] += h / 6.0 * k4[i];
    }
}
