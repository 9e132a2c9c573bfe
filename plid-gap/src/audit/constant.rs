//! Constant channels.

use crate::case::Case;
use crate::case::record::{Excitation, Record};
use crate::error::GapError;

/// Returns findings on the channels that are constant in a record in which they should vary.
///
/// # Errors
/// Returns [`GapError::Constant`] for a channel that is constant in all records.
pub fn check(case: &Case) -> Result<Vec<String>, GapError> {
    let mut found = Vec::new();
    let mut look = |names: &[String], of: fn(&Record) -> &[Vec<f64>], asked: &dyn Fn(&Record) -> bool, so: &str| {
        for (c, name) in names.iter().enumerate() {
            if case.records.iter().all(|record| stands(&of(record)[c])) {
                return Err(GapError::Constant { channel: name.clone() });
            }
            let still = case.records.iter().filter(|record| asked(record) && stands(&of(record)[c]));
            let still: Vec<&str> = still.map(|record| record.name.as_str()).collect();
            if !still.is_empty() {
                found.push(format!("`{name}` is constant in {}: {so}", still.join(", ")));
            }
        }
        Ok(())
    };
    let driven = |record: &Record| record.excitation != Excitation::Zero;
    // In closed loop, the controller drives an input that has no excitation of its own.
    let inputs = if case.controller.is_some() { &[][..] } else { &case.config.inputs };
    look(inputs, |r| &r.u, &driven, "it gives no information about that input.")?;
    look(&case.config.outputs, |r| &r.y, &|_| true, "is the sensor connected, or its converter too coarse?")?;
    Ok(found)
}

fn stands(x: &[f64]) -> bool {
    let mut there = x.iter().filter(|x| !x.is_nan());
    there.next().is_none_or(|first| there.all(|x| x == first))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{case, truss};

    #[test]
    fn one_record_is_a_finding_and_all_are_an_error() {
        let sound = case(&truss(1), &truss(1));
        // The record without input does not count.
        assert!(check(&sound).unwrap().is_empty());
        let mut still = sound.clone();
        still.records[2].y[1].fill(0.3);
        still.records[1].u[0].fill(0.0);
        let found = check(&still).unwrap();
        assert!(found.iter().any(|f| f.starts_with("`y2` is constant in random-2")), "{found:?}");
        assert!(found.iter().any(|f| f.starts_with("`u1` is constant in random-1")), "{found:?}");
        assert_eq!(found.len(), 2);
        still.records.iter_mut().for_each(|record| record.y[1].fill(0.3));
        assert!(matches!(check(&still), Err(GapError::Constant { channel }) if channel == "y2"));
        let mut dead = sound;
        dead.records.iter_mut().for_each(|record| record.u[1].fill(0.0));
        assert!(matches!(check(&dead), Err(GapError::Constant { channel }) if channel == "u2"));
    }
}
