//! The statements beside the causes, in sentences: what remains, how good a prediction will be, and on which records
//! the gaps were measured.

use plid_report::percent;

use crate::answer::schema::{Located, Remainder, RemainderPlace};
use crate::settings::AnswerSettings;
use crate::words::band;

/// Smallest share of a remainder for which an output is named.
const NAMED_SHARE: f64 = 0.1;

/// Largest number of outputs, and of bands, that are named: more would not be read.
const MOST_NAMED: usize = 3;

/// Says what the best explanation leaves.
pub(crate) fn what_remains(remainder: &Remainder, settings: &AnswerSettings) -> String {
    let &Remainder { gap, noise, noise_unseen, further_cause, share_of_gap, .. } = remainder;
    let level = if noise_unseen { ", a level that no record shows" } else { "" };
    let noise_alone = format!("noise alone makes {}{level}", percent(noise));
    let further =
        format!("The probability of a further cause above what the case calls material is {}", in_words(further_cause));
    if !noise_unseen && further_cause < settings.further_cause && gap <= settings.unexplained * noise {
        let what = if gap <= noise { "Nothing" } else { "Hardly anything" };
        return format!("{what} remains beyond the noise: a gap of {}, and {noise_alone}. {further}.", percent(gap));
    }
    format!(
        "With the best explanation, a gap of {} remains, and {noise_alone}; beyond the noise, this is {} of the \
        squared gap as given{}{}. {further}{}.",
        percent(gap),
        percent(share_of_gap),
        places(remainder),
        repeats(remainder),
        nearest(&remainder.nearest),
    )
}

/// States a probability that was counted in draws, so that neither zero nor one is certain.
fn in_words(probability: f64) -> String {
    match (100.0 * probability).round() {
        ..=0.0 => "less than 1 %".into(),
        100.0.. => "more than 99 %".into(),
        percent => format!("{percent:.0} %"),
    }
}

/// States the outputs and bands with most of a remainder: ", mostly at y2 (70.0 %), at 10 to 12 Hz (80.0 %)".
fn places(remainder: &Remainder) -> String {
    let RemainderPlace { channels, bands_hz } = &remainder.place;
    let mut outputs: Vec<(&String, &f64)> = channels.iter().filter(|(_, share)| **share >= NAMED_SHARE).collect();
    outputs.sort_by(|a, b| b.1.total_cmp(a.1));
    let outputs = outputs.iter().take(MOST_NAMED).map(|(name, share)| format!("{name} ({})", percent(**share)));
    let bands = bands_hz.iter().take(MOST_NAMED);
    let bands = bands.map(|[from, to, share]| format!("{} ({})", band(*from, *to), percent(*share)));
    let listed = [outputs.collect::<Vec<_>>(), bands.collect()].map(|all| all.join(" and "));
    let listed: Vec<String> = listed.into_iter().filter(|all| !all.is_empty()).map(|all| format!("at {all}")).collect();
    if listed.is_empty() { String::new() } else { format!(", mostly {}", listed.join(", ")) }
}

fn repeats(remainder: &Remainder) -> String {
    let said = |share| format!("; {} of its power, noise included, repeats in every period", percent(share));
    remainder.repeats.map_or_else(String::new, said)
}

fn nearest(effects: &[Located]) -> String {
    let all: Vec<String> = effects.iter().map(|e| format!("{} at {}", e.effect, e.location)).collect();
    match all.len() {
        0 => String::new(),
        1 => format!("; {} comes nearest to explaining the remainder", all[0]),
        _ => format!("; {} come nearest to explaining the remainder", all.join(" and ")),
    }
}

/// States the gap to expect on a further record, with its 80 % interval.
pub(crate) fn expected(gap: f64, ci80: [f64; 2]) -> String {
    let [gap, low, high] = [gap, ci80[0], ci80[1]].map(percent);
    format!("On a further record at full level, a gap of {gap} is expected (80 % interval {low} to {high}).")
}

/// Says which records the gaps belong to, and what else these records were used for.
pub(crate) fn of_records(measured_on: &[String], fitted: bool) -> String {
    let on = measured_on.join(", ");
    if fitted {
        return format!(
            "The gaps are those of {on}, which was fitted, because nothing could be held out; a new record may show \
            larger ones."
        );
    }
    let them = if measured_on.len() == 1 { "it" } else { "them" };
    format!(
        "The gaps are those of {on}. No fit used {them}, but the verdict did, and the choice between explanations may \
        have; a new record may show larger gaps."
    )
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn remainder() -> Remainder {
        let at = |effect: &str| Located { effect: effect.into(), location: "input:u1".into() };
        let channels = [("y1", 0.28), ("y2", 0.7), ("y3", 0.02)].map(|(name, share)| (name.to_string(), share));
        Remainder {
            gap: 0.02,
            noise: 0.01,
            noise_unseen: false,
            share_of_gap: 0.0019,
            further_cause: 0.12,
            material: 0.02,
            repeats: Some(0.35),
            place: RemainderPlace { channels: BTreeMap::from(channels), bands_hz: vec![[10.0, 12.0, 0.8]] },
            nearest: vec![at("clearance"), at("quadratic-damping")],
        }
    }

    #[test]
    fn a_remainder_is_stated_with_all_its_figures() {
        let settings = AnswerSettings::default();
        assert_eq!(
            what_remains(&remainder(), &settings),
            "With the best explanation, a gap of 2.00 % remains, and noise alone makes 1.00 %; beyond the noise, this \
            is 0.19 % of the squared gap as given, mostly at y2 (70.0 %) and y1 (28.0 %), at 10.0 to 12.0 Hz (80.0 %); \
            35.0 % of its power, noise included, repeats in every period. The probability of a further cause above \
            what the case calls material is 12 %; clearance at input:u1 and quadratic-damping at input:u1 come nearest \
            to explaining the remainder."
        );
        let bare = Remainder { repeats: None, place: Default::default(), nearest: Vec::new(), ..remainder() };
        assert!(what_remains(&bare, &settings).contains("of the squared gap as given. The probability"));
    }

    #[test]
    fn noise_is_no_remainder_unless_a_further_cause_is_probable_or_no_record_shows_it() {
        let settings = AnswerSettings::default();
        let said = |of: Remainder| what_remains(&of, &settings);
        let noise = || Remainder { gap: 0.0099, further_cause: 0.001, ..remainder() };
        let nothing = said(noise());
        assert!(nothing.starts_with("Nothing remains beyond the noise: a gap of 0.99 %"), "{nothing}");
        assert!(nothing.ends_with("is less than 1 %."), "{nothing}");
        assert!(said(Remainder { gap: 0.0105, ..noise() }).starts_with("Hardly anything remains"));
        let unseen = said(Remainder { noise_unseen: true, ..noise() });
        assert!(unseen.contains("remains, and noise alone makes 1.00 %, a level that no record shows;"), "{unseen}");
        let probable = said(Remainder { gap: 0.0105, further_cause: 0.999, ..remainder() });
        assert!(probable.starts_with("With the best") && probable.contains("more than 99 %"), "{probable}");
    }

    #[test]
    fn the_use_of_the_records_is_stated() {
        let of = |names: &[&str], fitted| of_records(&names.iter().map(|n| n.to_string()).collect::<Vec<_>>(), fitted);
        assert!(of(&["a.csv"], false).contains("No fit used it, but the verdict did"));
        assert!(of(&["a.csv", "b.csv"], false).contains("those of a.csv, b.csv. No fit used them"));
        assert!(of(&["a.csv"], true).contains("a.csv, which was fitted"));
    }
}
