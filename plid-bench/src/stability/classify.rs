//! The complete rule that decides whether a cell is sound, degraded or lost.

use plid_catalogue::ScalarName;
use plid_core::ObservableForm;
use plid_identify::ToModel;
use plid_model::{FrequencyResponse, ModelError};
use plid_testbed::{INPUTS, OUTPUTS};
use serde::Serialize;

use super::cell::{Cell, model};

/// Limit on the error of P relative to double-double at any snapshot, as |dP_ij| over sqrt(P_ii P_jj). A cell that
/// exceeds this limit or one of the following limits is degraded.
pub const COVARIANCE_LIMIT: f64 = 0.1;
/// Limit on the error of s relative to double-double, in standard deviations.
pub const DEVIATIONS_LIMIT: f64 = 1.0;
/// Limit on the difference in frequency response from the peer in f64 at the step of comparison, relative to the
/// maximum of the peer's response.
pub const RESPONSE_LIMIT: f64 = 0.02;
/// Limit on the ratio of the free-run error to that of the peer.
pub const FREE_RUN_LIMIT: f64 = 1.1;
/// Limit on the ratio of the NEES to that of the peer, if there are true parameters.
pub const NEES_LIMIT: f64 = 2.0;

/// Returns the rule in words.
pub fn rule() -> String {
    format!(
        "Lost: the recursion stops with an error, or P is found not to be positive definite. Degraded: not lost, but P \
         is off from double-double's \
         by more than {} of sqrt(P_ii P_jj) or s by more than {} standard deviation at a step where they are compared, \
         or, measured against Bierman UD in f64 on \
         the same record (with parameter noise, which enters matrices and factors in different ways: against the \
         direct form in f64 for a matrix), the frequency \
         response differs by more than {} % of the peak, the free-run error is larger by more than {} %, or NEES \
         (where the plant is of the \
         model's class) is more than {} times as large. Sound: neither.",
        COVARIANCE_LIMIT,
        DEVIATIONS_LIMIT,
        100.0 * RESPONSE_LIMIT,
        (100.0 * (FREE_RUN_LIMIT - 1.0)).round(),
        NEES_LIMIT,
    )
}

/// The class of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// The result is as good as the arithmetic permits.
    Sound,
    /// The cell completes, but its result is not fully reliable.
    Degraded,
    /// P is no longer a covariance.
    Lost,
}

/// A cell with its class.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The cell.
    pub cell: Cell,
    /// The class.
    pub class: Class,
    /// The reason why it is not sound.
    pub why: String,
    /// The first step at which it was found lost.
    pub lost_at: Option<usize>,
    /// The largest difference in frequency response from the peer in f64, relative to the maximum of the peer's
    /// response.
    pub response: Option<f64>,
}

impl Judged {
    /// Whether P was still positive definite after `steps` steps, and close to double-double up to then.
    pub fn holds_to(&self, steps: usize) -> bool {
        let near = |cell: &Cell| cell.errors.iter().filter(|e| e.step <= steps).all(|e| !is_far(e));
        match self.lost_at {
            Some(step) => step > steps && near(&self.cell),
            None if steps >= self.cell.group.steps => self.class == Class::Sound,
            None => near(&self.cell),
        }
    }
}

fn is_far(error: &super::cell::ErrorAt) -> bool {
    error.deviations > DEVIATIONS_LIMIT || error.covariance.is_none_or(|e| e > COVARIANCE_LIMIT)
}

/// Judges cells. Those of one group are compared with its peers in f64.
///
/// # Errors
/// Returns an error for a model whose frequency response cannot be computed.
pub fn judge(cells: Vec<Cell>) -> Result<Vec<Judged>, ModelError> {
    let peers: Vec<Cell> = cells.iter().filter(|c| c.scalar == ScalarName::F64).cloned().collect();
    cells
        .into_iter()
        .map(|cell| {
            let peer = peers.iter().find(|p| p.group == cell.group && p.form == cell.group.peer_of(cell.form));
            let response = match peer {
                Some(peer) if cell.group.scenario.tells_every_response() => response_difference(&cell, peer)?,
                _ => None,
            };
            Ok(with_class(cell, peer, response))
        })
        .collect()
}

fn with_class(cell: Cell, peer: Option<&Cell>, response: Option<f64>) -> Judged {
    let mut lost = Vec::new();
    if let Some(found) = &cell.indefinite {
        let when = format!("P indefinite between steps {} and {}", found.after, found.by);
        lost.push((found.by, format!("{when} (pivot {:.1e} at {})", found.pivot, found.entry)));
    }
    if let Some(stop) = &cell.stop {
        lost.push((stop.step, format!("stopped at step {}, {}", stop.step, stop.reason)));
    }
    if let Some(lost_at) = lost.iter().map(|(step, _)| *step).min() {
        let why = lost.into_iter().map(|(_, why)| why).collect::<Vec<_>>().join("; ");
        return Judged { cell, class: Class::Lost, why, lost_at: Some(lost_at), response };
    }
    let mut degraded = Vec::new();
    if let Some(error) = cell.errors.iter().find(|e| is_far(e)) {
        let covariance = error.covariance.map_or("not finite".into(), |e| format!("{e:.1e}"));
        let moved = error.deviations;
        degraded.push(format!("at step {} P is off by {covariance}, s by {moved:.1e} standard deviations", error.step));
    }
    if let Some(response) = response.filter(|r| *r > RESPONSE_LIMIT) {
        degraded.push(format!("frequency response off by {:.1} % of the peak", 100.0 * response));
    }
    if let Some(peer) = peer {
        match (cell.free_run, peer.free_run) {
            (None, Some(_)) => degraded.push("the free run diverges".into()),
            (Some(own), Some(of_peer)) if own > FREE_RUN_LIMIT * of_peer => {
                degraded.push(format!("free-run error {:.2} % against {:.2} %", 100.0 * own, 100.0 * of_peer));
            }
            _ => {}
        }
        match (cell.nees, peer.nees) {
            (None, Some(_)) => degraded.push("no NEES".into()),
            (Some(own), Some(of_peer)) if own > NEES_LIMIT * of_peer => {
                degraded.push(format!("NEES {own:.2} against {of_peer:.2}"));
            }
            _ => {}
        }
    }
    let class = if degraded.is_empty() { Class::Sound } else { Class::Degraded };
    Judged { cell, class, why: degraded.join("; "), lost_at: None, response }
}

/// Number of points of the grid over the band of the check.
const GRID: usize = 1200;

/// Returns the largest |H - H_peer| over all pairs and the band, relative to the maximum of |H_peer|.
fn response_difference(cell: &Cell, peer: &Cell) -> Result<Option<f64>, ModelError> {
    if cell.estimate.is_empty() || peer.estimate.is_empty() {
        return Ok(None);
    }
    let own = frequency_response(cell)?;
    let other = frequency_response(peer)?;
    let [low, high] = cell.band_hz;
    let (mut difference, mut peak) = (0.0_f64, 0.0_f64);
    for k in 0..GRID {
        let hz = low + (high - low) * k as f64 / (GRID - 1) as f64;
        let (h, r) = (own.at(hz), other.at(hz));
        difference = (h - &r).iter().map(|x| x.norm()).fold(difference, f64::max);
        peak = r.iter().map(|x| x.norm()).fold(peak, f64::max);
    }
    let relative = difference / peak;
    Ok(relative.is_finite().then_some(relative))
}

fn frequency_response(cell: &Cell) -> Result<FrequencyResponse, ModelError> {
    let form = ObservableForm::balanced(cell.group.states, OUTPUTS, INPUTS).expect("the cell was run with it");
    let found = model(&cell.estimate, &form);
    Ok(FrequencyResponse::of(&found.to_model(cell.rate_hz)?))
}

#[cfg(test)]
mod tests {
    use plid_catalogue::CovarianceName;

    use super::*;
    use crate::stability::cell::{ErrorAt, Indefinite, Stop};
    use crate::stability::config::Config;

    fn cell(form: CovarianceName, scalar: ScalarName) -> Cell {
        let mut group = Config::default().groups().remove(0);
        group.states = 3;
        Cell {
            free_run: Some(0.1),
            nees: Some(1.0),
            // x, followed by a_i = 0.5 e_i and b_j = e_j, which are three first-order lags.
            estimate: (0..21)
                .map(|k| match k {
                    3 | 7 | 11 => 0.5,
                    12 | 16 | 20 => 1.0,
                    _ => 0.0,
                })
                .collect(),
            ..Cell::new(&group, form, scalar, [1.0, 100.0], 400.0)
        }
    }

    fn class(change: impl Fn(&mut Cell)) -> (Class, String) {
        let peer = cell(CovarianceName::BiermanUd, ScalarName::F64);
        let mut other = cell(CovarianceName::Direct, ScalarName::F32);
        change(&mut other);
        let judged = judge(vec![peer, other]).unwrap().remove(1);
        (judged.class, judged.why)
    }

    /// A change of a sound cell, and the resulting reason.
    type Clause<'a> = (&'a dyn Fn(&mut Cell), &'a str);

    fn error(deviations: f64, covariance: Option<f64>) -> ErrorAt {
        ErrorAt { step: 30, estimate: 1e-3, deviations, covariance }
    }

    #[test]
    fn each_clause_of_the_rule_decides_by_itself() {
        assert_eq!(class(|_| {}), (Class::Sound, String::new()));
        let sound = |c: &mut Cell| {
            c.errors = vec![error(0.9, Some(0.09))];
            c.free_run = Some(0.109);
            c.nees = Some(1.9);
        };
        assert_eq!(class(sound).0, Class::Sound);
        let clauses: [Clause<'_>; 8] = [
            (&|c| c.errors = vec![error(0.1, Some(0.2)), error(0.1, Some(0.01))], "P is off by 2.0e-1"),
            (&|c| c.errors = vec![error(0.1, None)], "not finite"),
            (&|c| c.errors = vec![error(2.0, Some(0.01))], "2.0e0 standard deviations"),
            (&|c| c.free_run = Some(0.12), "12.00 % against 10.00 %"),
            (&|c| c.free_run = None, "diverges"),
            (&|c| c.nees = Some(2.1), "NEES 2.10"),
            (&|c| c.nees = None, "no NEES"),
            (&|c| c.estimate[3] += 0.05, "frequency response off"),
        ];
        for (change, said) in clauses {
            let (class, why) = class(change);
            assert!(class == Class::Degraded && why.contains(said), "{class:?} {why}");
        }
    }

    #[test]
    fn loss_outweighs_all_else_and_has_its_step() {
        let stop = Some(Stop { step: 425, reason: "time update: pivot -1e-3 at state 3".into() });
        let indefinite = Some(Indefinite { after: 316, by: 422, entry: "a_1, row 2".into(), pivot: -1e-9 });
        let (found, why) = class(|c| (c.stop, c.free_run) = (stop.clone(), None));
        assert!(found == Class::Lost && why.contains("stopped at step 425"), "{why}");
        let peer = cell(CovarianceName::BiermanUd, ScalarName::F64);
        let mut lost = cell(CovarianceName::Direct, ScalarName::F32);
        (lost.stop, lost.indefinite) = (stop, indefinite);
        let judged = judge(vec![peer, lost]).unwrap().remove(1);
        assert_eq!(judged.lost_at, Some(422));
        assert!(judged.holds_to(400) && !judged.holds_to(422));
    }

    #[test]
    fn the_response_is_compared_with_the_peak_of_double_precision() {
        let peer = cell(CovarianceName::BiermanUd, ScalarName::F64);
        let mut other = cell(CovarianceName::BiermanUd, ScalarName::F32);
        // With this b_1, the response of the first lag is larger by a hundredth. All three lags have the same
        // maximum.
        other.estimate[12] *= 1.01;
        let found = judge(vec![peer, other]).unwrap()[1].response.unwrap();
        assert!((found - 0.01).abs() < 1e-6, "{found}");
    }
}
