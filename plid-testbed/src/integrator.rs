//! The integration from one sample to the next.

use nalgebra::DMatrix;

use crate::INPUTS;
use crate::effects::chain::{ActuatorEffect, Chain, Disturbance, Span, StructureEffect};
use crate::plant::Truss;
use crate::state_space::{StateSpace, multiply_add};

/// Advances the state over a sample.
///
/// The voltages are constant within each piece of a sample; if no effect needs more, one piece is the whole sample.
/// Without forces inside the structure, each piece is an exact discrete model. With such forces, it is the
/// Runge-Kutta rule of fourth order in the form of Lawson (1967): the linear part is exact in every piece, and the
/// rule acts on the effects' forces alone, so the pieces need only resolve these forces. A force that can hold a body
/// still is found at the end of each piece and is constant over it (Moreau 1988); this method is of first order.
pub(crate) struct Integrator {
    structure: Vec<Box<dyn StructureEffect>>,
    actuator: Vec<Box<dyn ActuatorEffect>>,
    forces: Vec<(usize, Box<dyn Disturbance>)>,
    sample_s: f64,
    /// The edges of the pieces, as shares of the sample.
    edges: Vec<f64>,
    pieces: Vec<Piece>,
    /// The models over a piece, or over half of one if the Runge-Kutta rule needs that.
    models: Vec<StateSpace>,
    voltages: Vec<[f64; INPUTS]>,
    inputs: Vec<f64>,
    work: Work,
}

struct Piece {
    offset_s: f64,
    length_s: f64,
    /// Index of its model.
    model: usize,
}

/// Vectors of a piece, allocated once.
struct Work {
    k: [Vec<f64>; 4],
    advanced: Vec<f64>,
    stage: Vec<f64>,
    transported: Vec<f64>,
}

/// Pieces whose lengths differ by less, in samples, share a model.
const SAME_LENGTH: f64 = 1e-12;

impl Integrator {
    /// Creates an integrator with the effects that act before the sensors, which it takes out of the chain.
    pub(crate) fn new(truss: &Truss, chain: &mut Chain, steps: usize) -> Self {
        let structure = std::mem::take(&mut chain.structure);
        let forces = std::mem::take(&mut chain.forces);
        let sample_s = 1.0 / truss.sample_rate_hz;
        let steps = if structure.is_empty() && !chain.moves_within { 1 } else { steps };
        let edges = edges(steps, &chain.jumps);
        let continuous = extended(truss, chain.own_states, !forces.is_empty());
        let unextended = continuous.a.shape() == truss.continuous.a.shape() && forces.is_empty();
        let (mut pieces, mut lengths, mut models) = (Vec::<Piece>::new(), Vec::<f64>::new(), Vec::new());
        for w in edges.windows(2) {
            let share = w[1] - w[0];
            let model = lengths.iter().position(|l| (l - share).abs() < SAME_LENGTH).unwrap_or_else(|| {
                let length_s = if chain.jumps.is_empty() { sample_s_of(truss, steps) } else { share * sample_s };
                models.push(if !structure.is_empty() {
                    continuous.sampled(length_s / 2.0)
                } else if edges.len() == 2 && unextended {
                    truss.discrete.clone()
                } else {
                    continuous.sampled(length_s)
                });
                lengths.push(share);
                lengths.len() - 1
            });
            pieces.push(if chain.jumps.is_empty() {
                let length_s = sample_s_of(truss, steps);
                Piece { offset_s: pieces.len() as f64 * length_s, length_s, model }
            } else {
                Piece { offset_s: w[0] * sample_s, length_s: share * sample_s, model }
            });
        }
        let zeros = || vec![0.0; continuous.states()];
        Self {
            structure,
            actuator: std::mem::take(&mut chain.actuator),
            forces,
            sample_s,
            voltages: vec![[0.0; INPUTS]; pieces.len()],
            edges,
            pieces,
            models,
            inputs: vec![0.0; continuous.b.ncols()],
            work: Work { k: std::array::from_fn(|_| zeros()), advanced: zeros(), stage: zeros(), transported: zeros() },
        }
    }

    /// Returns the state of a truss at rest: its own states, followed by those of the effects.
    pub(crate) fn at_rest(&self) -> Vec<f64> {
        vec![0.0; self.work.stage.len()]
    }

    /// Advances `x` at `t_s` by one sample, over which the amplifiers hold `u`.
    pub(crate) fn advance(&mut self, x: &mut [f64], u: [f64; INPUTS], t_s: f64) {
        self.voltages.fill(u);
        let span = Span { start_s: t_s, sample_s: self.sample_s, edges: &self.edges };
        for effect in &mut self.actuator {
            effect.apply(&span, &mut self.voltages);
        }
        self.inputs.fill(0.0);
        for (strut, disturbance) in &mut self.forces {
            self.inputs[INPUTS + *strut] += disturbance.force(t_s);
        }
        for (piece, voltages) in self.pieces.iter().zip(&self.voltages) {
            self.inputs[..INPUTS].copy_from_slice(voltages);
            let (model, t_s) = (&self.models[piece.model], t_s + piece.offset_s);
            if self.structure.is_empty() {
                self.work.advanced.fill(0.0);
                multiply_add(&model.a, x, &mut self.work.advanced);
                multiply_add(&model.b, &self.inputs, &mut self.work.advanced);
                x.copy_from_slice(&self.work.advanced);
            } else {
                sub_step(&self.structure, model, &mut self.work, x, &self.inputs, t_s, piece.length_s);
                self.structure.iter().for_each(|effect| effect.settle(piece.length_s, x));
                self.structure.iter_mut().for_each(|effect| effect.end_step(piece.length_s, x));
            }
        }
    }
}

/// Returns the length of one of `steps` equal pieces, s.
fn sample_s_of(truss: &Truss, steps: usize) -> f64 {
    1.0 / (truss.sample_rate_hz * steps as f64)
}

/// Returns the ends of `steps` equal pieces and the jumps between them, as shares of the sample.
fn edges(steps: usize, jumps: &[f64]) -> Vec<f64> {
    let mut edges: Vec<f64> = (0..=steps).map(|i| i as f64 / steps as f64).chain(jumps.iter().copied()).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup_by(|later, earlier| *later - *earlier < SAME_LENGTH);
    // The last edge is the end of the sample, and not a jump just before it.
    *edges.last_mut().expect("0 at least") = 1.0;
    edges
}

/// Returns the continuous plant with the effects' own states, which only the effects move, and with a force along
/// each strut as an additional input if there are such forces.
fn extended(truss: &Truss, own_states: usize, forces: bool) -> StateSpace {
    let StateSpace { a, b, c, d } = &truss.continuous;
    let (n, m) = b.shape();
    let all = n + own_states;
    let inputs = if forces { m + truss.ports.len() } else { m };
    let mut wide = StateSpace {
        a: a.clone().resize(all, all, 0.0),
        b: b.clone().resize(all, inputs, 0.0),
        c: c.clone().resize(c.nrows(), all, 0.0),
        d: d.clone().resize(d.nrows(), inputs, 0.0),
    };
    if forces {
        for port in &truss.ports {
            let force = DMatrix::from_column_slice(n, 1, &port.force);
            wide.b.view_mut((0, m + port.input), (n, 1)).copy_from(&force);
        }
    }
    wide
}

/// Advances `x` by one step. With L the flow of the linear part over half a step and F the effects' share of dx/dt:
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
