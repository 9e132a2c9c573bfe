//! Delimited text such as CSV, with or without a header.
//!
//! Lines are split here rather than by a CSV library, because errors must name the line past any
//! comments, and because blanks in runs are one separator.
use super::DataError;
use super::table::Content;
use ndarray::Array2;
use std::collections::BTreeMap;
use std::path::Path;

/// The separator between two cells.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Separator {
    Mark(char),
    Blanks,
}

/// A line that is neither blank nor a comment, with its number in the file.
struct Line<'a> {
    number: usize,
    text: &'a str,
}

/// Reads delimited text.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Content, DataError> {
    if bytes.contains(&0) {
        return Err(DataError::Malformed {
            file: path.into(),
            what: "neither text nor a format known here (.csv, .mat v4 or v5, .npz, .npy)".into(),
        });
    }
    // Old instruments write Latin-1, where every byte is a character.
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.trim_start_matches('\u{feff}').to_owned(),
        Err(_) => bytes.iter().map(|&byte| byte as char).collect(),
    };
    let lines: Vec<Line> = text
        .lines()
        .enumerate()
        .map(|(k, text)| Line { number: k + 1, text })
        .filter(|line| {
            let text = line.text.trim();
            !text.is_empty() && !is_comment(text)
        })
        .collect();
    let Some(first) = lines.first() else {
        return Err(DataError::Empty { file: path.into() });
    };
    let separator = separator_of(first.text);
    let decimal_comma = separator != Separator::Mark(',');
    let mut first_cells = split(first.text, separator);
    drop_trailing_empty(&mut first_cells);
    let has_header = is_header(&lines, separator, decimal_comma);
    let names: Vec<String> = first_cells
        .iter()
        .enumerate()
        .map(|(i, cell)| if has_header && !cell.is_empty() { cell.clone() } else { (i + 1).to_string() })
        .collect();
    let rows = &lines[usize::from(has_header)..];
    if rows.is_empty() {
        return Err(DataError::NoSamples { file: path.into() });
    }
    let cells = rows.iter().map(|line| row(path, line, separator, &names)).collect::<Result<Vec<_>, _>>()?;
    check_widths(path, rows, &cells, names.len())?;
    let content = assemble(names, &cells, rows);
    // Each column may have turned out to be a scalar.
    if content.names.is_empty() { Err(DataError::NoSamples { file: path.into() }) } else { Ok(content) }
}

/// A remark begins with `#`; a row whose first cell is an error of a spreadsheet (`#N/A`, `#DIV/0!`, `#VALUE!`) does
/// not.
fn is_comment(text: &str) -> bool {
    const ERRORS: [&str; 8] = ["#n/a", "#na", "#div/0!", "#value!", "#ref!", "#name?", "#num!", "#null!"];
    let first = text.trim_start_matches('"').split([',', ';', '\t', ' ', '"']).next().unwrap_or_default();
    text.starts_with('#') && !ERRORS.contains(&first.to_lowercase().as_str())
}

/// Returns whether the first line is a header. A cell that is not a number is a name. Numbers in quotes are names if
/// those below them are not in quotes (plid writes such names itself); if every row is in quotes, they are numbers.
fn is_header(lines: &[Line], separator: Separator, decimal_comma: bool) -> bool {
    let first = lines[0].text;
    let is_quoted = |line: &Line| line.text.contains('"');
    split(first, separator).iter().any(|cell| number(cell, decimal_comma).is_none())
        || (first.contains('"') && !lines.get(1).is_some_and(is_quoted))
}

/// The separator of a file, from its first line outside of quotes.
///
/// A semicolon comes before a tab, a tab before a comma: a comma may stand inside of numbers
/// where another mark separates them. A comma at the end of a cell, though, separates.
fn separator_of(line: &str) -> Separator {
    let mut quoted = false;
    let bare: String = line
        .chars()
        .filter(|&c| {
            quoted ^= c == '"';
            !quoted
        })
        .collect();
    let comma_ends_a_cell = bare.trim_end().split('\t').any(|cell| cell.trim_end().ends_with(','));
    if bare.contains(';') {
        Separator::Mark(';')
    } else if bare.trim().contains('\t') && !comma_ends_a_cell {
        Separator::Mark('\t')
    } else if bare.contains(',') {
        Separator::Mark(',')
    } else {
        Separator::Blanks
    }
}

/// The cells of a line, trimmed and without quotes; a doubled quote within quotes is one.
fn split(line: &str, separator: Separator) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.trim_end_matches(['\r', '\n']).chars().peekable();
    while let Some(c) = characters.next() {
        let separates = !quoted
            && match separator {
                Separator::Mark(mark) => c == mark,
                Separator::Blanks => c.is_whitespace(),
            };
        if separates {
            cells.push(String::new());
        } else if c == '"' && quoted && characters.peek() == Some(&'"') {
            characters.next();
            cells.last_mut().expect("never empty").push('"');
        } else if c == '"' {
            quoted = !quoted;
        } else {
            cells.last_mut().expect("never empty").push(c);
        }
    }
    if separator == Separator::Blanks {
        cells.retain(|cell| !cell.is_empty());
    }
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

fn drop_trailing_empty(cells: &mut Vec<String>) {
    if cells.len() > 1 && cells.last().is_some_and(String::is_empty) {
        cells.pop();
    }
}

/// Parses a cell: `None` if it is not a number, NaN if it is empty.
fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    if cell.is_empty() {
        return Some(f64::NAN);
    }
    if let Ok(value) = cell.parse() {
        return Some(value);
    }
    if decimal_comma && cell.matches(',').count() == 1 && !cell.contains('.') {
        return cell.replace(',', ".").parse().ok();
    }
    // Fortran writes 1.0D+00.
    let exponent = cell.find(['d', 'D'])?;
    let digits_around = cell[..exponent].ends_with(|c: char| c.is_ascii_digit() || c == '.');
    digits_around.then(|| cell.replacen(['d', 'D'], "e", 1).parse().ok()).flatten()
}

/// The cells of a row: `None` where a cell is empty.
fn row(path: &Path, line: &Line, separator: Separator, names: &[String]) -> Result<Vec<Option<f64>>, DataError> {
    let mut cells = split(line.text, separator);
    if cells.len() == names.len() + 1 {
        drop_trailing_empty(&mut cells);
    }
    cells
        .iter()
        .enumerate()
        .map(|(i, cell)| match number(cell, separator != Separator::Mark(',')) {
            Some(_) if cell.is_empty() => Ok(None),
            Some(value) => Ok(Some(value)),
            None => Err(DataError::NotANumber {
                file: path.into(),
                line: line.number,
                column: names.get(i).cloned().unwrap_or_else(|| (i + 1).to_string()),
                cell: cell.chars().take(40).collect(),
            }),
        })
        .collect()
}

/// Every row is as wide as the names, or else all rows after the first lack the same last
/// cells: those columns then have a value in their first row only.
fn check_widths(path: &Path, lines: &[Line], rows: &[Vec<Option<f64>>], expected: usize) -> Result<(), DataError> {
    let first_row_only = rows.len() > 2
        && rows[0].len() == expected
        && rows[1].len() < expected
        && rows[2..].iter().all(|row| row.len() == rows[1].len());
    if first_row_only {
        return Ok(());
    }
    match rows.iter().position(|row| row.len() != expected) {
        None => Ok(()),
        Some(k) => Err(DataError::Ragged { file: path.into(), line: lines[k].number, expected, found: rows[k].len() }),
    }
}

fn assemble(names: Vec<String>, rows: &[Vec<Option<f64>>], lines: &[Line]) -> Content {
    let cell = |k: usize, i: usize| rows[k].get(i).copied().flatten();
    let is_scalar = |i: usize| rows.len() > 1 && cell(0, i).is_some() && (1..rows.len()).all(|k| cell(k, i).is_none());
    let (scalar_columns, kept): (Vec<usize>, Vec<usize>) = (0..names.len()).partition(|&i| is_scalar(i));
    let scalars: BTreeMap<String, f64> =
        scalar_columns.iter().filter_map(|&i| Some((names[i].clone(), cell(0, i)?))).collect();
    Content {
        names: kept.iter().map(|&i| names[i].clone()).collect(),
        columns: Array2::from_shape_fn((rows.len(), kept.len()), |(k, i)| cell(k, kept[i]).unwrap_or(f64::NAN)),
        scalars,
        lines: lines.iter().map(|line| line.number).collect(),
        notes: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn parse(text: &str) -> Result<Content, DataError> {
        read(Path::new("x.csv"), text.as_bytes())
    }

    #[test]
    fn every_separator_gives_the_same_table() {
        let expected = array![[1.0, -2.5], [3.0, 4e-3], [5.0, 6.0]];
        for text in [
            "u1,y 1\n1,-2.5\n3,4e-3\n5,6\n",
            "u1;y 1\n1;-2.5\n3;4e-3\n5;6",
            "u1;y 1\n1;-2,5\n3;4e-3\n5;6\n",
            "u1\ty 1\n1\t-2.5\n3\t4e-3\n5\t6\n",
            "u1,\ty 1\n1,\t-2.5\n3,\t4e-3\n5,\t6\n",
            "u1 \"y 1\"\n 1   -2.5\n3 4.0D-03\n\t5 6  \n",
            "\u{feff}\"u1\" , \"y 1\",\r\n1,-2.5,\r\n3,4e-3,\r\n5,6,\r\n",
            "# said by\nu1,y 1\n\n1,-2.5\n  # a remark\n3,4e-3\n5,6\n\n",
        ] {
            let content = parse(text).unwrap();
            assert_eq!(content.names, ["u1", "y 1"], "{text:?}");
            assert_eq!(content.columns, expected, "{text:?}");
            assert!(content.scalars.is_empty());
        }
    }

    #[test]
    fn without_a_header_columns_are_numbered() {
        for text in ["1 2\n3 4\n", "  1\t 2\n  3\t 4\n", "1,5;2\n3;4\n", "1,2,\n3,4,\n"] {
            let content = parse(text).unwrap();
            assert_eq!(content.names, ["1", "2"]);
            assert_eq!(content.columns.row(1).to_vec(), [3.0, 4.0]);
        }
    }

    #[test]
    fn quoted_rows_without_a_header_lose_none() {
        let content = parse("\"1\",\"2\"\n\"3\",\"4\"\n\"5\",\"6\"\n").unwrap();
        assert_eq!(content.names, ["1", "2"]);
        assert_eq!(content.columns, array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]);
        // Names that are numbers, above numbers without quotes.
        let content = parse("\"2\",\"1\"\n3,4\n5,6\n").unwrap();
        assert_eq!(content.names, ["2", "1"]);
        assert_eq!(content.columns, array![[3.0, 4.0], [5.0, 6.0]]);
    }

    #[test]
    fn a_row_that_begins_with_an_error_of_a_spreadsheet_is_no_comment() {
        for wrong in ["#N/A", "#DIV/0!", "#n/a"] {
            let said = parse(&format!("u,y\n1,2\n{wrong},3\n4,5\n")).err().unwrap().to_string();
            assert_eq!(said, format!("x.csv, line 3, column `u`: `{wrong}` is not a number"));
        }
        assert_eq!(parse("#u,y\n# N/A\nu,y\n1,2\n3,4\n").unwrap().names, ["u", "y"]);
    }

    #[test]
    fn a_value_in_the_first_row_only_is_a_scalar() {
        for text in
            ["u,y,Fs,\n1,2,400,\n3,4,,\n5,6,,\n", "u,y,Fs\n1,2,400\n3,4\n5,6\n", "Fs,u,y\n400,1,2\n,3,4\n,5,6\n"]
        {
            let content = parse(text).unwrap();
            assert_eq!(content.names, ["u", "y"], "{text:?}");
            assert_eq!(content.scalars["Fs"], 400.0);
            assert_eq!(content.columns, array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]);
        }
    }

    #[test]
    fn missing_and_infinite_cells_are_kept() {
        let content = parse("u,y,z\n1,,nan\n-inf,2,3\nNaN,Inf,4\n").unwrap();
        assert!(content.columns[[0, 1]].is_nan() && content.columns[[0, 2]].is_nan());
        assert_eq!(content.columns[[1, 0]], f64::NEG_INFINITY);
        assert_eq!(content.columns[[2, 1]], f64::INFINITY);
        // A sensor that fails from the second sample on says NaN: that is not a scalar.
        assert_eq!(parse("u,y\n1,2\n3,nan\n4,nan\n").unwrap().names, ["u", "y"]);
    }

    #[test]
    fn ragged_rows_name_the_line_past_comments() {
        let Err(error) = parse("# c\nu,y\n1,2\n# c\n\n3\n4,5\n6,7\n") else {
            panic!("a ragged file was read");
        };
        assert_eq!(error.to_string(), "x.csv, line 6: 1 cells where 2 are expected");
        assert!(matches!(parse("u,y\n1,2\n3,4,5\n"), Err(DataError::Ragged { line: 3, expected: 2, found: 3, .. })));
    }

    #[test]
    fn words_among_numbers_name_line_and_column() {
        for (text, said) in [
            ("u,y\n1,2\n3,off\n", "x.csv, line 3, column `y`: `off` is not a number"),
            ("u;y\n1;1,234.5\n", "x.csv, line 2, column `y`: `1,234.5` is not a number"),
            ("1 2\n3 4d\n", "x.csv, line 2, column `2`: `4d` is not a number"),
        ] {
            assert_eq!(parse(text).err().unwrap().to_string(), said);
        }
    }

    #[test]
    fn nothing_to_read_is_said() {
        assert!(matches!(parse(" \n# only a remark\n"), Err(DataError::Empty { .. })));
        assert!(matches!(parse("u,y\n"), Err(DataError::NoSamples { .. })));
        // A column with a value in its first row only is a scalar.
        assert!(matches!(parse("0,\n,"), Err(DataError::NoSamples { .. })));
        assert!(matches!(parse("a\0b"), Err(DataError::Malformed { .. })));
    }

    #[test]
    fn latin_1_names_are_read() {
        let content = read(Path::new("x"), b"a [m/s\xb2],b\n1,2\n").unwrap();
        assert_eq!(content.names[0], "a [m/s\u{b2}]");
    }
}
