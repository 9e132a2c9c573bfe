//! Delimited text such as CSV, with or without a header.
//!
//! Lines are split here rather than by a CSV library, because errors must give the number of the line in the file,
//! comments included, and because a run of blanks is one separator.
use super::DataError;
use super::table::Content;
use ndarray::{Array2, Axis};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::io::BufRead;
use std::path::{Path, PathBuf};

/// Number of rows that are read before the first one is returned, to find the columns that are scalars.
const AHEAD: usize = 1000;

/// The separator between two cells.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Separator {
    Mark(char),
    Blanks,
}

/// A line that is neither blank nor a comment, with its number in the file.
struct Line {
    number: usize,
    text: String,
}

/// The lines of a text that are neither blank nor comments.
struct Lines<R> {
    file: PathBuf,
    text: R,
    /// Number of the last line.
    number: usize,
    bytes: Vec<u8>,
}

impl<R: BufRead> Lines<R> {
    fn next(&mut self) -> Result<Option<Line>, DataError> {
        loop {
            self.bytes.clear();
            let read = self.text.read_until(b'\n', &mut self.bytes);
            if read.map_err(|source| DataError::Io { file: self.file.clone(), source })? == 0 {
                return Ok(None);
            }
            self.number += 1;
            if self.bytes.contains(&0) {
                return Err(DataError::Malformed {
                    file: self.file.clone(),
                    what: "neither text nor a format known here (.csv, .mat v4 or v5, .npz, .npy)".into(),
                });
            }
            let text = decode(&self.bytes);
            let text = if self.number == 1 { text.trim_start_matches('\u{feff}') } else { &text };
            let bare = text.trim();
            if !bare.is_empty() && !is_comment(bare) {
                return Ok(Some(Line { number: self.number, text: text.trim_end_matches(['\r', '\n']).to_owned() }));
            }
        }
    }
}

/// Decodes a line. Old instruments write Latin-1, where every byte is a character.
fn decode(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => bytes.iter().map(|&byte| byte as char).collect(),
    }
}

/// The rows of a text, read one after the other, so that they are never all in memory.
pub(super) struct Rows<R> {
    lines: Lines<R>,
    separator: Separator,
    /// Names of all columns, including scalars.
    names: Vec<String>,
    /// Rows that have already been read.
    ahead: VecDeque<Line>,
    /// The line number and the width of the second row, if this row and the third lack the same last cells.
    short: Option<(usize, usize)>,
    /// Number of rows returned.
    returned: usize,
}

impl<R: BufRead> Rows<R> {
    /// Reads the header, if there is one, and the first rows.
    pub fn open(file: &Path, text: R) -> Result<Self, DataError> {
        let mut lines = Lines { file: file.into(), text, number: 0, bytes: Vec::new() };
        let mut ahead = VecDeque::new();
        while ahead.len() <= AHEAD
            && let Some(line) = lines.next()?
        {
            ahead.push_back(line);
        }
        let Some(first) = ahead.front() else {
            return Err(DataError::Empty { file: file.into() });
        };
        let separator = separator_of(&first.text);
        let mut first_cells = split(&first.text, separator);
        drop_trailing_empty(&mut first_cells);
        let has_header = is_header(&first.text, ahead.get(1), separator);
        let name = |(i, cell): (usize, &Cow<'_, str>)| {
            if has_header && !cell.is_empty() { cell.to_string() } else { (i + 1).to_string() }
        };
        let names: Vec<String> = first_cells.iter().enumerate().map(name).collect();
        if has_header {
            ahead.pop_front();
        }
        if ahead.is_empty() {
            return Err(DataError::NoSamples { file: file.into() });
        }
        let mut rows = Self { lines, separator, names, ahead, short: None, returned: 0 };
        rows.short = rows.short_rows();
        Ok(rows)
    }

    /// Returns the names of all columns, including scalars.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns the line number and the width of the second row, if it lacks the same last cells as the third. The
    /// missing columns then have a value in their first row only.
    fn short_rows(&self) -> Option<(usize, usize)> {
        let width = |row: usize| self.ahead.get(row).map(|line| self.cells(line).len());
        let (first, second, third) = (width(0)?, width(1)?, width(2)?);
        let is_short = first == self.names.len() && second < first && third == second;
        is_short.then(|| (self.ahead[1].number, second))
    }

    /// Returns, for each column, the value of its first row if no other row read so far has one.
    pub fn scalars(&self) -> Result<Vec<Option<f64>>, DataError> {
        let mut found = vec![None; self.names.len()];
        let mut cells = Vec::new();
        for (k, line) in self.ahead.iter().enumerate() {
            self.parse(line, &mut cells)?;
            for (i, found) in found.iter_mut().enumerate() {
                let cell = cells.get(i).copied().flatten();
                if k == 0 {
                    *found = cell.filter(|_| self.ahead.len() > 1);
                } else if cell.is_some() {
                    *found = None;
                }
            }
        }
        Ok(found)
    }

    /// Reads the next row into `cells`, with `None` for an empty cell, and returns its line number; `None` after the
    /// last row.
    pub fn next(&mut self, cells: &mut Vec<Option<f64>>) -> Result<Option<usize>, DataError> {
        let line = match self.ahead.pop_front() {
            Some(line) => line,
            None => match self.lines.next()? {
                Some(line) => line,
                None => return Ok(None),
            },
        };
        self.parse(&line, cells)?;
        let ragged = |line, found| {
            Err(DataError::Ragged { file: self.lines.file.clone(), line, expected: self.names.len(), found })
        };
        match self.short {
            Some((second, width)) if self.returned > 0 && cells.len() != width => return ragged(second, width),
            None if cells.len() != self.names.len() => return ragged(line.number, cells.len()),
            _ => {}
        }
        self.returned += 1;
        Ok(Some(line.number))
    }

    /// Returns the cells of a line as text.
    fn cells<'a>(&self, line: &'a Line) -> Vec<Cow<'a, str>> {
        let mut cells = split(&line.text, self.separator);
        if cells.len() == self.names.len() + 1 {
            drop_trailing_empty(&mut cells);
        }
        cells
    }

    /// Parses the cells of a line, with `None` for an empty cell.
    fn parse(&self, line: &Line, row: &mut Vec<Option<f64>>) -> Result<(), DataError> {
        row.clear();
        for (i, cell) in self.cells(line).iter().enumerate() {
            let Some(value) = number(cell, self.separator != Separator::Mark(',')) else {
                return Err(DataError::NotANumber {
                    file: self.lines.file.clone(),
                    line: line.number,
                    column: self.names.get(i).cloned().unwrap_or_else(|| (i + 1).to_string()),
                    cell: cell.chars().take(40).collect(),
                });
            };
            row.push(if cell.is_empty() { None } else { Some(value) });
        }
        Ok(())
    }
}

/// Reads a whole text file.
pub(super) fn read(path: &Path, text: impl BufRead) -> Result<Content, DataError> {
    let mut rows = Rows::open(path, text)?;
    let width = rows.names.len();
    // For each column, the value of the first row if no other row has one.
    let mut only: Vec<Option<f64>> = vec![None; width];
    let (mut values, mut lines, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(line) = rows.next(&mut cells)? {
        cells.resize(width, None);
        for (only, cell) in only.iter_mut().zip(&cells) {
            *only = if lines.is_empty() { *cell } else { only.filter(|_| cell.is_none()) };
        }
        values.extend(cells.iter().map(|cell| cell.unwrap_or(f64::NAN)));
        lines.push(line);
    }
    if lines.len() == 1 {
        only.fill(None);
    }
    let kept: Vec<usize> = (0..width).filter(|&i| only[i].is_none()).collect();
    // Each column may have turned out to be a scalar.
    if kept.is_empty() {
        return Err(DataError::NoSamples { file: path.into() });
    }
    let columns = Array2::from_shape_vec((lines.len(), width), values)
        .map_err(|error| DataError::Malformed { file: path.into(), what: error.to_string() })?;
    let columns = if kept.len() == width { columns } else { columns.select(Axis(1), &kept) };
    let named = |i: &usize| rows.names[*i].clone();
    let scalars = only.iter().enumerate().filter_map(|(i, value)| Some((named(&i), (*value)?))).collect();
    Ok(Content { names: kept.iter().map(named).collect(), columns, scalars, lines, notes: Vec::new() })
}

/// Returns whether a line is a comment. A comment begins with `#`, but a row whose first cell is an error of a
/// spreadsheet (`#N/A`, `#DIV/0!`, `#VALUE!`) is not one.
fn is_comment(text: &str) -> bool {
    const ERRORS: [&str; 8] = ["#n/a", "#na", "#div/0!", "#value!", "#ref!", "#name?", "#num!", "#null!"];
    let first = text.trim_start_matches('"').split([',', ';', '\t', ' ', '"']).next().unwrap_or_default();
    text.starts_with('#') && !ERRORS.contains(&first.to_lowercase().as_str())
}

/// Returns whether the first line is a header. A cell that is not a number is a name. Numbers in quotes are names if
/// the numbers below them are not in quotes (plid itself writes such names). If every row is in quotes, they are
/// numbers.
fn is_header(first: &str, second: Option<&Line>, separator: Separator) -> bool {
    let decimal_comma = separator != Separator::Mark(',');
    split(first, separator).iter().any(|cell| number(cell, decimal_comma).is_none())
        || (first.contains('"') && !second.is_some_and(|line| line.text.contains('"')))
}

/// Finds the separator of a file from its first line, without the quoted parts.
///
/// A semicolon takes precedence over a tab, and a tab over a comma, because a comma may be part of a number where
/// another mark separates the numbers. A comma at the end of a cell, however, is a separator.
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

/// Returns the cells of a line, trimmed and without quotes. A doubled quote within quotes is one quote.
fn split(line: &str, separator: Separator) -> Vec<Cow<'_, str>> {
    if line.contains('"') {
        return split_quoted(line, separator).into_iter().map(Cow::Owned).collect();
    }
    match separator {
        Separator::Mark(mark) => line.split(mark).map(|cell| Cow::Borrowed(cell.trim())).collect(),
        Separator::Blanks => line.split_whitespace().map(Cow::Borrowed).collect(),
    }
}

fn split_quoted(line: &str, separator: Separator) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
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

fn drop_trailing_empty(cells: &mut Vec<Cow<'_, str>>) {
    if cells.len() > 1 && cells.last().is_some_and(|cell| cell.is_empty()) {
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
        // The names are numbers, and the numbers below are without quotes.
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
        // A sensor that fails from the second sample on gives NaN. That is not a scalar.
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
        let content = read(Path::new("x"), &b"a [m/s\xb2],b\n1,2\n"[..]).unwrap();
        assert_eq!(content.names[0], "a [m/s\u{b2}]");
    }
}
