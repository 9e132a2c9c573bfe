//! The channels of a record in a file, block by block.

use crate::select::require_names;
use crate::{Blocks, DataError, MissingPolicy, Table, channels};
use ndarray::Array2;
use std::path::PathBuf;

/// Number of rows of a block.
pub(super) const ROWS: usize = 8192;

/// A record in a file that can be read in [`Blocks`], and those of its channels that are used.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file.
    pub file: PathBuf,
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Sample rate in Hz; by default that of the file.
    pub rate_hz: Option<f64>,
    /// The meaning of NaN in an output.
    pub missing: MissingPolicy,
}

/// A block with its inputs (rows x m) and outputs (rows x p), in the data's units.
pub(super) struct Raw {
    pub table: Table,
    pub inputs: Array2<f64>,
    pub outputs: Array2<f64>,
}

/// The blocks of a [`Source`].
pub(super) struct RawBlocks<'a> {
    source: &'a Source,
    blocks: Blocks,
}

impl<'a> RawBlocks<'a> {
    pub fn open(source: &'a Source) -> Result<Self, DataError> {
        require_names(&source.inputs, &source.outputs)?;
        Ok(Self { source, blocks: Blocks::open(&source.file)? })
    }

    /// Returns the next block. Each value is checked as by [`crate::select`].
    pub fn next(&mut self) -> Result<Option<Raw>, DataError> {
        let Some(table) = self.blocks.next_block(ROWS)? else { return Ok(None) };
        let inputs = channels(&table, &self.source.inputs, MissingPolicy::Error)?;
        let outputs = channels(&table, &self.source.outputs, self.source.missing)?;
        Ok(Some(Raw { table, inputs, outputs }))
    }
}
