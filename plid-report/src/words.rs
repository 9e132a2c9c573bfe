/// Formats a share in per cent with three significant digits, but never more than two decimals, as in "0.85 %", "5.21
/// %" and "13.3 %". A share that is not known is a dash.
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        x if x.is_nan() => "–".into(),
        x if x.is_infinite() => "infinite".into(),
        // A zero has no sign.
        x if x.abs() < 0.005 => "0 %".into(),
        x if x.abs() < 9.995 => format!("{x:.2} %"),
        x if x.abs() < 1e4 => format!("{x:.1} %"),
        x => format!("{x:.1e} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::percent;

    #[test]
    fn a_share_has_three_digits_and_at_most_two_decimals() {
        let words = [0.0, -0.000_01, 0.008_5, 0.052_1, 0.099_949, 0.099_96, -0.133, 1.5, 123.0].map(percent);
        let expected = ["0 %", "0 %", "0.85 %", "5.21 %", "9.99 %", "10.0 %", "-13.3 %", "150.0 %", "1.2e4 %"];
        assert_eq!(words, expected);
        assert_eq!(percent(f64::NAN), "–");
        assert_eq!(percent(f64::INFINITY), "infinite");
    }
}
