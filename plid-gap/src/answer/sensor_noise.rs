//! The declared noise of the sensors, compared with the noise that the records show.

use plid_report::Cell;

use crate::answer::schema::NamedEffect;
use crate::effects::{Effect, Place, SensorNoise};
use crate::noise::is_constant;
use crate::prepare::Prepared;

/// States the outputs whose declared noise is clearly not that of the records. An output at which the answer names a
/// noisy sensor is left out.
pub(crate) fn in_words(ready: &Prepared, named: &[NamedEffect]) -> Vec<String> {
    if !ready.declares || ready.quiet.is_empty() {
        return Vec::new();
    }
    let setting = &ready.problem.setting;
    let (sensors, all) = (ready.noise.sensors(), ready.noise.rms());
    let is_named = |at: &str| named.iter().any(|named| named.effect == SensorNoise.name() && named.location == at);
    let one = |(o, output): (usize, &String)| {
        let place = Place::Output(o);
        // Noise that comes from inside the plant is in the records, but not in the sensor.
        let [declared, found] = misdeclared(ready, o, [sensors[o].sqrt(), all[o]])?;
        let (unit, short) = (setting.unit("V", &place), |x: f64| Cell::significant(x, 3));
        (!is_named(&place.location(&setting.names))).then(|| {
            format!(
                "The noise of {output} is declared with a standard deviation of {} {unit}, but the records show {}{} \
                {unit}, which was used in its place.",
                short(declared),
                if found < declared { "only " } else { "" },
                short(found)
            )
        })
    };
    setting.names.outputs.iter().enumerate().filter_map(one).collect()
}

/// Returns the declared standard deviation of a sensor's noise and the one that the records show, if the two differ
/// by more than `misdeclared` over the whole 95 % interval of the latter. `found` are the least and the largest value
/// that the records allow: the part of the noise that is surely the sensor's, and all noise of the output.
fn misdeclared(ready: &Prepared, o: usize, found: [f64; 2]) -> Option<[f64; 2]> {
    let settings = &ready.problem.settings;
    let (declared, quantisation) = (ready.declared_sensor[o], &ready.quantisation[o]);
    if !(declared > 0.0) || quantisation.coarse || is_constant(&ready.quiet, o, declared * declared) {
        return None;
    }
    // The rounding of a converter adds to what is declared.
    let rounding = if quantisation.step.is_finite() { quantisation.step.powi(2) / 12.0 } else { 0.0 };
    let expected = declared.hypot(rounding.sqrt());
    // The logarithm of a standard deviation of n values has the variance 1 / (2 n).
    let values = ready.quiet.iter().map(|stretch| stretch.freedom).sum::<f64>();
    let half = 1.96 * settings.prepare.level_allowance * (0.5 / values).sqrt();
    let clear = settings.answer.misdeclared * half.exp();
    let [least, largest] = found;
    if least > clear * expected {
        Some([declared, least])
    } else if largest < expected / clear {
        Some([declared, largest])
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::Case;
    use crate::case::record::Excitation;
    use crate::prepare::{Known, prepare};
    use crate::testing;

    /// Returns the sentences for a case that declares this multiple of the true noise of the first output.
    fn said(case: &Case, factor: f64) -> Vec<String> {
        let mut model = case.model.clone().unwrap();
        model.noise.sensor_std.iter_mut().for_each(|std| std[0] *= factor);
        in_words(&prepare(&model, &case.records, &Known::default()).unwrap(), &[])
    }

    /// If the declared noise of an output is 0.7 or 1.5 times the true one, the answer says so. It reports neither a
    /// deviation of 10 % in a short record nor a deviation that no record shows.
    #[test]
    fn a_wrongly_declared_noise_is_said() {
        let mut case = testing::case(&testing::truss(1), &testing::truss(1));
        let std = case.model.as_ref().unwrap().noise.sensor_std.as_ref().unwrap()[0];
        for factor in [0.7, 1.5] {
            let words = said(&case, factor);
            let [said] = words.as_slice() else { panic!("{factor}: {words:?}") };
            let declared =
                format!("y1 is declared with a standard deviation of {} ", Cell::significant(factor * std, 3));
            assert!(said.contains(&declared) && said.contains("show only") == (factor > 1.0), "{said}");
        }
        for factor in [0.9, 1.0, 1.1] {
            assert!(said(&case, factor).is_empty(), "{factor}: {:?}", said(&case, factor));
        }
        case.records.retain(|record| record.excitation != Excitation::Zero);
        assert!(said(&case, 1.5).is_empty());
    }
}
