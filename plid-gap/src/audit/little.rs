//! The length of the records: whether they suffice for a fit, and for which effects they are too short.

use plid_model::{Mode, ModeKind, Model};

use crate::case::Case;
use crate::case::record::{Excitation, Record};
use crate::case::split::driven;
use crate::effects::{Effect, Library, Setting, Side};
use crate::error::GapError;
use crate::noise::repeats;
use crate::plant::Plant;
use crate::signal::peaks;

/// The effects for which the records are too short.
pub struct Little {
    /// Findings in words.
    pub findings: Vec<String>,
    /// Names of the effects that are left out.
    pub left_out: Vec<String>,
}

/// Returns the findings on the length of the records, and the effects for which the records are too short.
///
/// # Errors
/// Returns [`GapError::TooLittle`] if no record drives the structure, or if all driven records together have no more
/// values than the simulation has states.
pub fn check(case: &Case, model: &Model, library: &Library, without: &[String]) -> Result<Little, GapError> {
    let effects = || library.effects().filter(|effect| !without.iter().any(|name| name == effect.name()));
    let settings = &case.config.settings;
    let records = driven(&case.records, &case.config.settings.case);
    if records.is_empty() {
        return Err(GapError::TooLittle("no record that is fitted has an input".into()));
    }
    let (n, m, p, rate) = (model.n(), model.m(), model.p(), model.sample_rate_hz);
    let values = records.iter().flat_map(|r| r.y.iter().flatten()).filter(|y| y.is_finite()).count();
    if values <= n {
        return Err(GapError::TooLittle(format!(
            "the records with an input contain {values} output values in total, too few for the {n} states of the \
            simulation"
        )));
    }
    let mut little = Little { findings: Vec::new(), left_out: Vec::new() };

    let structural =
        |mode: &&Mode| mode.kind == ModeKind::Oscillatory && mode.damping.abs() < settings.plant.light_damping;
    let modes: Vec<f64> = plid_model::modes(model)?.iter().filter(structural).map(|mode| mode.hz).collect();
    let short = short(&records, &modes, rate, settings.audit.periods, &mut little.findings);
    let mut leave = |names: Vec<String>, why: String| {
        if !names.is_empty() {
            little.findings.push(format!("Not considered, because {why}: {}.", names.join(", ")));
            little.left_out.extend(names);
        }
    };
    if short == records.len() {
        let names = effects().filter(|e| e.side() == Side::Structure).map(|e| e.name().to_string()).collect();
        leave(names, "no record with an input is long enough for the structure's own motion".into());
    } else if effects().any(|effect| effect.adds_mode())
        && let Some(why) = no_response(&records, m)
    {
        leave(effects().filter(|e| e.adds_mode()).map(|e| e.name().to_string()).collect(), why);
    }

    let setting = Setting::bare(&Plant::with_settings(model, &settings.plant)?, model);
    let starts = records.iter().filter(|record| !record.from_rest).count();
    let linear = modes.len() * (2 + m + p) + starts * n;
    let more = |e: &&dyn Effect| values <= linear + e.parameters(&setting).len();
    let left = effects().filter(more).map(|e| e.name().to_string());
    let names: Vec<String> = left.filter(|name| !little.left_out.contains(name)).collect();
    if !names.is_empty() {
        little.findings.push(format!(
            "Not considered, because their parameters and the {linear} of the linear model are at least as many as \
            the {values} measured values: {}.",
            names.join(", ")
        ));
        little.left_out.extend(names);
    }
    let settling = if case.controller.is_some() { None } else { repeats::settling(&setting.plant) };
    let repeated = || !repeats::differences(&records, settling, settings.prepare.shortest_quiet).is_empty();
    if !noise_shows(case) && !repeated() {
        little.findings.push(unknown_noise(case, model));
    }
    Ok(little)
}

/// Returns the number of records that are shorter than this number of periods of the lowest mode, and adds these
/// records to the findings.
fn short(records: &[&Record], modes: &[f64], rate: f64, periods: f64, findings: &mut Vec<String>) -> usize {
    let lowest = modes.iter().copied().fold(f64::INFINITY, f64::min);
    let short = records.iter().filter(|record| (record.samples() as f64) < periods * rate / lowest);
    let short: Vec<String> = short.map(|r| format!("{} ({:.3} s)", r.name, r.samples() as f64 / rate)).collect();
    if !short.is_empty() {
        let names = short.join(", ");
        findings.push(format!("Shorter than {periods} periods of the lowest mode ({lowest:.1} Hz): {names}."));
    }
    short.len()
}

/// Returns the reason why the random records give no frequency response of m inputs; `None` if they give one.
fn no_response(records: &[&Record], m: usize) -> Option<String> {
    let random = |record: &&&Record| record.excitation == Excitation::Random && record.samples() >= peaks::SEGMENT;
    let stretches = |record: &&Record| 1 + 2 * (record.samples() - peaks::SEGMENT) / peaks::SEGMENT;
    let segments: usize = records.iter().filter(random).map(stretches).sum();
    (segments <= m).then(|| {
        format!(
            "the records with a random input hold {segments} stretches of {} samples, where a frequency response of \
            {m} inputs needs {}",
            peaks::SEGMENT,
            m + 1
        )
    })
}

/// States that no record shows the noise, and which noise is assumed. In closed loop, the part of the error that the
/// inputs do not explain is not the noise of the sensors alone.
fn unknown_noise(case: &Case, model: &Model) -> String {
    let settings = &case.config.settings.prepare;
    let share = 100.0 * settings.undeclared_noise;
    let source = if model.noise.sensor_std.is_some() {
        "The noise that the simulation declares is used".into()
    } else if case.controller.is_some() {
        format!("The simulation declares no noise, so {share:.0} % of each output is assumed")
    } else {
        format!(
            "The simulation declares no noise, so the part of its error that the inputs do not explain is treated as \
            noise, up to {share:.0} % of each output"
        )
    };
    format!(
        "No record shows the noise alone; that would take {} samples without an input or with a repeated one. \
        {source}.",
        settings.shortest_quiet
    )
}

/// Returns whether the noise can be estimated from stretches that no command explains.
fn noise_shows(case: &Case) -> bool {
    let shortest = case.config.settings.prepare.shortest_quiet;
    case.records.iter().filter(|record| !record.held_out).any(|record| match record.excitation {
        Excitation::Zero => record.samples() >= shortest,
        // The first two periods contain the transient.
        Excitation::Periodic(period) => period >= shortest && record.samples() >= 4 * period,
        Excitation::Random => false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{MODES, RATE, case, truss};

    /// Returns the case with every driven record cut to this number of samples.
    fn cut(samples: usize) -> Case {
        let mut case = case(&truss(1), &truss(1));
        for record in case.records.iter_mut().filter(|r| r.excitation != Excitation::Zero) {
            record.u.iter_mut().chain(&mut record.y).for_each(|x| x.truncate(samples));
        }
        case
    }

    #[test]
    fn enough_is_enough() {
        let case = case(&truss(1), &truss(1));
        let little = check(&case, &truss(1), &Library::standard(), &[]).unwrap();
        assert!(little.findings.is_empty() && little.left_out.is_empty(), "{:?}", little.findings);
    }

    #[test]
    fn what_is_too_short_leaves_effects_out() {
        let model = truss(1);
        let library = Library::standard();
        // Longer than three periods of the lowest mode, but shorter than a segment of the frequency response.
        let some = check(&cut(400), &model, &library, &[]).unwrap();
        assert_eq!(some.left_out, ["missing-mode"]);
        assert!(some.findings[0].contains("0 stretches"), "{:?}", some.findings);
        // Shorter than three periods of the lowest mode.
        let least = (3.0 * RATE / MODES[0].0) as usize;
        let few = check(&cut(least - 2), &model, &library, &[]).unwrap();
        assert!(few.findings[0].contains("lowest mode (58.0 Hz)"), "{:?}", few.findings);
        assert!(few.left_out.iter().any(|name| name == "cubic-stiffness"));
        assert!(!few.left_out.iter().any(|name| name == "sensor-gain"));
        // Two records of two outputs with six samples: 24 values, where the linear model alone has 4 (2 + 2 + 2)
        // parameters.
        let none = check(&cut(6), &model, &library, &[]).unwrap();
        assert_eq!(none.left_out.len(), library.len());
        assert!(none.findings.iter().any(|f| f.contains("the 24 of the linear model")), "{:?}", none.findings);
        let error = check(&cut(3), &model, &library, &[]).err().unwrap().to_string();
        assert!(error.contains("12 output values") && error.contains("14 states"), "{error}");
    }

    #[test]
    fn no_input_is_too_little_and_no_quiet_record_is_said() {
        let mut quiet = case(&truss(1), &truss(1));
        quiet.records.retain(|record| record.excitation == Excitation::Zero);
        assert!(matches!(check(&quiet, &truss(1), &Library::standard(), &[]), Err(GapError::TooLittle(_))));
        let mut loud = case(&truss(1), &truss(1));
        loud.records.retain(|record| record.excitation != Excitation::Zero);
        let found = check(&loud, &truss(1), &Library::standard(), &[]).unwrap().findings;
        assert!(found[0].contains("that the simulation declares"), "{found:?}");
        // A repeat of an input shows the noise.
        let mut repeated = loud.clone();
        repeated.records[1].u = repeated.records[0].u.clone();
        assert!(check(&repeated, &truss(1), &Library::standard(), &[]).unwrap().findings.is_empty());
        let mut silent = truss(1);
        silent.noise.sensor_std = None;
        let found = check(&loud, &silent, &Library::standard(), &[]).unwrap().findings;
        assert!(found[0].contains("inputs do not explain") && found[0].contains("up to 1 % of each"), "{found:?}");
    }
}
