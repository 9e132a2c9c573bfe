//! Numbers as sentences say them.

/// "12.3 %"; a dash where there is no number.
pub(crate) fn percent(share: f64) -> String {
    match 100.0 * share {
        x if !x.is_finite() => "–".into(),
        // A zero has no sign.
        x if x.abs() < 0.005 => "0 %".into(),
        x if x.abs() < 0.95 => format!("{x:.2} %"),
        x if x.abs() < 1e4 => format!("{x:.1} %"),
        x => format!("{x:.1e} %"),
    }
}
