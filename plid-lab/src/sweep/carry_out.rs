//! The points of a sweep in parallel, and the files about all of them.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use plid_file::write_atomic;
use plid_work::{Progress, Shard};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::grid::Sweep;
use super::point::{POINTS, Point, Row};
use super::{report, table};
use crate::run::{RunError, file_error, strict_json};

/// The file that states which sweep a folder holds.
const SWEEP: &str = "sweep.json";

/// Runs the points of a sweep or of a shard, each in its own folder in `directory`, and returns their rows. With
/// `resume`, finished points are kept and interrupted ones continue. A run that fails is a row with its error.
///
/// # Errors
/// Returns [`RunError::Interrupted`], [`RunError::Sweep`] if the folder holds another sweep, or the error of a file.
pub fn carry_out(
    sweep: &Sweep,
    directory: &Path,
    shard: Option<Shard>,
    resume: bool,
    progress: &dyn Progress,
) -> Result<Vec<Row>, RunError> {
    let points = directory.join(POINTS);
    // The folder is created first. It shows the other shards that the directory belongs to this sweep.
    fs::create_dir_all(&points).map_err(file_error(&points))?;
    claim(sweep, directory, resume)?;
    let own: Vec<usize> = (0..sweep.points()).filter(|&index| shard.is_none_or(|shard| shard.has(index))).collect();
    progress.stage(&format!("{} points", own.len()));
    let done = AtomicUsize::new(0);
    let one = |&index: &usize| {
        if progress.interrupted() {
            return Err(RunError::Interrupted { checkpoint: points.clone() });
        }
        Point::new(sweep, index, directory).run(resume, progress)?;
        progress.advance(done.fetch_add(1, Ordering::Relaxed) + 1, own.len());
        Ok(())
    };
    own.par_iter().map(one).collect::<Result<Vec<()>, RunError>>()?;
    rows(sweep, directory, &own)
}

/// Reads the rows of all points, each of which must have been run.
///
/// # Errors
/// Returns [`RunError::Sweep`] if the folder holds another sweep or a point is missing, or the error of a file.
pub fn read(sweep: &Sweep, directory: &Path) -> Result<Vec<Row>, RunError> {
    let path = directory.join(SWEEP);
    if !path.exists() {
        return Err(RunError::Sweep { path, reason: "there is no such file, so no shard has been run here".into() });
    }
    claim(sweep, directory, true)?;
    rows(sweep, directory, &(0..sweep.points()).collect::<Vec<_>>())
}

/// Writes report.html and table.csv, which are about all points.
///
/// # Errors
/// Returns an error if a file cannot be written.
pub fn write(sweep: &Sweep, rows: &[Row], directory: &Path) -> Result<(), RunError> {
    let put = |name: &str, bytes: &[u8]| {
        let path = directory.join(name);
        write_atomic(&path, bytes).map_err(file_error(&path))
    };
    put("report.html", report::page(sweep, rows).to_html().as_bytes())?;
    // The table is written last, so that its presence shows that all files exist.
    put("table.csv", &table::csv(sweep, rows))
}

/// Records in the directory which sweep it holds. With `resume`, another sweep is an error.
fn claim(sweep: &Sweep, directory: &Path, resume: bool) -> Result<(), RunError> {
    let path = directory.join(SWEEP);
    let varied = sweep.varied.iter().map(|varied| json!({ "key": varied.key, "values": varied.values }));
    let content = json!({ "experiment": sweep.base, "vary": varied.collect::<Vec<Value>>() });
    let text = strict_json(&path, &content)?;
    if resume && path.exists() && fs::read_to_string(&path).map_err(file_error(&path))? != text {
        return Err(RunError::Sweep {
            path,
            reason: "this folder holds another sweep; `--force` overwrites it".into(),
        });
    }
    write_atomic(&path, text.as_bytes()).map_err(file_error(&path))
}

fn rows(sweep: &Sweep, directory: &Path, indices: &[usize]) -> Result<Vec<Row>, RunError> {
    let (mut rows, mut missing) = (Vec::new(), Vec::new());
    for &index in indices {
        match Point::new(sweep, index, directory).row()? {
            Some(row) => rows.push(row),
            None => missing.push(index + 1),
        }
    }
    let Some(first) = missing.first() else { return Ok(rows) };
    let (path, count, all) = (directory.join(POINTS), missing.len(), indices.len());
    Err(RunError::Sweep { path, reason: format!("{count} of {all} points have not been run, {first} is the first") })
}
