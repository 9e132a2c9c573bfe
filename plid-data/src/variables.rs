//! Several named arrays of one file as one table.
use super::error::nearest;
use super::table::Content;
use super::{DataError, Warning};
use ndarray::{Array2, Ix2};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// A named array. With at most two dimensions, it is a scalar, a column or a matrix; other arrays are only named to the
/// user.
pub(super) struct Variable {
    pub name: String,
    pub shape: Vec<usize>,
    /// The values with samples as rows, or a description of a variable that cannot be a table.
    pub matrix: Result<Array2<f64>, &'static str>,
}

impl Variable {
    /// Makes a variable from real numbers. The samples of a vector become rows; with `row_is_vector`, an array of one
    /// row is a vector, too.
    pub fn new(name: String, values: ndarray::ArrayD<f64>, row_is_vector: bool) -> Self {
        let shape = values.shape().to_vec();
        let matrix = match shape.as_slice() {
            [] => values.into_shape_with_order((1, 1)),
            [_] => {
                let samples = values.len();
                values.into_shape_with_order((samples, 1))
            }
            [1, _] if row_is_vector => values.into_dimensionality::<Ix2>().map(|m| m.reversed_axes()),
            _ => values.into_dimensionality::<Ix2>(),
        };
        Self { name, shape, matrix: matrix.map_err(|_| "an array of more than two dimensions") }
    }

    /// Makes a variable that can only be named; `what` describes it.
    pub fn unusable(name: String, shape: Vec<usize>, what: &'static str) -> Self {
        Self { name, shape, matrix: Err(what) }
    }

    fn describe(&self) -> String {
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        let mut notes = vec![shape.join(" x ")];
        notes.retain(|shape| !shape.is_empty());
        if let Err(what) = self.matrix {
            notes.push(what.into());
        }
        if notes.is_empty() {
            notes.push("scalar".into());
        }
        format!("`{}` ({})", self.name, notes.join(", "))
    }
}

/// Makes one table from the variables of a file.
///
/// Variables of one element are scalars. All others, or only the chosen one, must have the same number of rows. A
/// single matrix has numbered columns. Otherwise, a vector has its own name, and the columns of a matrix `y` are `y1`,
/// `y2`, ...
pub(super) fn assemble(path: &Path, mut variables: Vec<Variable>, choice: Option<&str>) -> Result<Content, DataError> {
    let there = || {
        let all: Vec<String> = variables.iter().map(Variable::describe).collect();
        all.join(", ")
    };
    let mut seen = HashSet::new();
    if let Some(twice) = variables.iter().find(|variable| !seen.insert(&variable.name)) {
        let what = format!("two variables are named `{}`", twice.name);
        return Err(DataError::Malformed { file: path.into(), what });
    }
    // If one variable is chosen, the user did not ask for the others.
    let notes = if choice.is_some() { Vec::new() } else { unused(path, &variables) };
    let mut scalars = BTreeMap::new();
    let mut parts: Vec<(usize, &str, &Array2<f64>)> = Vec::new();
    for (number, variable) in variables.iter().enumerate() {
        match &variable.matrix {
            Ok(matrix) if matrix.len() == 1 => {
                scalars.insert(variable.name.clone(), matrix[[0, 0]]);
            }
            Ok(matrix) if !matrix.is_empty() => parts.push((number, &variable.name, matrix)),
            _ => {}
        }
    }
    if let Some(choice) = choice {
        parts.retain(|(_, name, _)| *name == choice);
        if parts.is_empty() {
            return Err(DataError::UnknownVariable {
                file: path.into(),
                variable: choice.into(),
                there: there(),
                suggestion: nearest(choice, variables.iter().map(|v| &v.name)),
            });
        }
    }
    let Some(samples) = parts.first().map(|(_, _, matrix)| matrix.nrows()) else {
        return Err(DataError::Malformed {
            file: path.into(),
            what: if variables.is_empty() {
                "there is no variable in it".into()
            } else {
                format!("there is no matrix or vector of real numbers in it, only {}", there())
            },
        });
    };
    if parts.iter().any(|(_, _, matrix)| matrix.nrows() != samples) {
        return Err(DataError::ChooseVariable { file: path.into(), there: there() });
    }
    let names = column_names(&parts);
    let columns = match parts.as_slice() {
        // A single matrix is moved and not copied, because it may take most of the memory.
        &[(number, ..)] => std::mem::replace(&mut variables[number].matrix, Err("")),
        _ => {
            let views: Vec<_> = parts.iter().map(|(_, _, matrix)| matrix.view()).collect();
            ndarray::concatenate(ndarray::Axis(1), &views).map_err(|_| "of different lengths")
        }
    };
    let columns = columns.map_err(|what| DataError::Malformed { file: path.into(), what: what.into() })?;
    Ok(Content { names, columns, scalars, lines: Vec::new(), notes })
}

fn column_names(parts: &[(usize, &str, &Array2<f64>)]) -> Vec<String> {
    let alone = parts.len() == 1;
    parts
        .iter()
        .flat_map(|(_, name, matrix)| {
            let columns = matrix.ncols();
            (1..=columns).map(move |i| match (alone, columns) {
                (_, 1) => (*name).to_string(),
                (true, _) => i.to_string(),
                (false, _) => format!("{name}{i}"),
            })
        })
        .collect()
}

fn unused(path: &Path, variables: &[Variable]) -> Vec<Warning> {
    let unused = |variable: &Variable| {
        let what = variable.matrix.as_ref().err()?.to_string();
        Some(Warning::UnusedVariable { file: path.display().to_string(), variable: variable.name.clone(), what })
    };
    variables.iter().filter_map(unused).collect()
}
