//! report.html: pictures, the targets, the tables behind them.

use plid_lab::report::Report;

use super::outcome::Outcome;
use super::peers::Peers;

/// The page.
pub fn page(_outcome: &Outcome, _peers: Option<&Peers>) -> Report {
    Report::new("Speed")
}
