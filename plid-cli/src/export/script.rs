//! A Python module with the matrices of a model.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::DMatrix;
use plid::model::Model;

/// Longest line of numbers.
const WIDTH: usize = 110;

/// Returns the text of the module.
pub fn text(model: &Model, from: &Path) -> String {
    let name = from.file_name().unwrap_or(from.as_os_str()).to_string_lossy();
    // A file name must not end the string or the line.
    let name = name.replace(['"', '\\', '\n', '\r'], "_");
    let mut text = format!(
        "\"\"\"A linear model, written by `plid export` from {name}.\n\n\
         x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], with inputs that are held over a sample.\n\
         \"\"\"\n\nimport numpy as np\n\n"
    );
    let list = |names: &[String]| serde_json::to_string(names).unwrap_or_default();
    let _ = writeln!(text, "sample_rate_hz = {:?}", model.sample_rate_hz);
    let _ = writeln!(text, "inputs = {}\noutputs = {}", list(&model.inputs), list(&model.outputs));
    let optional = model.predictor_gain.as_ref().map(|gain| ("K", gain));
    for (name, of) in [("A", &model.a), ("B", &model.b), ("C", &model.c), ("D", &model.d)].into_iter().chain(optional) {
        text += &matrix(name, of);
    }
    text + SIMULATE
}

const SIMULATE: &str = r#"

def simulate(u, x=None):
    """Return the outputs (samples, p) for inputs (samples, m), from rest or from the state x (n)."""
    u = np.asarray(u, dtype=float).reshape(-1, B.shape[1])
    x = np.zeros(len(A)) if x is None else np.array(x, dtype=float)
    y = np.empty((len(u), len(C)))
    for k, u_k in enumerate(u):
        y[k] = C @ x + D @ u_k
        x = A @ x + B @ u_k
    return y


def to_scipy():
    """Return the model as a `scipy.signal.StateSpace`."""
    from scipy.signal import StateSpace

    return StateSpace(A, B, C, D, dt=1 / sample_rate_hz)


def to_control():
    """Return the model as a `control.StateSpace` of the package python-control."""
    import control

    return control.ss(A, B, C, D, 1 / sample_rate_hz, inputs=inputs, outputs=outputs)
"#;

/// Returns an array with all digits, row by row.
fn matrix(name: &str, of: &DMatrix<f64>) -> String {
    let mut text = format!("{name} = np.array([\n");
    for row in of.row_iter() {
        let mut line = "    ".to_string();
        for number in row.iter().map(|x| format!("{x:?}, ")) {
            if line.len() + number.len() > WIDTH {
                text += line.trim_end();
                text += "\n";
                line = "    ".into();
            }
            line += &number;
        }
        text += line.trim_end();
        text += "\n";
    }
    text + &format!("]).reshape({}, {})\n", of.nrows(), of.ncols())
}
