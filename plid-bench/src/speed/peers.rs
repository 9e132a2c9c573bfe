//! Times of other software, as plid-bench/peers/ measures them beside plid's.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::study::StudyError;

/// A file of peers' times. Keys beyond these are not looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peers {
    /// The number of states n.
    pub n: usize,
    /// The number of inputs m.
    pub inputs: usize,
    /// The number of outputs p.
    pub outputs: usize,
    /// One by one.
    pub peers: Vec<Peer>,
}

/// Another implementation of the same recursion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Its name.
    pub name: String,
    /// The number type.
    pub dtype: String,
    /// Its time of a step, us; none where it could not be timed.
    pub us_per_step: Option<f64>,
    /// plid's time of a step in the same run, us.
    pub plid_us_per_step: Option<f64>,
    /// The largest relative difference of its estimate from plid's on the same data.
    pub agreement: Option<f64>,
    /// Whether it makes use of the zeros and ones of the transition; otherwise it multiplies N x N matrices.
    pub structured: bool,
}

impl Peer {
    /// How many times as long as plid it takes.
    pub fn factor(&self) -> Option<f64> {
        Some(self.us_per_step? / self.plid_us_per_step?)
    }
}

/// Reads a file of peers' times.
///
/// # Errors
/// A file that cannot be read, or is not one of these.
pub fn read(path: &Path) -> Result<Peers, StudyError> {
    let text = std::fs::read_to_string(path).map_err(StudyError::file(path))?;
    serde_json::from_str(&text).map_err(|error| StudyError::Content {
        path: path.into(),
        line: error.line(),
        reason: format!("not a file of peers' times: {error}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_peers_is_read_and_a_wrong_one_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = r#"{"machine": {"cpu": "x"}, "n": 64, "inputs": 3, "outputs": 3, "peers": [
            {"name": "a", "dtype": "f64", "us_per_step": 600.0, "plid_us_per_step": 60.0, "agreement": 1e-9, "structured": true},
            {"name": "b", "dtype": "f64", "us_per_step": null, "plid_us_per_step": 60.0, "agreement": null, "structured": false}]}"#;
        std::fs::write(file.path(), text).unwrap();
        let peers = read(file.path()).unwrap();
        assert_eq!(peers.peers[0].factor(), Some(10.0));
        assert_eq!(peers.peers[1].factor(), None);
        std::fs::write(file.path(), "{}").unwrap();
        assert!(read(file.path()).unwrap_err().to_string().contains("line 1: not a file of peers"));
    }
}
