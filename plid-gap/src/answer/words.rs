//! The evidence in sentences.

use crate::answer::schema::NamedEffect;
use crate::answer::sensor_noise;
use crate::case::limits::Limit;
use crate::effects::Place;
use crate::evidence::Evidence;
use crate::fit::candidate::{in_words, same};
use crate::fit::problem::Placed;
use crate::judge::explained::{Explained, Refusal};
use crate::judge::judgement::Judgement;
use crate::judge::locate::Map;
use crate::prepare::NoiseFrom;
use crate::settings::JudgeSettings;
use crate::words::likelihood;
use plid_report::percent;

/// Returns the evidence, each item in one or two sentences. `motion` states the kinds of the outputs and the locations
/// of forces. `named` are the effects of the answer. `class` is the most probable explanation, with the explanations
/// that the records cannot separate from it.
pub(crate) fn words(
    explained: &Explained,
    before: &Map,
    judged: &Judgement,
    evidence: &Evidence,
    motion: Vec<String>,
    (named, class): (&[NamedEffect], Option<(String, String)>),
) -> Vec<String> {
    let judge = &explained.ready.problem.settings.judge;
    let mut words = vec![costs(explained)];
    words.extend(limits(explained).into_iter().chain(of_records(explained, named)));
    words.extend(before.slope.map(|slope| {
        format!(
            "The relative gap is proportional to the level to the power {:+.1} ({:+.1} to {:+.1}).",
            slope.value, slope.ci95[0], slope.ci95[1]
        )
    }));
    words.extend(motion);
    let problem = &explained.ready.problem;
    words.extend(evidence.words(&problem.plant, !explained.fit().effects.is_empty(), &problem.settings));
    words.extend(explained.found.best.effects.iter().flat_map(|placed| of_effect(explained, placed)));
    words.extend(explained.ready.not_of_time.iter().map(|effect| {
        format!(
            "{effect} was left out: a change between records that is constant within each fits better, so the effect \
            is not a drift in time."
        )
    }));
    let smaller = smaller(explained, named);
    if !smaller.is_empty() && !named.is_empty() {
        words.push(format!(
            "The prediction also contains {}, whose contribution is too small to be named as a cause.",
            smaller.join(" and ")
        ));
    }
    words.extend(explained.offsets.iter().map(|offset| {
        format!(
            "The prediction also contains a constant error that all driven records share: {}.",
            in_words(std::slice::from_ref(offset), &problem.setting.names)
        )
    }));
    words.extend(nearest_other(explained));
    words.extend(class.map(|(first, others)| {
        format!(
            "These records cannot distinguish {first} from {others}: if the first is true, the others are expected to \
            fit worse by less than {:.0} in log likelihood. The next experiment is chosen to distinguish them.",
            judge.separable
        )
    }));
    words.extend(of_held_out(judged, judge).into_iter().chain(of_parts(judged)));
    let excess = explained.judged.excess;
    words.push(format!(
        "The residual exceeds the noise by {excess:.1} times the uncertainty of the noise power, which is {}.",
        percent(explained.level.uncertainty)
    ));
    words
}

/// States how much better or worse than the refit the explanation fits the held-out records.
fn of_held_out(judged: &Judgement, judge: &JudgeSettings) -> Option<String> {
    judged.held_out.map(|held_out| {
        let (comparison, refuted) = if held_out.gain < 0.0 {
            ("worse", ", so it is not accepted")
        } else {
            ("better", ", too little for it to be accepted")
        };
        format!(
            "On the held-out records, the best explanation fits {comparison} than the refit by {} ({:.0} standard \
            deviations){}.",
            likelihood(held_out.gain.abs() / 2.0),
            held_out.gain.abs() / held_out.deviation.max(f64::MIN_POSITIVE),
            if held_out.refutes(judge) { refuted } else { "" },
        )
    })
}

/// States that fits to some of the records do not predict the others, if so.
fn of_parts(judged: &Judgement) -> Option<String> {
    judged.predicted_as_given.map(|as_given| {
        format!(
            "Fits to some of the fitted records, or to parts of them, leave a gap of {} in the rest, where the \
            simulation as given leaves {}. The explanation is therefore not accepted.",
            percent(judged.gaps.crossed_gap),
            percent(as_given)
        )
    })
}

/// Returns the effects of the best explanation that are in the prediction but not named as causes.
pub(crate) fn smaller(explained: &Explained, named: &[NamedEffect]) -> Vec<String> {
    let names = &explained.ready.problem.setting.names;
    let is_named = |placed: &Placed| {
        let at = placed.place.location(names);
        named.iter().any(|named| named.effect == placed.effect.name() && named.location == at)
    };
    let others = explained.found.best.effects.iter().filter(|placed| !is_named(placed));
    others.map(|placed| in_words(std::slice::from_ref(placed), names)).collect()
}

fn costs(explained: &Explained) -> String {
    let rows = explained.ready.problem.values();
    format!(
        "Mean squared residual relative to the noise: {:.3} as given, {:.3} after the bounded refit, {:.3} with the \
        best explanation (1 = noise only).",
        explained.given_cost / rows,
        explained.refitted.cost / rows,
        explained.found.best.cost / rows
    )
}

/// States which assumptions were dropped, namely that the simulation is exact to within its limits or that the
/// remainder is not noise, and which explanations were refused.
fn limits(explained: &Explained) -> Vec<String> {
    let names = &explained.ready.problem.setting.names;
    let imperfect = explained.ready.widened.map(|scale| {
        format!(
            "No explanation leaves only noise, so the residual of the best one is treated as an error of the \
            simulation itself. The standard deviations of its parameters are taken to be {scale:.1} times those \
            that the case states, which are half of its limits.{}",
            by_kind(explained, scale)
        )
    });
    let unpredicted = explained.unpredicted.as_ref().map(|noise| {
        format!(
            "No record shows the noise level. Polynomials of the inputs predict at most {} of the innovations of the \
            remainder, which is therefore treated as noise.",
            percent(noise.at_most)
        )
    });
    let refused = explained.refused.iter().map(|(effects, why)| {
        let effects = in_words(effects, names);
        match why {
            Refusal::Diverges(record) => format!(
                "The explanation {effects} fitted best, but its simulation of `{record}` diverges, so it was rejected."
            ),
            Refusal::FitsNoise => format!(
                "The explanation {effects} was rejected as overfitting: it does not explain the records that were \
                held out."
            ),
            Refusal::Overfits => format!(
                "The explanation {effects} fitted best, but predicts the held-out records worse than the simulation \
                without effects, so the next explanation that predicts them better was chosen."
            ),
            Refusal::Outdone => format!(
                "The explanation {effects} fits the records as well, but predicts the held-out ones much worse than \
                the explanation that was chosen."
            ),
            Refusal::Untimely => format!(
                "The explanation {effects} fits better, but leaves most of the gap of the held-out records, which a \
                change over time closes."
            ),
            Refusal::BesideNoise => format!(
                "In addition to the noise-like effects, the explanation {effects} fitted best, but most of the \
                remaining gap is left, so it is not named."
            ),
        }
    });
    imperfect.into_iter().chain(unpredicted).chain(refused).collect()
}

/// States by how much the frequencies, the damping ratios and the shapes are off, where the records determine enough
/// of them. `scale` is the factor by which the prior of all of them was widened.
fn by_kind(explained: &Explained, scale: f64) -> String {
    let Explained { ready, refitted, .. } = explained;
    let (problem, eta) = (&ready.problem, &explained.fit().eta);
    let determined = problem.settings.fit.determined;
    let kinds =
        [(Limit::Frequency, "frequencies"), (Limit::Damping, "damping ratios"), (Limit::Shape, "shapes or gains")];
    let off = kinds.iter().filter_map(|(limit, kind)| {
        let off = scale * problem.nuisance.off(*limit, eta, &refitted.jacobian, determined)?;
        Some(format!("{off:.1} for {kind}"))
    });
    let off: Vec<String> = off.collect();
    if off.is_empty() {
        return String::new();
    }
    format!(" With this explanation, the factor is {}.", off.join(", "))
}

/// States the findings from the noise of the records and from raw values.
fn of_records(explained: &Explained, named: &[NamedEffect]) -> Vec<String> {
    let ready = &explained.ready;
    // A residual that counts as noise does not show the noise of the sensors.
    let declared = if explained.unpredicted.is_none() { sensor_noise::in_words(ready, named) } else { Vec::new() };
    let from = match ready.noise_from {
        _ if explained.unpredicted.is_some() => None,
        NoiseFrom::Repeats => {
            Some("No record is quiet. The noise was found from the differences between repeats of an input.")
        }
        NoiseFrom::Unexplained(_) => Some(
            "No record shows the noise alone. It was found from the part of the driven records that the inputs do not \
            explain.",
        ),
        NoiseFrom::Quiet | NoiseFrom::Assumed => None,
    };
    let random = explained.level.driven.map(|ratio| {
        format!(
            "The differences between the periods of driven records have {ratio:.2} times the power of the noise in \
            quiet records, so a random effect acts in the driven ones."
        )
    });
    let setting = &ready.problem.setting;
    let outputs = ready.quantisation.iter().zip(&setting.names.outputs).enumerate();
    let cut = outputs.filter(|(_, (quantisation, _))| quantisation.cut);
    let cut = cut.map(|(o, (quantisation, output))| {
        let unit = setting.unit("V", &Place::Output(o));
        format!(
            "The converter of {output} truncates towards zero. Half a step, {:.4} {unit}, was added to its values \
            before all fits.",
            quantisation.step / 2.0
        )
    });
    from.map(String::from).into_iter().chain(random).chain(declared).chain(cut).collect()
}

/// States the share of an effect's response that a refit could absorb, and any caveat on the name of the effect.
fn of_effect(explained: &Explained, placed: &Placed) -> Vec<String> {
    let at = format!("{} at {}", placed.effect.name(), placed.place.location(&explained.ready.problem.setting.names));
    let entry = explained.found.stages.iter().flatten().find(|e| same(&e.placed, placed));
    let share = entry.map(|entry| 100.0 * entry.absorbed);
    let absorbed = share.map(|share| format!("{at}: a linear refit could absorb {share:.0} % of its response."));
    let caveat = placed.effect.caveat(&placed.parameters).map(|caveat| format!("{at}: {caveat}."));
    absorbed.into_iter().chain(caveat).collect()
}

fn nearest_other(explained: &Explained) -> Option<String> {
    let found = &explained.found;
    let best = &found.best;
    // An explanation that replaced a refused one was fitted again, whereas the others were not, so their costs are not
    // comparable.
    if best.effects.is_empty()
        || explained.refused.iter().any(|(_, why)| {
            matches!(why, Refusal::Diverges(_) | Refusal::Overfits | Refusal::Outdone | Refusal::Untimely)
        })
    {
        return None;
    }
    let within_best = |effects: &[Placed]| effects.iter().all(|a| best.effects.iter().any(|b| same(a, b)));
    let other = found.candidates.iter().find(|c| !c.effects.is_empty() && !within_best(&c.effects))?;
    let worse = (other.cost - best.cost) / 2.0;
    let how = if worse < 0.0 {
        let parameters = other.effects.iter().map(|placed| placed.parameters.len()).sum::<usize>();
        let more = parameters.saturating_sub(best.parameters());
        format!("fits better by {}, with {more} more parameters, and is less probable", likelihood(-worse))
    } else {
        format!("is worse by {}", likelihood(worse))
    };
    let other = in_words(&other.effects, &explained.ready.problem.setting.names);
    Some(format!("The second-best explanation, {other}, {how}."))
}
