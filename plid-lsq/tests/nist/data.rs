//! Reads the data files as NIST publishes them.

/// A problem's data, starting points and certified answer.
pub struct Certified {
    /// The response, one entry per observation.
    pub y: Vec<f64>,
    /// The predictors, one row per observation.
    pub x: Vec<Vec<f64>>,
    pub starts: [Vec<f64>; 2],
    pub parameters: Vec<f64>,
    /// The standard deviations of the parameters.
    pub std: Vec<f64>,
    pub sum_of_squares: f64,
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().filter_map(|word| word.parse().ok()).collect()
}

/// The text after `b3 =`; `None` for any other line.
fn parameter(line: &str) -> Option<&str> {
    let (name, values) = line.split_once('=')?;
    let number = name.trim().strip_prefix('b')?;
    number.parse::<usize>().is_ok().then_some(values)
}

impl Certified {
    pub fn read(name: &str) -> Self {
        let path = format!("{}/tests/nist/data/{name}.dat", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).unwrap();
        let (head, rows) = text.rsplit_once("Data:").unwrap();
        let column = |k: usize| head.lines().filter_map(parameter).map(|values| numbers(values)[k]).collect();
        let sum = head.lines().find_map(|line| line.strip_prefix("Residual Sum of Squares:")).unwrap();
        let rows: Vec<Vec<f64>> = rows.lines().map(numbers).filter(|row| row.len() > 1).collect();
        // Nelson's model is stated for the logarithm of the response.
        let response = |y: f64| if name == "Nelson" { y.ln() } else { y };
        Self {
            y: rows.iter().map(|row| response(row[0])).collect(),
            x: rows.iter().map(|row| row[1..].to_vec()).collect(),
            starts: [column(0), column(1)],
            parameters: column(2),
            std: column(3),
            sum_of_squares: numbers(sum)[0],
        }
    }
}
