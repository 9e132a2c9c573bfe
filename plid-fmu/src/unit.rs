//! The quantity that follows from a unit.

use plid_simulator::OutputKind;

/// Base units of the standard, from which positions, velocities, accelerations and forces are recognised.
pub(crate) const BASE: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// Exponents of [`BASE`].
pub(crate) type Exponents = [i32; 8];

/// Returns the quantity of a unit: by its base units if they are stated, or by its name.
pub(crate) fn quantity(unit: &str, base: Option<&Exponents>) -> Option<OutputKind> {
    let known = by_name(unit);
    // Newton metres and joules have the same base units.
    if known.is_some() || matches!(unit, "J" | "kJ" | "W.s" | "Pa.m3") {
        return known;
    }
    let exponents = base?;
    match exponents {
        [0, 1, 0, 0, 0, 0, 0, 0] | [0, 0, 0, 0, 0, 0, 0, 1] => Some(OutputKind::Position),
        [0, 1, -1, 0, 0, 0, 0, 0] | [0, 0, -1, 0, 0, 0, 0, 1] => Some(OutputKind::Velocity),
        [0, 1, -2, 0, 0, 0, 0, 0] | [0, 0, -2, 0, 0, 0, 0, 1] => Some(OutputKind::Acceleration),
        [1, 1, -2, 0, 0, 0, 0, 0] => Some(OutputKind::Force),
        _ => None,
    }
}

fn by_name(unit: &str) -> Option<OutputKind> {
    let plain: String = unit.chars().filter(|c| !matches!(c, ' ' | '.' | '*' | '·' | '^' | '(' | ')')).collect();
    let (length, time) = plain.split_once('/').unwrap_or((&plain, ""));
    let is_length = matches!(length, "m" | "mm" | "cm" | "um" | "km" | "in" | "ft" | "rad" | "mrad" | "deg");
    match time {
        "" if is_length => Some(OutputKind::Position),
        "" if plain == "rpm" => Some(OutputKind::Velocity),
        "" if matches!(length, "N" | "kN" | "mN" | "MN" | "lbf" | "Nm" | "kNm" | "mNm") => Some(OutputKind::Force),
        "s" | "min" | "h" if is_length => Some(OutputKind::Velocity),
        "s2" if is_length => Some(OutputKind::Acceleration),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_tell_quantities() {
        let kinds = [
            (OutputKind::Position, ["m", "rad", "mm", "deg"]),
            (OutputKind::Velocity, ["m/s", "rad/s", "rpm", "deg/s"]),
            (OutputKind::Acceleration, ["m/s2", "m/s^2", "rad/s2", "m/(s^2)"]),
            (OutputKind::Force, ["N", "N.m", "N m", "kN"]),
        ];
        for (kind, units) in kinds {
            for unit in units {
                assert_eq!(quantity(unit, None), Some(kind), "{unit}");
            }
        }
        for unit in ["V", "N/m", "kg", "N.m.s/rad", "s", "Hz", "1/s", "J"] {
            assert_eq!(quantity(unit, None), None, "{unit}");
        }
        assert_eq!(quantity("weight", Some(&[1, 1, -2, 0, 0, 0, 0, 0])), Some(OutputKind::Force));
        assert_eq!(quantity("J", Some(&[1, 2, -2, 0, 0, 0, 0, 0])), None);
    }
}
