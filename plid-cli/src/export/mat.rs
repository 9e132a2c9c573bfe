//! MATLAB's format 5, without compression (*MAT-File Format*, The MathWorks, "Level 5 MAT-File Format").

use super::Variable;

/// The text at the start of a file, which other programs display.
const HEADER: &str = "MATLAB 5.0 MAT-file, written by plid: sys = ss(A, B, C, D, 1 / sample_rate_hz)";

/// Types of data elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;

/// Classes of arrays.
const CHAR: u8 = 4;
const NUMBERS: u8 = 6;

/// Returns the contents of a file with these variables.
pub fn file(variables: &[(&str, Variable)]) -> Vec<u8> {
    let mut bytes = format!("{HEADER:<124}").into_bytes();
    // Version 1, then the letters that show the order of bytes.
    bytes.extend([0x00, 0x01]);
    bytes.extend(b"IM");
    for (name, variable) in variables {
        bytes.extend(array(name, variable));
    }
    bytes
}

fn array(name: &str, variable: &Variable) -> Vec<u8> {
    let numbers = |values: &[f64]| element(DOUBLE, &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>());
    let (class, [rows, columns], data) = match variable {
        Variable::Matrix(matrix) => (NUMBERS, [matrix.nrows(), matrix.ncols()], numbers(matrix.as_slice())),
        Variable::Vector(vector) => (NUMBERS, [1, vector.len()], numbers(vector.as_slice())),
        Variable::Number(number) => (NUMBERS, [1, 1], numbers(&[*number])),
        Variable::Text(text) => {
            let units: Vec<u16> = text.encode_utf16().collect();
            let data = element(UINT16, &units.iter().flat_map(|unit| unit.to_le_bytes()).collect::<Vec<_>>());
            (CHAR, [1, units.len()], data)
        }
    };
    let mut flags = [0; 8];
    flags[0] = class;
    let sizes: Vec<u8> = [rows, columns].iter().flat_map(|size| (*size as i32).to_le_bytes()).collect();
    let parts = [element(UINT32, &flags), element(INT32, &sizes), element(INT8, name.as_bytes()), data];
    element(MATRIX, &parts.concat())
}

/// Returns a data element: type, number of bytes, and the bytes up to a multiple of eight.
fn element(of: u32, bytes: &[u8]) -> Vec<u8> {
    let mut all = [of.to_le_bytes(), (bytes.len() as u32).to_le_bytes()].concat();
    all.extend(bytes);
    all.resize(all.len().next_multiple_of(8), 0);
    all
}
