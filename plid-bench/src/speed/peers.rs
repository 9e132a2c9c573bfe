//! Times of other software, which plid-bench/peers/ measures in alternation with those of plid.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::study::StudyError;

/// A file with the times of peers. Other keys are ignored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peers {
    /// One part for each size of the problem.
    pub sizes: Vec<Size>,
}

/// Peers at one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Size {
    /// The number of states n.
    pub n: usize,
    /// The number of inputs m.
    pub inputs: usize,
    /// The number of outputs p.
    pub outputs: usize,
    /// The peers that agree with plid.
    pub peers: Vec<Peer>,
    /// Peers that do not agree or do not run.
    #[serde(default)]
    pub refused: Vec<Refused>,
}

/// Another implementation of the same recursion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Its name.
    pub name: String,
    /// The version of its package.
    pub version: String,
    /// Its covariance form.
    pub form: String,
    /// The number type.
    pub dtype: String,
    /// Whether it makes use of the zeros and ones of the transition; otherwise it multiplies N x N matrices.
    pub structured: bool,
    /// Its time of a step in us.
    pub us_per_step: f64,
    /// The time in us of plid's direct form, measured in alternation with it.
    pub plid_us_per_step: f64,
    /// The median ratio of the two times.
    pub ratio: f64,
    /// The largest relative difference of its s and P from plid's on the same data.
    pub agreement: f64,
}

/// A peer without a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refused {
    /// Its name.
    pub name: String,
    /// The reason.
    pub refused: String,
}

impl Peers {
    /// Returns the fastest peer at a size, with three inputs and outputs, in f64.
    pub fn fastest(&self, n: usize, structured: bool) -> Option<&Peer> {
        let size = self.sizes.iter().find(|size| (size.n, size.inputs, size.outputs) == (n, 3, 3))?;
        let known = size.peers.iter().filter(|peer| peer.structured == structured && peer.dtype == "f64");
        known.min_by(|a, b| a.us_per_step.total_cmp(&b.us_per_step))
    }
}

/// Reads a file of peers' times.
///
/// # Errors
/// Returns an error for a file that cannot be read or does not contain such times.
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
        let peer = |name: &str, us: f64, structured: bool| {
            format!(
                r#"{{"name": "{name}", "version": "1", "form": "direct", "dtype": "f64", "structured": {structured},
                    "package": "x",
                "us_per_step": {us}, "plid_us_per_step": 60.0, "ratio": 10.1, "agreement": 1e-9}}"#
            )
        };
        let peers = [peer("a", 600.0, true), peer("b", 500.0, true), peer("c", 400.0, false)].join(",");
        let refused = r#"{"name": "d", "refused": "differs"}"#;
        let text = format!(
            r#"{{"machine": {{}}, "sizes": [{{"n": 64, "inputs": 3, "outputs": 3, "peers": [{peers}],
                "refused": [{refused}]}}]}}"#
        );
        std::fs::write(file.path(), text).unwrap();
        let peers = read(file.path()).unwrap();
        assert_eq!(peers.fastest(64, true).unwrap().name, "b");
        assert_eq!(peers.fastest(64, false).unwrap().name, "c");
        assert_eq!(peers.fastest(12, true), None);
        assert_eq!(peers.sizes[0].refused[0].refused, "differs");
        std::fs::write(file.path(), "{}").unwrap();
        assert!(read(file.path()).unwrap_err().to_string().contains("line 1: not a file of peers"));
    }
}
