//! The reliability of each kind of statement in the answers of the diagnosis: how often what is stated with a
//! probability comes true.

use plid_gap::answer::schema::About;
use serde::Serialize;

use crate::judge::Judged;
use crate::scores::Line;
use crate::statistics::{Calibration, Rate, calibration};

/// The reliability of one kind of statement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// The kind of statement.
    pub about: About,
    /// The rate at which the statements were true.
    pub right: Rate,
    /// The agreement of their probabilities with the outcomes.
    pub calibration: Calibration,
}

/// Returns the reliability of each kind of statement that the answers contain.
pub(crate) fn reliability(lines: &[Line]) -> Vec<Reliability> {
    let of = |about: About| {
        let stated: Vec<(f64, bool)> = lines.iter().flat_map(|line| stated(&line.judged[0], about)).collect();
        let right = Rate::of(stated.iter().map(|(_, right)| *right));
        (!stated.is_empty()).then(|| Reliability { about, right, calibration: calibration(&stated) })
    };
    About::ALL.into_iter().filter_map(of).collect()
}

/// Returns the statements of one kind: each with its probability and whether it is true.
fn stated(judged: &Judged, about: About) -> Vec<(f64, bool)> {
    let whole = |is: bool| judged.explanation.filter(|_| is).into_iter().collect();
    match about {
        About::Effect => judged.statements.iter().take(1).copied().collect(),
        About::Further => judged.statements.iter().skip(1).copied().collect(),
        About::Explanation => whole(judged.named),
        About::Nothing => whole(!judged.named && !judged.unknown),
        About::Unknown => whole(judged.unknown),
        About::Remainder => judged.further_cause.into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_statement_is_of_one_kind() {
        let named = Judged {
            named: true,
            explanation: Some((0.8, true)),
            statements: vec![(0.9, true), (0.6, false), (0.5, true)],
            further_cause: Some((0.3, false)),
            ..Judged::default()
        };
        let unknown = Judged { unknown: true, explanation: Some((0.7, false)), ..Judged::default() };
        let nothing = Judged { explanation: Some((0.95, true)), ..Judged::default() };
        let all = [named, unknown, nothing];
        let of = |about: About| all.iter().flat_map(|judged| stated(judged, about)).collect::<Vec<_>>();
        assert_eq!(of(About::Effect), [(0.9, true)]);
        assert_eq!(of(About::Further), [(0.6, false), (0.5, true)]);
        assert_eq!(of(About::Explanation), [(0.8, true)]);
        assert_eq!(of(About::Unknown), [(0.7, false)]);
        assert_eq!(of(About::Nothing), [(0.95, true)]);
        assert_eq!(of(About::Remainder), [(0.3, false)]);
    }
}
