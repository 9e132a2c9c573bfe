//! Step 9: the answer in names, figures and words.

pub mod predict;
mod range;
pub mod schema;
pub(crate) mod simulation;
pub(crate) mod whole_delay;

pub use range::{Beyond, FittedRange};

use std::collections::BTreeMap;

use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::answer::schema::{Change, Comparison, Gap, Located, NamedEffect, Remainder, RemainderPlace, Value, Where};
use crate::effects::{Names, Setting, Side};
use crate::evidence::Beside;
use crate::fit::candidate::{all_same, in_words, joined, same};
use crate::fit::problem::Placed;
use crate::judge::explained::Explained;
use crate::judge::gap::{self, Blocks};
use crate::judge::held_out::HeldOut;
use crate::judge::locate::Map;
use crate::judge::separability::{Rival, open};
use crate::judge::shares::Share;
use crate::judge::verdict::{Verdict, Weighted, outside};
use crate::search::stepwise::Search;
use crate::search::stochastic::{Unseen, cuts, wanders};
use crate::settings::thresholds::{NEXT, SEPARABLE};
use crate::words::percent;
use plid_report::Cell;

/// Effects of the answer with intervals and confidence.
pub(crate) fn named(
    explained: &Explained,
    shown: &[&Unseen],
    weighted: &[Weighted],
    shares: &[Share],
    left: f64,
) -> Vec<NamedEffect> {
    let (ready, best) = (&explained.ready, &explained.found.best);
    let free_shape = explained.bent.as_ref().map(|bent| bent.which);
    let setting = &ready.problem.setting;
    let names = &setting.names;
    let rows = ready.problem.rows() as f64;
    let quantile = StudentsT::new(0.0, 1.0, rows.max(3.0)).map_or(1.96, |t| t.inverse_cdf(0.975));
    let confidence = |placed: &Placed| -> f64 {
        weighted.iter().filter(|w| w.effects.iter().any(|e| same(e, placed))).map(|w| w.probability).sum()
    };
    let problem = &ready.problem;
    let refitted = Setting { plant: problem.nuisance.apply(&problem.plant, &best.eta), ..setting.clone() };
    let mut at = 0;
    let mut named = Vec::new();
    for (which, placed) in best.effects.iter().enumerate() {
        let mut parameters = BTreeMap::new();
        let first = at;
        let half = |at: usize| quantile * best.covariance[(at, at)].max(0.0).sqrt();
        for (parameter, &value) in placed.effect.parameters(setting).into_iter().zip(&placed.parameters) {
            parameters.insert(parameter.name, stated(value, half(at), parameter.unit));
            at += 1;
        }
        let share = shares.get(which);
        // What closes little beside what is left may be its imitation.
        let alone = |share: &Share| ((1.0 - outside(share.left)) / (1.0 - outside(left))).min(1.0);
        let imitated = if ready.widened.is_some() { share.map_or(1.0, alone) } else { 1.0 };
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(names),
            confidence: confidence(placed) * imitated,
            share: share.map(|share| share.value),
            share_ci95: share.map(|share| share.ci95),
            parameters,
            change: changed(placed, setting, &refitted, half(first)),
            shape_differs: free_shape == Some(which),
        });
    }
    for Unseen { placed, doubt, .. } in shown {
        let all = placed.effect.parameters(setting).into_iter().zip(placed.parameters.iter().zip(doubt));
        // What is known to the last digit is known to rounding.
        let half = |value: f64, doubt: f64| (1.96 * doubt).max(1e-9 * value.abs());
        let parameters = all.map(|(p, (&value, &doubt))| (p.name, stated(value, half(value, doubt), p.unit))).collect();
        named.push(NamedEffect {
            effect: placed.effect.name().into(),
            location: placed.place.location(names),
            confidence: confidence(placed),
            share: None,
            share_ci95: None,
            parameters,
            change: None,
            shape_differs: cuts(placed) || wanders(placed),
        });
    }
    named
}

/// Which number of the simulation an effect changes, beside what the refit has changed of it; `half` is half the interval of its parameter, in which
/// that number is linear.
fn changed(placed: &Placed, setting: &Setting, refitted: &Setting, half: f64) -> Option<Change> {
    let &[value] = placed.parameters.as_slice() else { return None };
    let at = |setting: &Setting, parameter: f64| placed.effect.change(setting, &placed.place, &[parameter]);
    let [given, to, end] = [at(setting, value)?, at(refitted, value)?, at(refitted, value + half)?];
    let to = stated(to.to, (end.to - to.to).abs(), to.unit.into());
    Some(Change { number: given.number, from: given.from, to })
}

/// A value with half the length of its interval; none where nothing bounds it.
fn stated(value: f64, half: f64, unit: String) -> Value {
    Value { value, ci95: half.is_finite().then_some([value - half, value + half]), unit }
}

pub(crate) fn place(before: &Map, outputs: &[String], found: &Search, shown: &[&Unseen]) -> Where {
    let named = found.best.effects.first().map(|placed| placed.effect.side());
    let screened = found.stages.first().and_then(|entries| entries.first()).map(|e| e.placed.effect.side());
    let side = named.or(shown.first().map(|u| u.placed.effect.side())).or(screened).unwrap_or(Side::Structure);
    let mut order: Vec<usize> = (0..before.bands.len()).collect();
    order.sort_by(|&a, &b| before.bands[b].value.total_cmp(&before.bands[a].value));
    order.truncate(4);
    order.retain(|&b| before.bands[b].value > 0.02);
    let by_name = || outputs.iter().cloned().zip(&before.outputs);
    Where {
        side,
        channels: by_name().map(|(name, share)| (name, share.value)).collect(),
        bands_hz: order.iter().map(|&b| [before.edges[b], before.edges[b + 1], before.bands[b].value]).collect(),
        time: before.stretches.iter().map(|share| share.value).collect(),
        level_slope: before.slope.map(|slope| slope.value),
        channels_ci95: by_name().map(|(name, share)| (name, share.ci95)).collect(),
        bands_ci95: order.iter().map(|&b| before.bands[b].ci95).collect(),
        time_ci95: before.stretches.iter().map(|share| share.ci95).collect(),
        level_slope_ci95: before.slope.map(|slope| slope.ci95),
        levels: before.levels.clone(),
    }
}

/// Explanations that these records cannot part from the best, with it: the most probable first.
pub(crate) fn classes(found: &Search, best: &[Placed], rivals: &[Rival], names: &Names) -> Vec<Vec<String>> {
    let mut class: Vec<&[Placed]> = open(rivals, best).map(|rival| rival.effects.as_slice()).chain([best]).collect();
    if class.len() < 2 {
        return Vec::new();
    }
    let place =
        |effects: &[Placed]| found.candidates.iter().position(|candidate| all_same(&candidate.effects, effects));
    class.sort_by_key(|effects| place(effects));
    vec![class.into_iter().map(|effects| joined(effects, names, "@")).collect()]
}

/// What the best cannot be told from, in words.
pub(crate) fn others(best: &[Placed], rivals: &[Rival], names: &Names) -> Option<String> {
    let texts: Vec<String> = open(rivals, best).map(|rival| in_words(&rival.effects, names)).collect();
    (!texts.is_empty()).then(|| texts.join(", nor from "))
}

/// Whether the records could part the best explanation from others: itself first, then those that it was held against after the fits, then
/// the entries of the first screen that did not come so far.
pub(crate) fn comparisons(found: &Search, best: &[Placed], rivals: &[Rival], names: &Names) -> Vec<Comparison> {
    let entries = found.stages.first().map_or(&[][..], Vec::as_slice);
    let overlap = found.overlap.as_ref();
    let leading = overlap.map_or(0, |overlap| overlap.absorbed.len());
    let place = |placed: &Placed| entries[..leading].iter().position(|entry| same(&entry.placed, placed));
    // Which effect the others would stand in for.
    let reference = if best.is_empty() { (leading > 0).then_some(0) } else { best.iter().find_map(place) };
    let before = |entry: Option<usize>, explanation: String| Comparison {
        explanation,
        absorbed: overlap.zip(entry).map(|(overlap, entry)| overlap.absorbed[entry]),
        cosine: overlap.zip(reference).zip(entry).map(|((overlap, from), entry)| overlap.cosine[(from, entry)]),
        expected_before: overlap.zip(reference).zip(entry).map(|((overlap, from), to)| overlap.expected[(from, to)]),
        expected: None,
        realised: None,
    };
    let mut rows = Vec::new();
    if !best.is_empty() {
        let own = before(reference, joined(best, names, "@"));
        rows.push(Comparison { expected: Some(0.0), realised: Some(0.0), ..own });
    }
    // The entry that takes the place of the reference in a rival.
    let stand_in = |rival: &Rival| {
        let replaced = &entries[reference?].placed;
        let kept = |placed: &Placed| best.iter().any(|b| !same(b, replaced) && same(b, placed));
        let new: Vec<&Placed> = rival.effects.iter().filter(|placed| !kept(placed)).collect();
        if let [one] = new.as_slice() { place(one) } else { None }
    };
    let mut listed: Vec<usize> = best.iter().filter_map(place).collect();
    for rival in rivals {
        let entry = stand_in(rival);
        listed.extend(entry);
        let row = before(entry, joined(&rival.effects, names, "@"));
        rows.push(Comparison { expected: Some(rival.expected), realised: Some(rival.realised), ..row });
    }
    // What was fitted in place of the reference and came too far off.
    let fitted = |entry: usize| {
        let replaced = &entries[reference?].placed;
        let one = |placed: &Placed| same(placed, &entries[entry].placed);
        let kept = |placed: &Placed| best.iter().any(|b| !same(b, replaced) && same(b, placed));
        let same_but_for_it = |effects: &[Placed]| {
            effects.len() == best.len() && effects.iter().any(one) && effects.iter().all(|p| one(p) || kept(p))
        };
        found.candidates.iter().find(|candidate| same_but_for_it(&candidate.effects))
    };
    let own = found.candidates.iter().find(|candidate| !best.is_empty() && all_same(&candidate.effects, best));
    for entry in (0..leading).filter(|entry| !listed.contains(entry)) {
        let candidate = fitted(entry);
        let effects = candidate.map_or(std::slice::from_ref(&entries[entry].placed), |candidate| &candidate.effects);
        let realised = candidate.zip(own).map(|(candidate, own)| 0.5 * (candidate.cost - own.cost));
        rows.push(Comparison { realised, ..before(Some(entry), joined(effects, names, "@")) });
    }
    rows
}

/// A gap with the effects beyond this many times the noise is said to leave something.
const LEFT: f64 = 1.1;

/// A gap as given within this factor of the noise has nothing to shrink.
const NOISE_ONLY: f64 = 1.1;

/// What becomes of a gap, which effects that were fitted to other records may also widen.
fn course(from: f64, to: f64) -> String {
    match [percent(from), percent(to)] {
        [from, to] if from == to => format!("the gap stays at {to}"),
        [before, after] => format!("the gap {} from {before} to {after}", if to > from { "grows" } else { "falls" }),
    }
}

/// Where most of a remainder lies, in words; `after` is its map over outputs and bands, and `beyond` its size beyond the noise, of a gap of `given`.
pub(crate) fn remains(after: &Map, outputs: &[String], beyond: f64, given: f64) -> String {
    let cells = (0..after.share.nrows()).flat_map(|o| (0..after.share.ncols()).map(move |b| (o, b)));
    let Some((o, b)) = cells.max_by(|x, y| after.share[*x].total_cmp(&after.share[*y])) else { return String::new() };
    let hz = 0.5 * (after.edges[b] + after.edges[b + 1]);
    let what =
        if beyond < SMALL * given { "Something small".to_string() } else { format!("A gap of {}", percent(beyond)) };
    format!(" {what} remains near {} Hz at {}.", Cell::significant(hz, 2), outputs[o])
}

/// What the best explanation leaves: of the opened records in size, of the fitted ones in place.
pub(crate) fn remainder(explained: &Explained, gap: &Gap, after: &Map, with: &Blocks, material: f64) -> Remainder {
    let names = &explained.ready.problem.setting.names;
    let found = &explained.found;
    let floor = gap.noise_floor;
    let beyond = |gap: f64| (gap * gap - floor * floor).max(0.0);
    let place = place(after, &names.outputs, found, &[]);
    let best = &found.best.effects;
    let last = found.stages.last().map_or(&[][..], Vec::as_slice);
    let more = last.iter().filter(|entry| entry.gain > NEXT && !best.iter().any(|placed| same(placed, &entry.placed)));
    Remainder {
        gap: gap.with_effect,
        noise: floor,
        share_of_gap: if beyond(gap.as_given) > 0.0 {
            (beyond(gap.with_effect) / beyond(gap.as_given)).min(1.0)
        } else {
            0.0
        },
        further_cause: gap::how_often([with], |[with]| beyond(with) > material * material),
        place: RemainderPlace { channels: place.channels, bands_hz: place.bands_hz },
        nearest: more
            .take(MOST_NEAREST)
            .map(|entry| Located {
                effect: entry.placed.effect.name().into(),
                location: entry.placed.place.location(names),
            })
            .collect(),
    }
}

/// Of the gap as given, in amplitude: what is smaller is small.
const SMALL: f64 = 0.1;

/// Entries of a screen that are said to come nearest to a remainder.
const MOST_NEAREST: usize = 3;

/// The answer in a sentence. `remains` says where what is left beside an imperfect simulation lies. `nearest` is the best explanation, whether it suffices or not; `seen` says whether the records show the noise.
pub(crate) fn sentence(
    verdict: Verdict,
    effects: &[NamedEffect],
    nearest: &[String],
    gap: &Gap,
    seen: bool,
    remains: Option<&str>,
) -> String {
    let noise = if seen {
        format!("noise {}", percent(gap.noise_floor))
    } else {
        "what noise makes, these records do not show".to_string()
    };
    let beyond = (gap.with_effect.powi(2) - gap.noise_floor.powi(2)).max(0.0).sqrt();
    match verdict {
        Verdict::None => format!(
            "Nothing is missing: within its stated limits the simulation explains the records down to {} ({noise}).",
            percent(gap.refit),
        ),
        Verdict::Unknown if nearest.is_empty() => format!(
            "Something outside the vocabulary: no effect explains the gap of {}, of which a refit leaves {} ({noise}).",
            percent(gap.as_given),
            percent(gap.refit),
        ),
        Verdict::Unknown => format!(
            "Something outside the vocabulary: with what comes nearest, {}, {} ({noise}), and a refit alone leaves {}.",
            nearest.join(" and "),
            course(gap.as_given, gap.with_effect),
            percent(gap.refit),
        ),
        Verdict::Effects => {
            let one = |e: &NamedEffect| {
                let differs = if e.shape_differs { " (its shape differs)" } else { "" };
                format!("{} at {}{differs}", e.effect, e.location)
            };
            let all = effects.iter().map(one).collect::<Vec<_>>().join(" and ");
            let sure = 100.0 * effects.iter().map(|e| e.confidence).fold(1.0, f64::min);
            let random = |e: &NamedEffect| matches!(e.effect.as_str(), "coloured-disturbance" | "sensor-noise");
            if gap.as_given < NOISE_ONLY * gap.noise_floor || effects.iter().all(random) {
                return format!(
                    "{all} ({sure:.0} % sure): it is noise that no simulation predicts, {} of the output, of a gap of {}.",
                    percent(gap.noise_floor),
                    percent(gap.as_given),
                );
            }
            if let (Some(remains), [main, beside @ ..]) = (remains, effects) {
                let beside = beside.iter().map(one).collect::<Vec<_>>().join(" and ");
                let beside = if beside.is_empty() { beside } else { format!(", with {beside} beside it") };
                return format!(
                    "Mostly {} ({:.0} % sure){beside}: with {} the gap on held-out records{}, and {} of that is noise.{remains}",
                    one(main),
                    100.0 * main.confidence,
                    if effects.len() == 1 { "it" } else { "them" },
                    course(gap.as_given, gap.with_effect).trim_start_matches("the gap"),
                    percent(gap.noise_floor),
                );
            }
            // Samples that drop out are no part of what a simulation can follow.
            let drops = effects.iter().any(|e| e.effect == "sensor-dropout");
            let rest = if seen && !drops && gap.with_effect > LEFT * gap.noise_floor {
                format!(" {} of the output stays unexplained.", percent(beyond))
            } else {
                String::new()
            };
            format!(
                "{all} ({sure:.0} % sure): with {} {} ({noise}).{rest}",
                if effects.len() == 1 { "it" } else { "them" },
                course(gap.as_given, gap.with_effect),
            )
        }
    }
}

/// The evidence in words. `class` is the most probable explanation and what the records cannot part from it.
pub(crate) fn words(
    explained: &Explained,
    before: &Map,
    held_out: Option<HeldOut>,
    beside: &Beside,
    class: Option<(&str, &str)>,
) -> Vec<String> {
    let Explained { ready, refitted, found, judged, level, given_cost, diverged, .. } = explained;
    let rows = ready.problem.rows() as f64;
    let names = &ready.problem.setting.names;
    let mut words = vec![format!(
        "Squared residual over noise: {:.3} as given, {:.3} after the bounded refit, {:.3} with the best explanation (1 is noise alone).",
        given_cost / rows,
        refitted.cost / rows,
        found.best.cost / rows
    )];
    if let Some(scale) = ready.widened {
        words.push(format!(
            "No explanation leaves only noise, so that what the best one leaves counts as an error of the simulation itself. Most of its numbers are off by {scale:.1} times what the case says of them."
        ));
    }
    if let Some((effects, record)) = diverged {
        words.push(format!(
            "{} came nearest, but its free run of `{record}` has no bounds: it was refused.",
            in_words(effects, names)
        ));
    }
    if let Some(ratio) = level.driven {
        words.push(format!(
            "What differs between the periods of driven records has {ratio:.2} times the power of the noise in quiet ones: something random acts there."
        ));
    }
    for (codes, output) in ready.codes.iter().zip(&names.outputs).filter(|(codes, _)| codes.cut) {
        words.push(format!(
            "The converter of {output} cuts bits off towards zero: to its values half a step, {:.4} V, was added before anything was fitted.",
            codes.step / 2.0
        ));
    }
    if let Some(slope) = before.slope {
        words.push(format!(
            "The relative gap goes with the level to the power {:+.1} ({:+.1} to {:+.1}).",
            slope.value, slope.ci95[0], slope.ci95[1]
        ));
    }
    words.extend(beside.words(&ready.problem.plant, !explained.fit().effects.is_empty()));
    for placed in &found.best.effects {
        if let Some(entry) = found.stages.iter().flatten().find(|e| same(&e.placed, placed)) {
            words.push(format!(
                "{} at {}: a refit would absorb {:.0} % of its trace.",
                placed.effect.name(),
                placed.place.location(names),
                100.0 * entry.absorbed
            ));
        }
        if let Some(doubt) = placed.effect.doubt(&placed.parameters) {
            words.push(format!("{} at {}: {doubt}.", placed.effect.name(), placed.place.location(names)));
        }
    }
    let other = found
        .candidates
        .iter()
        .find(|c| !c.effects.is_empty() && !c.effects.iter().all(|a| found.best.effects.iter().any(|b| same(a, b))));
    // What took the place of a refused one was fitted anew, and the others were not.
    if let (Some(other), false, None) = (other, found.best.effects.is_empty(), diverged) {
        let worse = (other.cost - found.best.cost) / 2.0;
        let how = if worse < 0.0 {
            let parameters = |effects: &[Placed]| effects.iter().map(|placed| placed.parameters.len()).sum::<usize>();
            let more = parameters(&other.effects).saturating_sub(found.best.parameters());
            format!("fits better by {:.0} in log likelihood, with {more} parameters more, and is less probable", -worse)
        } else {
            format!("is worse by {worse:.0} in log likelihood")
        };
        words.push(format!("The nearest other explanation, {}, {how}.", in_words(&other.effects, names)));
    }
    if let Some((first, others)) = class {
        words.push(format!(
            "These records cannot tell {first} from {others}: if the first is true, the rest is expected to fit worse by less than {SEPARABLE:.0} in log likelihood. The next experiment is chosen to part them.",
        ));
    }
    if let Some(held_out) = held_out {
        words.push(format!(
            "On what was held out from all fitting it gains {:.0} in log likelihood over a refit alone, {:.0} times what chance would make of it{}.",
            held_out.gain / 2.0,
            held_out.gain / held_out.deviation.max(f64::MIN_POSITIVE),
            if held_out.refutes() { ": too little, which refutes it" } else { "" },
        ));
    }
    words.push(format!("What is left exceeds the noise by {:.1} times the uncertainty of its level.", judged.excess));
    words
}

#[cfg(test)]
mod tests {
    use crate::diagnose::diagnose;
    use crate::effects::Library;
    use crate::testing::{case, truss, truss_with};

    /// A name that nothing has is an error with what comes nearest, and not left out in silence.
    #[test]
    fn names_that_do_not_exist_are_refused() {
        let ask = |exclude: &str| {
            let mut case = case(&truss(1), &truss(1));
            case.config.exclude = vec![exclude.into()];
            diagnose(&case, &Library::standard(), &mut |_| {})
        };
        for (wrong, right) in [("cubic-stifness", "cubic-stiffness"), ("input:u11", "input:u1")] {
            let message = ask(wrong).err().unwrap().to_string();
            assert!(message.contains("exclude") && message.contains(&format!("did you mean `{right}`")), "{message}");
        }
        assert!(ask("mode:123.4").is_ok());
    }

    #[test]
    fn a_gap_that_grows_is_not_said_to_fall() {
        assert_eq!(super::course(0.145, 0.16), "the gap grows from 14.5 % to 16.0 %");
        assert_eq!(super::course(0.145, 0.009), "the gap falls from 14.5 % to 0.90 %");
        assert_eq!(super::course(0.0137, 0.0138), "the gap stays at 1.4 %");
    }

    /// A frequency, a damping ratio and a factor: which number of the simulation is to change, from what to what.
    #[test]
    fn numbers_of_the_simulation_are_said() {
        let real = truss(1);
        let (hz, zeta) = crate::testing::MODES[1];
        let frequency = (truss_with(1, |modes, _, _| modes[1].0 = 1.02 * hz), "frequency of the mode at 139.7 Hz", hz);
        let damping =
            (truss_with(1, |modes, _, _| modes[1].1 = 2.0 * zeta), "damping ratio of the mode at 137.0 Hz", zeta);
        let factor = (truss_with(1, |_, _, shapes| shapes.row_mut(1).scale_mut(1.25)), "factor of output y2", 0.8);
        for (sim, number, truth) in [frequency, damping, factor] {
            let outcome = diagnose(&case(&sim, &real), &Library::standard(), &mut |_| {}).unwrap();
            let [named] = outcome.diagnosis.effects.as_slice() else { panic!("{}", outcome.diagnosis.sentence) };
            let change = named.change.as_ref().unwrap();
            assert_eq!(change.number, number);
            let [low, high] = change.to.ci95.unwrap();
            assert!(
                low < truth && truth < high && (change.to.value / truth - 1.0).abs() < 0.02,
                "{change}, not {truth}"
            );
            assert!((change.from / truth - 1.0).abs() > 0.015, "{change}");
        }
    }
}
