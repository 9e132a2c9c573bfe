//! The simulation in modal form: each pair of structural poles by itself, and the rest (actuators, filters) in one
//! block.
//!
//! In these coordinates, the frequency, damping ratio or shape of one mode can be changed by itself, whatever the
//! state-space basis of the simulation.

mod axis;
mod chain;
mod channels;
mod declared;
mod drive;
mod feedback;
mod joint;
mod kind;
mod load;
mod logarithm;
mod motion;
mod ports;
mod reciprocal;
mod repeated;
mod sensor;
mod shown_forces;
mod spectrum;
mod unseen;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use plid_model::{ModeKind, Model, OutputKind};

use crate::case::{Controller, ON_A_MODE};
use crate::error::GapError;
use crate::settings::PlantSettings;
use plid_fourier::C;

pub(crate) use chain::Actuator;
pub use chain::SignalChain;
pub use declared::CasePort;
pub use kind::{KindSource, Sensed};
pub use load::Load;
pub(crate) use logarithm::logarithm;
pub(crate) use ports::SAME_ROW;
pub use ports::{PortScale, PortSource};
pub use spectrum::{RestNumber, Spectrum};

/// One mode of the structure: dz/dt = pole z + b u, y += 2 Re(c z), with a complex z.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Pole in rad/s, with a positive imaginary part.
    pub pole: C,
    /// Input shape (m).
    pub b: Vec<C>,
    /// Output shape (p).
    pub c: Vec<C>,
}

impl Mode {
    /// Returns the frequency in Hz, |pole| / 2 pi.
    pub fn hz(&self) -> f64 {
        self.pole.norm() / std::f64::consts::TAU
    }

    /// Returns the damping ratio, -Re pole / |pole|.
    pub fn damping(&self) -> f64 {
        -self.pole.re / self.pole.norm()
    }
}

/// Factors on a mode's output rows if its pole moves and its physical shapes do not change. For a real b,
/// dz/dt = pole z + b f and q = 2 Re(z / (pole - conj pole)).
pub(crate) struct Carried {
    /// Factor on the row of q.
    pub displacement: f64,
    /// Factor on the row of q'.
    pub velocity: C,
    /// Factor on the row of q".
    acceleration: C,
}

impl Carried {
    /// The factors of a pole that does not move.
    pub(crate) const UNMOVED: Self = Self { displacement: 1.0, velocity: C::ONE, acceleration: C::ONE };

    pub(crate) fn new(from: C, to: C) -> Self {
        let (displacement, turn) = (from.im / to.im, to / from);
        Self { displacement, velocity: turn * displacement, acceleration: turn * turn * displacement }
    }

    /// Returns the factor on an output's row. An output that measures no motion keeps its row.
    pub(crate) fn sensed(&self, sensed: Sensed) -> C {
        match sensed.order() {
            None => C::ONE,
            Some(0) => C::from(self.displacement),
            Some(1) => self.velocity,
            Some(_) => self.acceleration,
        }
    }
}

/// The rest of the simulation, which contains no structural mode: r states, discrete at the sample rate.
#[derive(Debug, Clone, PartialEq)]
pub struct NonModal {
    /// State matrix over one sample (r x r).
    pub a: DMatrix<f64>,
    /// Input matrix over one sample (r x m).
    pub b: DMatrix<f64>,
    /// Output matrix (p x r).
    pub c: DMatrix<f64>,
    /// State matrix (r x r) and input matrix (r x m) in continuous time, if the logarithm exists.
    pub continuous: Option<(DMatrix<f64>, DMatrix<f64>)>,
}

/// A port of internal forces: dz/dt += force f and d = 2 Re(displacement . z) + displacement_rest . x; v has the same
/// form.
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    /// The name of the port; an inferred port has the name of its input or output.
    pub name: String,
    /// The input (counted from 0) to which the port belongs.
    pub input: Option<usize>,
    /// The quantities in which its force and its motion are given.
    pub scale: PortScale,
    /// Force on each mode.
    pub force: Vec<C>,
    /// Displacement row of each mode.
    pub displacement: Vec<C>,
    /// Velocity row of each mode.
    pub velocity: Vec<C>,
    /// Force on the rest (r).
    pub force_rest: DVector<f64>,
    /// Displacement row of the rest (r).
    pub displacement_rest: DVector<f64>,
    /// Velocity row of the rest (r).
    pub velocity_rest: DVector<f64>,
    /// Direct response of the outputs to a unit force (p); empty if there is none.
    pub output: Vec<f64>,
}

/// A simulation in modal form.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    /// Sample rate in Hz.
    pub rate: f64,
    /// Number of inputs.
    pub m: usize,
    /// Number of outputs.
    pub p: usize,
    /// Structural modes, in order of increasing frequency in the simulation as given; added modes come last.
    pub modes: Vec<Mode>,
    /// All other states.
    pub rest: NonModal,
    /// Direct feedthrough (p x m).
    pub d: DMatrix<f64>,
    /// Ports of internal forces.
    pub ports: Vec<Port>,
    /// The source of the ports.
    pub port_source: PortSource,
    /// Actuators and filters.
    pub chain: SignalChain,
    /// What each output measures (p).
    pub sensed: Vec<Sensed>,
    /// The discrete-time controller that closes a loop around the plant, if there is one. The inputs of a run are
    /// then added to its commands.
    pub controller: Option<Arc<Controller>>,
    /// A constant offset of each output (p) if the simulation is a model of the records; empty otherwise.
    pub offsets: Vec<f64>,
    /// The basis of the decomposition, by which declared ports are written in modal coordinates.
    basis: Basis,
    /// The thresholds of the decomposition.
    settings: PlantSettings,
}

/// The basis of the decomposition: x = sum of 2 Re(right z) + rest x_r, with z = left x and x_r = rest_inverse x.
#[derive(Debug, Clone, PartialEq)]
struct Basis {
    right: Vec<DVector<C>>,
    left: Vec<DVector<C>>,
    rest: DMatrix<f64>,
    rest_inverse: DMatrix<f64>,
}

/// Returns the discrete poles of the structural modes with their right and left eigenvectors. A repeated pole has a
/// mode for each pair of vectors that can be separated; what remains of it belongs to the rest.
fn structural(model: &Model, settings: &PlantSettings) -> Result<Vec<Structural>, GapError> {
    let mut oscillatory = plid_model::modes(model)?;
    oscillatory.retain(|mode| mode.kind == ModeKind::Oscillatory);
    let PlantSettings { light_damping, heavy_damping, mode_condition, .. } = *settings;
    let light = |damping: f64| damping.abs() < light_damping;
    let highest = oscillatory.iter().filter(|m| light(m.damping)).map(|m| m.hz).fold(0.0, f64::max);
    let poles: Vec<C> = oscillatory
        .into_iter()
        .filter(|mode| light(mode.damping) || mode.hz < highest && mode.damping.abs() < heavy_damping)
        .map(|mode| mode.pole)
        .collect();
    let mut structural: Vec<Structural> = Vec::new();
    for &pole in &poles {
        let vectors = if poles.iter().filter(|other| repeated::is_same(pole, **other)).count() > 1 {
            let others: Vec<_> = structural.iter().filter(|(other, ..)| repeated::is_same(pole, *other)).collect();
            repeated::eigenvectors(model, pole, &others)
        } else {
            eigenvectors(&model.a, pole)
        };
        structural.extend(vectors.filter(|(_, right, left)| left.norm() * right.norm() < mode_condition));
    }
    Ok(structural)
}

/// Returns the discrete poles of the modes of a model in modal coordinates, whose first states are (Re z, Im z) of each
/// mode; `None` if the model is in other coordinates.
fn leading_poles(model: &Model, modes: usize) -> Option<Vec<C>> {
    let (a, n) = (&model.a, model.n());
    let is_alone = |i: usize| (0..n).all(|j| j / 2 == i / 2 || a[(i, j)] == 0.0 && a[(j, i)] == 0.0);
    let pole = |i: usize| {
        let z = C::new(a[(i, i)], a[(i + 1, i)]);
        let turns = z.im > 0.0 && a[(i + 1, i + 1)] == z.re && a[(i, i + 1)] == -z.im;
        (turns && is_alone(i) && is_alone(i + 1)).then_some(z)
    };
    if 2 * modes > n { None } else { (0..modes).map(|k| pole(2 * k)).collect() }
}

impl Plant {
    /// Decomposes a simulation with the default thresholds.
    ///
    /// # Errors
    /// [`GapError::Model`] if the eigenvalues cannot be computed.
    pub fn new(model: &Model) -> Result<Self, GapError> {
        Self::with_settings(model, &PlantSettings::default())
    }

    /// Decomposes a simulation.
    ///
    /// # Errors
    /// [`GapError::Model`] if the eigenvalues cannot be computed.
    pub fn with_settings(model: &Model, settings: &PlantSettings) -> Result<Self, GapError> {
        let model = balanced(model);
        let found = structural(&model, settings)?;
        Ok(Self::of_modes(&model, found, settings))
    }

    /// Decomposes a simulation as [`Plant::to_model`] writes it: the first states are those of this number of modes.
    /// They stay modes although a refit may have moved a damping ratio past a threshold. A simulation in other
    /// coordinates is decomposed by the thresholds.
    ///
    /// # Errors
    /// [`GapError::Model`] if the eigenvalues cannot be computed.
    pub fn in_modal_coordinates(model: &Model, modes: usize, settings: &PlantSettings) -> Result<Self, GapError> {
        let Some(poles) = leading_poles(model, modes) else { return Self::with_settings(model, settings) };
        let vector = |k: usize, [re, im]: [f64; 2]| {
            let mut vector = DVector::from_element(model.n(), C::ZERO);
            (vector[2 * k], vector[2 * k + 1]) = (C::from(re), C::new(0.0, im));
            vector
        };
        // A rotation by z has the right eigenvector (1, -j) and the left one (1, j) / 2.
        let written = |(k, z): (usize, C)| (z, vector(k, [1.0, -1.0]), vector(k, [0.5, 0.5]));
        let found = poles.into_iter().enumerate().map(written).collect();
        Ok(Self::of_modes(model, found, settings))
    }

    /// Returns the plant with these modes. All other states belong to the rest.
    fn of_modes(model: &Model, structural: Vec<Structural>, settings: &PlantSettings) -> Self {
        let (n, m, p, rate) = (model.n(), model.m(), model.p(), model.sample_rate_hz);
        let (poles, right, left) = split(structural);
        let mut projection = DMatrix::identity(n, n);
        for (r, l) in right.iter().zip(&left) {
            projection -= (r * l.transpose()).map(|x| 2.0 * x.re);
        }
        let rest_states = n - 2 * poles.len();
        let rest = range(&projection, rest_states);
        let rest_inverse = rest.transpose() * &projection;
        let basis = Basis { right, left, rest, rest_inverse };

        let step = 1.0 / rate;
        let modes: Vec<Mode> = poles
            .iter()
            .enumerate()
            .map(|(k, &z)| {
                let pole = z.ln() * rate;
                // Over one sample, a held unit input adds (e^{pole T} - 1) / pole b to the state.
                let held = (z - 1.0) / pole;
                let b = (basis.left[k].transpose() * model.b.map(C::from)) / held;
                let c = model.c.map(C::from) * &basis.right[k];
                Mode { pole, b: b.iter().copied().collect(), c: c.iter().copied().collect() }
            })
            .collect();
        let a = &basis.rest_inverse * &model.a * &basis.rest;
        let b = &basis.rest_inverse * &model.b;
        let continuous = rest_in_time(model, &basis, &a, &b, step);
        let rest = NonModal { c: &model.c * &basis.rest, a, b, continuous };
        let chain = signal_chain(&rest, &modes, step, settings);
        let mut plant = Self {
            rate,
            m,
            p,
            modes,
            rest,
            d: model.d.clone(),
            ports: Vec::new(),
            port_source: PortSource::Declared,
            chain,
            sensed: vec![Sensed::ASSUMED; p],
            controller: None,
            offsets: Vec::new(),
            basis,
            settings: settings.clone(),
        };
        plant.sensed = kind::sensed(&plant, &model.output_kinds);
        let mut plant = plant.with_the_chain_that_fits(&model.output_kinds);
        let declared: Vec<Port> = model.ports.iter().map(|port| plant.declared(model, port)).collect();
        (plant.ports, plant.port_source) =
            if declared.is_empty() { inferred(&mut plant, model) } else { (declared, PortSource::Declared) };
        plant
    }

    /// Returns the plant without actuators and filters if its modes alone reproduce its responses better than with
    /// these. With one input and one output, every further pole seems to belong to that channel, wherever it acts.
    fn with_the_chain_that_fits(self, declared: &[Option<OutputKind>]) -> Self {
        if !self.chain.known() || self.modes.is_empty() {
            return self;
        }
        let mut bare = Self { chain: SignalChain::none(self.m, self.p), ..self.clone() };
        bare.sensed = kind::sensed(&bare, declared);
        if kind::misfit(&bare) < kind::misfit(&self) { bare } else { self }
    }

    /// Returns a declared port in modal coordinates.
    fn declared(&self, model: &Model, port: &plid_model::Port) -> Port {
        let Basis { right, left, rest, rest_inverse } = &self.basis;
        let force = DVector::from_column_slice(&port.force);
        let row = |values: &[f64]| DVector::from_column_slice(values);
        let modal_row = |values: &[f64]| right.iter().map(|r| r.dot(&row(values).map(C::from))).collect();
        let input = port.input.as_ref().and_then(|name| model.inputs.iter().position(|input| input == name));
        // A port that neither acts on the states nor moves with them has its input as its motion.
        let stands = [&port.force, &port.displacement, &port.velocity].into_iter().flatten().all(|x| *x == 0.0);
        let shown = port.output.iter().flatten().position(|x| *x != 0.0);
        let scale = match (input, shown) {
            (Some(input), Some(output)) if stands => PortScale::Moved { input, output },
            _ => PortScale::Own,
        };
        Port {
            name: port.name.clone(),
            input,
            scale,
            force: left.iter().map(|l| l.dot(&force.map(C::from))).collect(),
            displacement: modal_row(&port.displacement),
            velocity: modal_row(&port.velocity),
            force_rest: rest_inverse * &force,
            displacement_rest: rest.transpose() * row(&port.displacement),
            velocity_rest: rest.transpose() * row(&port.velocity),
            output: port.output.clone().unwrap_or_default(),
        }
    }

    /// Returns whether any output measures a motion.
    pub fn shows_motion(&self) -> bool {
        self.sensed.iter().any(|sensed| sensed.is_motion())
    }

    /// Adds a port on a single mode, `mode:HZ`, for effects that no input's port explains. There is none if no output
    /// measures a motion.
    pub fn add_modal_port(&mut self, mode: usize) {
        let name = format!("{ON_A_MODE}{}", plain_hz(self.modes[mode].hz()));
        if self.shows_motion() && self.ports.iter().all(|port| port.name != name) {
            let port = ports::of_mode(self, mode);
            self.ports.push(Port { name, ..port });
        }
    }

    /// Removes a spring between the ends of a port that lies on a single mode. The damping force of the mode does not
    /// change.
    pub(crate) fn take_spring(&mut self, port: usize, k: f64) {
        let port = &self.ports[port];
        // In a plant that was read from a file, the forces on the other modes are not zero but rounding errors.
        let size = |k: usize| port.force[k].norm_sqr();
        let Some(mode) = (0..self.modes.len()).max_by(|&a, &b| size(a).total_cmp(&size(b))) else { return };
        let share = (k / self.stiffness(port)).min(0.9);
        let pole = self.modes[mode].pole;
        let square = pole.norm_sqr() * (1.0 - share) - pole.re * pole.re;
        if square > 0.0 {
            self.move_pole(mode, C::new(pole.re, square.sqrt()));
        }
    }

    /// Returns the static stiffness at a port: the force over the displacement that it causes through the modes.
    pub fn stiffness(&self, port: &Port) -> f64 {
        let parts = self.modes.iter().zip(&port.force).zip(&port.displacement);
        if self.modes.is_empty() {
            return self.axis_stiffness(port);
        }
        let compliance: f64 = parts.map(|((mode, force), row)| -2.0 * (row * force / mode.pole).re).sum();
        if compliance == 0.0 { 0.0 } else { 1.0 / compliance.abs() }
    }

    /// Returns the number of states: two for each mode, and those of the rest.
    pub fn n(&self) -> usize {
        2 * self.modes.len() + self.rest.a.nrows()
    }

    /// Returns the number of states on which the outputs depend.
    pub fn seen_states(&self) -> usize {
        2 * self.modes.len() + self.rest.seen()
    }

    /// Returns the mode nearest to a frequency.
    pub fn mode_at(&self, hz: f64) -> Option<usize> {
        (0..self.modes.len()).min_by(|&a, &b| {
            let far = |k: usize| (self.modes[k].hz() / hz).ln().abs();
            far(a).total_cmp(&far(b))
        })
    }

    /// Returns the plant as a model in real modal coordinates: (Re z, Im z) of each mode, then the rest. Ports are
    /// kept, and so is the continuous form if it is known.
    pub fn to_model(&self, names: &Model) -> Model {
        let (n, q, r) = (self.n(), self.modes.len(), self.rest.a.nrows());
        let step = 1.0 / self.rate;
        let mut a = DMatrix::zeros(n, n);
        let mut b = DMatrix::zeros(n, self.m);
        let mut c = DMatrix::zeros(self.p, n);
        let (mut a_time, mut b_time) = (a.clone(), b.clone());
        for (k, mode) in self.modes.iter().enumerate() {
            let i = 2 * k;
            let z = (mode.pole * step).exp();
            let held = (z - 1.0) / mode.pole;
            put_rotation(&mut a, i, z);
            put_rotation(&mut a_time, i, mode.pole);
            for j in 0..self.m {
                put_pair(&mut b, i, j, held * mode.b[j]);
                put_pair(&mut b_time, i, j, mode.b[j]);
            }
            for o in 0..self.p {
                c[(o, i)] = 2.0 * mode.c[o].re;
                c[(o, i + 1)] = -2.0 * mode.c[o].im;
            }
        }
        a.view_mut((2 * q, 2 * q), (r, r)).copy_from(&self.rest.a);
        b.rows_mut(2 * q, r).copy_from(&self.rest.b);
        c.columns_mut(2 * q, r).copy_from(&self.rest.c);
        let continuous = self.rest.continuous.as_ref().map(|(ar, br)| {
            a_time.view_mut((2 * q, 2 * q), (r, r)).copy_from(ar);
            b_time.rows_mut(2 * q, r).copy_from(br);
            plid_model::Continuous { a: a_time, b: b_time }
        });
        let mut model = names.clone();
        (model.a, model.b, model.c, model.d, model.continuous) = (a, b, c, self.d.clone(), continuous);
        model.predictor_gain = None;
        model.observability_indices = None;
        model.parameter_covariance = None;
        model.initial_state = None;
        model.ports = self.ports.iter().map(|port| self.written(port, &names.inputs)).collect();
        let known = |sensed: &Sensed| (sensed.source != KindSource::Assumed).then_some(sensed.kind);
        model.output_kinds = self.sensed.iter().map(known).collect();
        model
    }

    fn written(&self, port: &Port, inputs: &[String]) -> plid_model::Port {
        let column = |modal: &[C], rest: &DVector<f64>| {
            modal.iter().flat_map(|x| [x.re, x.im]).chain(rest.iter().copied()).collect::<Vec<f64>>()
        };
        let row = |modal: &[C], rest: &DVector<f64>| {
            modal.iter().flat_map(|x| [2.0 * x.re, -2.0 * x.im]).chain(rest.iter().copied()).collect::<Vec<f64>>()
        };
        plid_model::Port {
            name: port.name.clone(),
            input: port.input.map(|i| inputs[i].clone()),
            force: column(&port.force, &port.force_rest),
            displacement: row(&port.displacement, &port.displacement_rest),
            velocity: row(&port.velocity, &port.velocity_rest),
            output: (!port.output.is_empty()).then(|| port.output.clone()),
        }
    }
}

/// Formats a frequency with one decimal or four significant digits, whichever is more precise.
pub fn plain_hz(hz: f64) -> String {
    let digits = if hz > 0.0 { (3.0 - hz.log10().floor()).clamp(1.0, 12.0) as usize } else { 1 };
    format!("{hz:.digits$}")
}

fn put_rotation(to: &mut DMatrix<f64>, i: usize, z: C) {
    to[(i, i)] = z.re;
    to[(i + 1, i + 1)] = z.re;
    to[(i, i + 1)] = -z.im;
    to[(i + 1, i)] = z.im;
}

fn put_pair(to: &mut DMatrix<f64>, i: usize, j: usize, z: C) {
    to[(i, j)] = z.re;
    to[(i + 1, j)] = z.im;
}

/// Returns the magnitude of the slowest pole of the modes, in rad/s; zero without modes.
fn lowest(modes: &[Mode]) -> f64 {
    modes.iter().map(|mode| mode.pole.norm()).reduce(f64::min).unwrap_or(0.0)
}

/// Returns the poles of actuators and filters.
fn signal_chain(rest: &NonModal, modes: &[Mode], step: f64, settings: &PlantSettings) -> SignalChain {
    let states = if modes.is_empty() { rest.leading() } else { rest.clone() };
    let mut chain = SignalChain::find(&states, step, lowest(modes), settings);
    chain.resize(rest.a.nrows());
    if modes.is_empty() {
        // An input drives every pole of its axis alone, so these cannot be distinguished from the pole of an actuator.
        chain.actuator.fill(None);
    }
    chain
}

type Structural = (C, DVector<C>, DVector<C>);

/// Returns the simulation with its states scaled to similar size, whatever its basis.
fn balanced(model: &Model) -> Model {
    let mut balanced = model.clone();
    let scale = nalgebra::linalg::balancing::balance_parlett_reinsch(&mut balanced.a);
    let n = model.n();
    balanced.b = DMatrix::from_fn(n, model.m(), |i, j| model.b[(i, j)] / scale[i]);
    balanced.c = DMatrix::from_fn(model.p(), n, |i, j| model.c[(i, j)] * scale[j]);
    if let Some(continuous) = &mut balanced.continuous {
        continuous.a = DMatrix::from_fn(n, n, |i, j| continuous.a[(i, j)] * scale[j] / scale[i]);
        continuous.b = DMatrix::from_fn(n, model.m(), |i, j| continuous.b[(i, j)] / scale[i]);
    }
    for port in &mut balanced.ports {
        for i in 0..n {
            port.force[i] /= scale[i];
            port.displacement[i] *= scale[i];
            port.velocity[i] *= scale[i];
        }
    }
    balanced
}

/// Returns a pole with its right and left eigenvectors (l . r = 1), by inverse iteration on each side. Other poles
/// that are repeated do not disturb the iteration, although they make the matrix of all eigenvectors singular. If this
/// pole is repeated, the vectors are the same at each call.
fn eigenvectors(a: &DMatrix<f64>, pole: C) -> Option<Structural> {
    let matrix = a.map(C::from);
    let shift = pole * (1.0 + 1e-10);
    let start = DMatrix::from_fn(a.nrows(), 1, |i, _| C::cis(i as f64));
    let right = iterated(&matrix, shift, &start)?;
    let left = iterated(&matrix.transpose(), shift, &start)?;
    paired(&matrix, right.column(0).into_owned(), left.column(0).into_owned())
}

/// Returns the columns of a matrix after inverse iteration towards the pole next to `shift`, divided by a common size.
fn iterated(matrix: &DMatrix<C>, shift: C, start: &DMatrix<C>) -> Option<DMatrix<C>> {
    let n = matrix.nrows();
    let factors = (matrix - DMatrix::from_diagonal_element(n, n, shift)).lu();
    (0..4).try_fold(start.clone(), |columns, _| Some(factors.solve(&columns)?.normalize()))
}

/// Returns the pole of these eigenvectors of a matrix, and the vectors with l . r = 1.
fn paired(matrix: &DMatrix<C>, right: DVector<C>, mut left: DVector<C>) -> Option<Structural> {
    let product = left.dot(&right);
    if !(product.norm() > 0.0) {
        return None;
    }
    left /= product;
    let pole = left.dot(&(matrix * &right));
    Some((pole, right, left))
}

fn split(structural: Vec<Structural>) -> (Vec<C>, Vec<DVector<C>>, Vec<DVector<C>>) {
    let mut parts = (Vec::new(), Vec::new(), Vec::new());
    for (pole, right, left) in structural {
        parts.0.push(pole);
        parts.1.push(right);
        parts.2.push(left);
    }
    parts
}

/// Returns an orthonormal basis (n x rank) of a projection's range: the first columns of a pivoted QR factorisation,
/// since the singular values of a projection are zero or at least one. The library's singular vectors are inaccurate if
/// singular values repeat, as they do here.
fn range(projection: &DMatrix<f64>, rank: usize) -> DMatrix<f64> {
    if rank == 0 {
        return DMatrix::zeros(projection.nrows(), 0);
    }
    let near = projection.clone().col_piv_qr().q().columns(0, rank).into_owned();
    // A second projection removes rounding errors outside the range.
    (projection * near).qr().q()
}

/// Returns the rest in continuous time, as the simulation declares it or by the matrix logarithm.
fn rest_in_time(
    model: &Model,
    basis: &Basis,
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    step: f64,
) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    if let Some(given) = &model.continuous {
        return Some((&basis.rest_inverse * &given.a * &basis.rest, &basis.rest_inverse * &given.b));
    }
    let r = a.nrows();
    if r == 0 {
        return Some((a.clone(), b.clone()));
    }
    // e^{[A B; 0 0] T} = [a b; 0 1]: one logarithm gives both, also for poles at the origin.
    let m = b.ncols();
    let mut held = DMatrix::identity(r + m, r + m);
    held.view_mut((0, 0), (r, r)).copy_from(a);
    held.view_mut((0, r), (r, m)).copy_from(b);
    let log = logarithm::logarithm(&held)? / step;
    Some((log.view((0, 0), (r, r)).into_owned(), log.view((0, r), (r, m)).into_owned()))
}

/// Infers the ports of a simulation that declares none. If outputs measure the motion of the axes, there is a port on
/// the axis of each input and, in a structure, at each further position or velocity. Otherwise, the modes give a port
/// at each input and at the outputs that reciprocity reaches.
fn inferred(plant: &mut Plant, model: &Model) -> (Vec<Port>, PortSource) {
    if plant.modes.is_empty() {
        return (axis::infer(plant, &model.inputs, &model.output_kinds), PortSource::Axis);
    }
    match reciprocal::infer(plant, &model.inputs, &model.outputs) {
        Some(mut ports) => {
            ports.extend(joint::infer(plant, &ports));
            (ports, PortSource::Axis)
        }
        None => (ports::infer(plant, &model.inputs, &model.outputs), PortSource::Inferred),
    }
}

/// Returns (e^x - 1) / x.
pub(crate) fn phi1(x: C) -> C {
    if x.norm() < 1e-3 { C::ONE + x * (0.5 + x / 6.0 * (1.0 + x / 4.0)) } else { (x.exp() - 1.0) / x }
}

impl Plant {
    /// Moves a mode's pole and keeps its physical shapes. The mode obeys q" + 2 zeta w q' + w^2 q = b.a, where a are
    /// the outputs of the actuators, and before the filters an output measures a derivative of c q. The ports follow:
    /// their rows of the actuators' outputs, and their forces on the filters, depend on the pole, too.
    pub fn move_pole(&mut self, k: usize, pole: C) {
        let from = self.modes[k].pole;
        let rows = Carried::new(from, pole);
        let before: Vec<C> = (0..self.m).map(|i| self.chain.before(i, pole) / self.chain.before(i, from)).collect();
        let sensed: Vec<C> = self.sensed.iter().map(|&sensed| rows.sensed(sensed)).collect();
        let behind: Vec<C> = (0..self.p).map(|o| self.chain.behind(o, pole) / self.chain.behind(o, from)).collect();
        self.pass_ports(k, -1.0);
        self.change(k, |mode| {
            mode.pole = pole;
            mode.b.iter_mut().zip(before).for_each(|(b, ratio)| *b *= ratio);
            mode.c.iter_mut().zip(sensed.iter().zip(&behind)).for_each(|(c, (sensed, ratio))| *c *= sensed * ratio);
        });
        for port in &mut self.ports {
            port.displacement[k] *= rows.displacement;
            port.velocity[k] *= rows.velocity;
        }
        self.pass_ports(k, 1.0);
    }

    /// Changes a mode, and with it the mode's response through the poles of actuators and filters.
    pub fn change(&mut self, k: usize, change: impl FnOnce(&mut Mode)) {
        self.pass(k, -1.0);
        change(&mut self.modes[k]);
        self.pass(k, 1.0);
    }

    /// Adds a mode: q" + 2 zeta w q' + w^2 q = b.a, where a are the outputs of the actuators, and each output
    /// measures its derivative of c q.
    pub fn add_mode(&mut self, pole: C, b: &[f64], c: &[f64]) {
        // z' = pole z + b a, q = 2 Re(z / (pole - conj pole)).
        let scale = |o: usize| pole.powi(self.sensed[o].order_of_added()) / C::new(0.0, 2.0 * pole.im);
        self.modes.push(Mode {
            pole,
            b: b.iter().enumerate().map(|(i, b)| self.chain.before(i, pole) * *b).collect(),
            c: c.iter().enumerate().map(|(o, c)| self.chain.behind(o, pole) * scale(o) * *c).collect(),
        });
        for port in &mut self.ports {
            for modal in [&mut port.force, &mut port.displacement, &mut port.velocity] {
                modal.push(C::ZERO);
            }
        }
        self.pass(self.modes.len() - 1, 1.0);
    }

    /// Returns gamma_o beta_i of a mode in physical form: the product of its output and input shapes, without the
    /// actuator and the filter; zero for an output that measures no motion.
    pub fn product(&self, mode: &Mode, o: usize, i: usize) -> f64 {
        self.sensed[o].order().map_or(0.0, |order| self.product_of(mode, o, i, order))
    }

    /// Returns gamma_o beta_i of a mode for an output that measures a derivative of another order.
    fn product_of(&self, mode: &Mode, o: usize, i: usize, order: i32) -> f64 {
        let pole = mode.pole;
        let both = mode.c[o] * mode.b[i] / (self.chain.behind(o, pole) * self.chain.before(i, pole));
        (both * C::new(0.0, 2.0 * pole.im) / pole.powi(order)).re
    }

    /// Returns s^k / (s^2 + 2 zeta w s + w^2), the k-th derivative of a mode's displacement for a unit force.
    pub fn derivative(order: i32, pole: C, s: C) -> C {
        s.powi(order) / ((s - pole) * (s - pole.conj()))
    }

    /// Returns whether the paths from the modes to the outputs are known. Only then does a changed mode change the
    /// response through these paths.
    fn understood(&self) -> bool {
        self.chain.known() || self.sensed.iter().any(|s| s.source != KindSource::Assumed && s.is_motion())
    }

    /// Returns whether an output responds to a force at once, as an acceleration without a filter does.
    fn answers_at_once(&self, o: usize) -> bool {
        self.understood() && self.sensed[o].order() == Some(2) && self.chain.filter[o].is_empty()
    }

    /// Adds or subtracts a mode's response through the poles of actuators and filters, that is, its residues at these
    /// poles.
    fn pass(&mut self, k: usize, sign: f64) {
        if !self.understood() {
            return;
        }
        let gains = Passed::new(self, &self.modes[k]);
        for o in 0..self.p {
            for i in 0..self.m {
                if let Some(actuator) = &self.chain.actuator[i] {
                    let gain = sign * gains.actuator(self, o, i);
                    for (j, x) in actuator.row.iter().enumerate() {
                        self.rest.c[(o, j)] += gain * x;
                    }
                } else if self.answers_at_once(o) {
                    self.d[(o, i)] += sign * gains.products[(o, i)];
                }
                for (f, filter) in self.chain.filter[o].iter().enumerate() {
                    let gain = gains.filter(self, o, i, f) * sign;
                    let step = 1.0 / self.rate;
                    let held = ((filter.pole * step).exp() - 1.0) / filter.pole;
                    let both = if filter.pole.im == 0.0 { 1.0 } else { 2.0 };
                    for (j, v) in filter.column.iter().enumerate() {
                        self.rest.b[(j, i)] += both * (v * gain * held).re;
                        if let Some((_, b)) = &mut self.rest.continuous {
                            b[(j, i)] += both * (v * gain).re;
                        }
                    }
                }
            }
        }
        self.rest.renew_from(self.rest.seen(), 1.0 / self.rate);
    }
}

impl Plant {
    /// Returns the open-loop frequency response (p) to a force at a port that is held over each sample.
    fn open_port_response(&self, port: usize, hz: f64) -> DVector<C> {
        let z = C::cis(std::f64::consts::TAU * hz / self.rate);
        let port = &self.ports[port];
        let mut sum = DVector::from_fn(self.p, |o, _| C::from(port.output.get(o).copied().unwrap_or(0.0)));
        for (mode, force) in self.modes.iter().zip(&port.force) {
            let turn = (mode.pole / self.rate).exp();
            let held = (turn - 1.0) / mode.pole * force;
            for o in 0..self.p {
                let residue = mode.c[o] * held;
                sum[o] += residue / (z - turn) + residue.conj() / (z - turn.conj());
            }
        }
        let r = self.rest.seen();
        let Some((a, _)) = self.rest.continuous.as_ref().filter(|_| r > 0) else { return sum };
        let s = C::new(0.0, std::f64::consts::TAU * hz);
        let shifted = DMatrix::from_diagonal_element(r, r, s) - a.view((0, 0), (r, r)).map(C::from);
        if let Some(x) = shifted.lu().solve(&port.force_rest.rows(0, r).map(C::from)) {
            // The frequency response of the hold: a sinc and a delay of half a sample.
            let half = std::f64::consts::PI * hz / self.rate;
            let hold = if half > 0.0 { C::cis(-half) * (half.sin() / half) } else { C::ONE };
            sum += self.rest.c.columns(0, r).map(C::from) * x * hold;
        }
        sum
    }

    /// Returns the open-loop frequency response (p x m) for held inputs.
    fn open_response(&self, hz: f64) -> DMatrix<C> {
        let z = C::cis(std::f64::consts::TAU * hz / self.rate);
        let r = self.rest.seen();
        let mut sum = self.d.map(C::from);
        for mode in &self.modes {
            let turn = (mode.pole / self.rate).exp();
            let held = (turn - 1.0) / mode.pole;
            for i in 0..self.m {
                let b = held * mode.b[i];
                for o in 0..self.p {
                    let residue = mode.c[o] * b;
                    sum[(o, i)] += residue / (z - turn) + residue.conj() / (z - turn.conj());
                }
            }
        }
        if r > 0 {
            let shifted = DMatrix::from_diagonal_element(r, r, z) - self.rest.a.view((0, 0), (r, r)).map(C::from);
            if let Some(x) = shifted.lu().solve(&self.rest.b.rows(0, r).map(C::from)) {
                sum += self.rest.c.columns(0, r).map(C::from) * x;
            }
        }
        sum
    }
}

/// The response of a mode through the poles of actuators and filters.
pub(crate) struct Passed {
    pole: C,
    /// Products of output and input shapes (p x m).
    pub products: DMatrix<f64>,
}

impl Passed {
    pub(crate) fn new(plant: &Plant, mode: &Mode) -> Self {
        let products = DMatrix::from_fn(plant.p, plant.m, |o, i| plant.product(mode, o, i));
        Self { pole: mode.pole, products }
    }

    /// Returns the same shapes with another pole.
    pub(crate) fn at(&self, pole: C) -> Self {
        Self { pole, products: self.products.clone() }
    }

    /// Returns the gain from the actuator's output to an output, at the actuator's pole.
    pub(crate) fn actuator(&self, plant: &Plant, o: usize, i: usize) -> f64 {
        let (Some(actuator), Some(order)) = (&plant.chain.actuator[i], plant.sensed[o].order()) else { return 0.0 };
        let s = C::from(-actuator.pole);
        (plant.chain.behind(o, s) * Plant::derivative(order, self.pole, s)).re * self.products[(o, i)]
    }

    /// Returns the gain from the input to the filter's state, which the output observes with gain one.
    pub(crate) fn filter(&self, plant: &Plant, o: usize, i: usize, f: usize) -> C {
        let Some(order) = plant.sensed[o].order() else { return C::ZERO };
        let s = plant.chain.filter[o][f].pole;
        let through = plant.chain.before(i, s) * Plant::derivative(order, self.pole, s);
        plant.chain.residue(o, f) * through * self.products[(o, i)]
    }
}
