//! The simulation with its effects, in a form for other programs.

use std::collections::BTreeMap;

use plid_model::Model;

use crate::answer::range::{FittedRange, displacement_peaks};
use crate::answer::schema::{Gap, SimulationWithEffects, Value, WrittenEffect};
use crate::case::Intersample;
use crate::effects::{Parameter, Place, Setting};
use crate::fit::problem::{Placed, Problem};
use crate::judge::explained::Explained;
use crate::judge::offsets;
use crate::search::stochastic::{Stochastic, wanders};
use crate::simulate::changed_plant;

/// Returns, for each mode, its frequency in Hz and the changes by the bounded refit in standard deviations of the
/// prior: the change of the frequency, the change of the damping ratio, and the largest change of the shapes.
pub(crate) fn refit_summary(problem: &Problem, eta: &[f64]) -> Vec<(f64, f64, f64, f64)> {
    let mut modes: Vec<(f64, f64, f64, f64)> = problem.plant.modes.iter().map(|m| (m.hz(), 0.0, 0.0, 0.0)).collect();
    for (index, (x, std)) in eta.iter().zip(&problem.nuisance.std).enumerate() {
        let Some((mode, part)) = problem.nuisance.entry(index) else { continue };
        let z = x / std;
        match part {
            0 => modes[mode].1 = z,
            1 => modes[mode].2 = z,
            _ if z.abs() > modes[mode].3.abs() => modes[mode].3 = z,
            _ => {}
        }
    }
    modes
}

/// Returns the contents of sim-with-effect.json: the linear model after the bounded refit (`eta`), the effects of the
/// prediction (`fitted`), and the stochastic effects (`shown`). A line whose phase wanders is part of the noise and is
/// left out. The two models are that of the audited case and the simulation as given. `gap` contains the gaps without
/// and with the effects.
pub(crate) fn written(
    explained: &Explained,
    (model, given): (&Model, &Model),
    intersample: Intersample,
    eta: &[f64],
    fitted: &[Placed],
    shown: &[&Stochastic],
    gap: &Gap,
) -> SimulationWithEffects {
    let ready = &explained.ready;
    let plant = &ready.problem.nuisance.apply(&ready.problem.plant, eta);
    let setting = &ready.problem.setting;
    let refitted = Setting { plant: plant.clone(), ..setting.clone() };
    let records = &ready.problem.records;
    let t0 =
        records.iter().chain(&ready.held_out).map(|r| r.start_s + r.samples() as f64 / plant.rate).fold(0.0, f64::max);
    let offsets: Vec<Placed> =
        plant.offsets.iter().enumerate().map(|(o, &offset)| offsets::placed(o, offset)).collect();
    let effects = (offsets.iter())
        .chain(fitted)
        .chain(shown.iter().map(|stochastic| &stochastic.placed).filter(|placed| !wanders(placed)))
        .map(|placed| written_effect(placed, setting, &refitted))
        .collect();
    let peaks: Vec<Vec<f64>> = records.iter().map(|record| displacement_peaks(plant, &record.u)).collect();
    let modal = changed_plant(plant, &ready.problem.actions(fitted));
    let refit = refit_summary(&ready.problem, eta)
        .iter()
        .zip(ready.problem.plant.modes.iter().zip(&plant.modes))
        .map(|(z, (from, to))| {
            format!(
                "mode {:.2} Hz: frequency {:.3} -> {:.3} Hz, damping ratio {:.4} -> {:.4}, shapes by up to {:.2} \
                standard deviations of the stated limits",
                from.hz(),
                from.hz(),
                to.hz(),
                from.damping(),
                to.damping(),
                z.3.abs()
            )
        })
        .chain(ready.problem.nuisance.rest_in_words(eta, &setting.names.inputs, &setting.names.outputs))
        .collect();
    SimulationWithEffects {
        format: "simulation-with-effects".into(),
        linear: plant.to_model(model).to_json(),
        modes: plant.modes.len(),
        linear_with_modal_effects: modal.map(|modal| modal.to_model(model).to_json()),
        as_given: Some(given.to_json()),
        controller: plant.controller.as_ref().map(|controller| controller.model.to_json()),
        refit,
        intersample,
        effects,
        t0,
        noise_rms: explained.noise_rms(),
        fitted: Some(FittedRange::of(records, &peaks, gap.predicted_held_out_gap, gap.noise_floor)),
        plant: ready.problem.settings.plant.clone(),
    }
}

/// Returns an effect in a form for other programs. `refitted` is the setting with the linear simulation after the fit.
pub(crate) fn written_effect(placed: &Placed, setting: &Setting, refitted: &Setting) -> WrittenEffect {
    let parameters = placed.effect.parameters(setting).into_iter().zip(&placed.parameters);
    let value = |(p, &value): (Parameter, &f64)| {
        let unit = setting.unit_of(&p, &placed.place);
        (p.name, Value { value, ci95: None, unit })
    };
    WrittenEffect {
        effect: placed.effect.name().into(),
        location: written_place(placed, setting),
        parameters: parameters.map(value).collect(),
        given: given(placed, refitted),
        equation: placed.effect.equation().into(),
    }
}

/// Returns the numbers of the simulation and of the records that the equation of an effect uses.
fn given(placed: &Placed, setting: &Setting) -> BTreeMap<String, Value> {
    let value = |(name, value, unit): (&str, f64, &str)| (name.into(), Value { value, ci95: None, unit: unit.into() });
    placed.effect.given(setting, &placed.place).into_iter().map(value).collect()
}

/// Returns an effect's location. For a disturbance, the location includes the port, which a prediction needs.
fn written_place(placed: &Placed, setting: &Setting) -> String {
    let location = placed.place.location(&setting.names);
    match placed.place {
        Place::Frequency(_, port) => format!("{location} port:{}", setting.names.ports[port]),
        _ => location,
    }
}
