use nalgebra::{DMatrix, DVector};
use serde_json::{Map, Value};

use super::error::{KeyProblem, ModelError};

/// Largest entry of A. Balancing does not terminate if squares overflow.
pub(super) const LARGEST: f64 = 1e100;

/// Standard deviations of the measurement noise, in the channels' units.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Noise {
    /// One for each output (p), if known.
    pub sensor_std: Option<Vec<f64>>,
    /// One for each input (m), if known.
    pub actuator_std: Option<Vec<f64>>,
}

/// The continuous-time model with the same states: dx/dt = A x + B u, with the C and D of the discrete model.
#[derive(Debug, Clone, PartialEq)]
pub struct Continuous {
    /// The state matrix A (n x n), in 1/s.
    pub a: DMatrix<f64>,
    /// The input matrix B (n x m), in 1/s.
    pub b: DMatrix<f64>,
}

/// The quantity that an output measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutputKind {
    /// A displacement or an angle.
    Position,
    /// Its first derivative.
    Velocity,
    /// Its second derivative.
    Acceleration,
    /// A force or a torque.
    Force,
    /// Anything else, such as a temperature or a voltage.
    Other,
}

impl OutputKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Position, Self::Velocity, Self::Acceleration, Self::Force, Self::Other];

    /// Returns the name of the kind, as in model.json.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Force => "force",
            Self::Other => "other",
        }
    }
}

/// A port: a pair of points between which an internal force may act.
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    /// The name of the port.
    pub name: String,
    /// The input that acts at the same port, if any.
    pub input: Option<String>,
    /// The contribution of a unit force to dx/dt (n).
    pub force: Vec<f64>,
    /// The row that maps the state to the displacement across the port (n).
    pub displacement: Vec<f64>,
    /// The row that maps the state to the velocity across the port (n).
    pub velocity: Vec<f64>,
    /// The direct contribution of a unit force to y (p), if any.
    pub output: Option<Vec<f64>>,
}

/// A linear model in discrete time: x_{k+1} = A x_k + B u_k, y_k = C x_k + D u_k, with a zero-order hold on the inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Sample rate in Hz.
    pub sample_rate_hz: f64,
    /// Names of the inputs (m).
    pub inputs: Vec<String>,
    /// Names of the outputs (p).
    pub outputs: Vec<String>,
    /// The state matrix A (n x n).
    pub a: DMatrix<f64>,
    /// The input matrix B (n x m).
    pub b: DMatrix<f64>,
    /// The output matrix C (p x n).
    pub c: DMatrix<f64>,
    /// The feedthrough matrix D (p x m).
    pub d: DMatrix<f64>,
    /// The known properties of the measurement noise.
    pub noise: Noise,
    /// The steady-state predictor gain K (n x p): x_{k+1} = A x_k + B u_k + K e_k.
    pub predictor_gain: Option<DMatrix<f64>>,
    /// Observability indices (p of them, with sum n), if A and C are in observable canonical form.
    pub observability_indices: Option<Vec<usize>>,
    /// Covariance of the parameters [a_1; ..; a_p; b_1; ..; b_m], a square matrix of size (p + m) n
    /// (docs/mathematics.md, "The plant").
    pub parameter_covariance: Option<DMatrix<f64>>,
    /// State at the first sample (n).
    pub initial_state: Option<DVector<f64>>,
    /// Free-form record of the model's origin, for the program that writes it.
    pub provenance: Option<Map<String, Value>>,
    /// The continuous-time model with the same states.
    pub continuous: Option<Continuous>,
    /// The ports at which an internal force may act.
    pub ports: Vec<Port>,
    /// The quantity that each output measures (p), where it is declared.
    pub output_kinds: Vec<Option<OutputKind>>,
}

impl Model {
    /// Creates a model from its four matrices, with channels named u1, u2, ... and y1, y2, ...
    ///
    /// # Errors
    /// Returns the errors of [`Model::check`].
    pub fn new(
        sample_rate_hz: f64,
        a: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        d: DMatrix<f64>,
    ) -> Result<Self, ModelError> {
        let output_kinds = vec![None; c.nrows()];
        let model = Self {
            sample_rate_hz,
            inputs: (1..=b.ncols()).map(|j| format!("u{j}")).collect(),
            outputs: (1..=c.nrows()).map(|i| format!("y{i}")).collect(),
            a,
            b,
            c,
            d,
            noise: Noise::default(),
            predictor_gain: None,
            observability_indices: None,
            parameter_covariance: None,
            initial_state: None,
            provenance: None,
            continuous: None,
            ports: Vec::new(),
            output_kinds,
        };
        model.check("the model")?;
        Ok(model)
    }

    /// Returns the number of states.
    pub fn n(&self) -> usize {
        self.a.nrows()
    }

    /// Returns the number of inputs.
    pub fn m(&self) -> usize {
        self.inputs.len()
    }

    /// Returns the number of outputs.
    pub fn p(&self) -> usize {
        self.outputs.len()
    }

    /// Returns the zero state (n).
    pub fn rest(&self) -> DVector<f64> {
        DVector::zeros(self.n())
    }

    /// Checks sizes, finiteness and channel names; `place` is the name of the model in an error message.
    ///
    /// # Errors
    /// Returns [`ModelError::Key`] with the first invalid key.
    pub fn check(&self, place: &str) -> Result<(), ModelError> {
        self.first_problem().map_or(Ok(()), |(key, problem)| Err(at(place, key, problem)))
    }

    fn first_problem(&self) -> Option<(String, KeyProblem)> {
        let (n, m, p) = (self.n(), self.m(), self.p());
        let rate = self.sample_rate_hz;
        // At a rate of 1e-320 Hz, the sampling interval would be infinite.
        if !(rate.is_finite() && rate > 0.0 && (1.0 / rate).is_finite()) {
            let expected = "positive and finite";
            let problem = KeyProblem::Range { value: rate, expected };
            return Some(("sample_rate_hz".into(), problem));
        }
        names_problem("inputs", &self.inputs)
            .or_else(|| names_problem("outputs", &self.outputs))
            .or_else(|| dynamics_problem("A", &self.a, n.max(1)))
            .or_else(|| matrix_problem("B", &self.b, (n, m)))
            .or_else(|| matrix_problem("C", &self.c, (p, n)))
            .or_else(|| matrix_problem("D", &self.d, (p, m)))
            .or_else(|| std_problem("noise.sensor_std", self.noise.sensor_std.as_deref(), p))
            .or_else(|| std_problem("noise.actuator_std", self.noise.actuator_std.as_deref(), m))
            .or_else(|| {
                let gain = self.predictor_gain.as_ref()?;
                matrix_problem("predictor_gain", gain, (n, p))
            })
            .or_else(|| self.indices_problem())
            .or_else(|| self.covariance_problem())
            .or_else(|| {
                let state = self.initial_state.as_ref()?;
                list_problem("initial_state", state.as_slice(), n)
            })
            .or_else(|| {
                let continuous = self.continuous.as_ref()?;
                dynamics_problem("continuous.A", &continuous.a, n)
                    .or_else(|| matrix_problem("continuous.B", &continuous.b, (n, m)))
            })
            .or_else(|| self.ports.iter().enumerate().find_map(|(i, port)| self.port_problem(i, port)))
    }

    fn indices_problem(&self) -> Option<(String, KeyProblem)> {
        let indices = self.observability_indices.as_ref()?;
        let key = "observability_indices".to_string();
        if indices.len() != self.p() {
            return Some((key, wrong_shape((self.p(), 1), (indices.len(), 1))));
        }
        let sum = indices.iter().try_fold(0_usize, |sum, &index| sum.checked_add(index));
        if indices.contains(&0) || sum != Some(self.n()) {
            let expected = "p positive integers whose sum is the number of states";
            return Some((key, KeyProblem::Kind { expected }));
        }
        None
    }

    fn covariance_problem(&self) -> Option<(String, KeyProblem)> {
        let covariance = self.parameter_covariance.as_ref()?;
        let key = "parameter_covariance";
        let size = (self.p() + self.m()) * self.n();
        matrix_problem(key, covariance, (size, size)).or_else(|| {
            let worst = covariance.diagonal().min();
            let expected = "zero or positive on the diagonal";
            (worst < 0.0).then(|| {
                let value = worst;
                (key.to_string(), KeyProblem::Range { value, expected })
            })
        })
    }

    fn port_problem(&self, index: usize, port: &Port) -> Option<(String, KeyProblem)> {
        let key = |name: &str| format!("ports[{index}].{name}");
        let n = self.n();
        list_problem(&key("force"), &port.force, n)
            .or_else(|| list_problem(&key("displacement"), &port.displacement, n))
            .or_else(|| list_problem(&key("velocity"), &port.velocity, n))
            .or_else(|| list_problem(&key("output"), port.output.as_deref()?, self.p()))
            .or_else(|| {
                let name = port.input.clone()?;
                let problem = KeyProblem::UnknownChannel { name: name.clone() };
                (!self.inputs.contains(&name)).then(|| (key("input"), problem))
            })
    }
}

/// Checks a matrix whose eigenvalues are computed.
fn dynamics_problem(key: &str, matrix: &DMatrix<f64>, n: usize) -> Option<(String, KeyProblem)> {
    matrix_problem(key, matrix, (n, n)).or_else(|| {
        let value = matrix.amax();
        let expected = "at most 1e100 in every entry, because squares of larger ones overflow";
        (value > LARGEST).then(|| (key.to_string(), KeyProblem::Range { value, expected }))
    })
}

/// Returns the error of a key.
pub(super) fn at(place: &str, key: impl Into<String>, problem: KeyProblem) -> ModelError {
    ModelError::Key { place: place.to_string(), key: key.into(), problem }
}

fn wrong_shape(expected: (usize, usize), found: (usize, usize)) -> KeyProblem {
    KeyProblem::Shape { expected, found }
}

fn names_problem(key: &str, names: &[String]) -> Option<(String, KeyProblem)> {
    if names.is_empty() {
        let expected = "a list of at least one name";
        return Some((key.to_string(), KeyProblem::Kind { expected }));
    }
    let twice = (1..names.len()).find(|&i| names[..i].contains(&names[i]))?;
    let name = names[twice].clone();
    Some((key.to_string(), KeyProblem::Duplicate { name }))
}

fn matrix_problem(key: &str, matrix: &DMatrix<f64>, expected: (usize, usize)) -> Option<(String, KeyProblem)> {
    if matrix.shape() != expected {
        return Some((key.to_string(), wrong_shape(expected, matrix.shape())));
    }
    let position = matrix.iter().position(|x| !x.is_finite())?;
    let (row, column) = (position % expected.0, position / expected.0);
    Some((format!("{key}[{row}][{column}]"), KeyProblem::NotFinite))
}

fn list_problem(key: &str, list: &[f64], expected: usize) -> Option<(String, KeyProblem)> {
    if list.len() != expected {
        return Some((key.to_string(), wrong_shape((expected, 1), (list.len(), 1))));
    }
    let position = list.iter().position(|x| !x.is_finite())?;
    Some((format!("{key}[{position}]"), KeyProblem::NotFinite))
}

fn std_problem(key: &str, list: Option<&[f64]>, expected: usize) -> Option<(String, KeyProblem)> {
    let list = list?;
    list_problem(key, list, expected).or_else(|| {
        let position = list.iter().position(|&x| x < 0.0)?;
        let (value, expected) = (list[position], "zero or positive");
        Some((format!("{key}[{position}]"), KeyProblem::Range { value, expected }))
    })
}
