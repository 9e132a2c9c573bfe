//! The answer in a few sentences.

use plid_report::Cell;

use crate::answer::schema::{Family, Gap, NamedEffect};
use crate::effects::Observation;
use crate::judge::lacking_states::LackingStates;
use crate::judge::locate::Map;
use crate::judge::verdict::Verdict;
use crate::settings::AnswerSettings;
use plid_report::percent;

/// States the change of a gap. Effects that were fitted to other records may also increase it.
fn course(from: f64, to: f64) -> String {
    match [percent(from), percent(to)] {
        [from, to] if from == to => format!("the gap stays at {to}"),
        [before, after] => format!("the gap {} from {before} to {after}", if to > from { "grows" } else { "falls" }),
    }
}

/// States the output and the frequency at which most of a remainder lies. `after` is the remainder's map over outputs
/// and bands, `beyond` is its size beyond the noise, and `given` is the gap as given.
pub(crate) fn remains(after: &Map, outputs: &[String], beyond: f64, given: f64, settings: &AnswerSettings) -> String {
    let cells = (0..after.share.nrows()).flat_map(|o| (0..after.share.ncols()).map(move |b| (o, b)));
    let Some((o, b)) = cells.max_by(|x, y| after.share[*x].total_cmp(&after.share[*y])) else { return String::new() };
    let hz = 0.5 * (after.edges[b] + after.edges[b + 1]);
    let small = beyond < settings.small_remainder * given;
    let what = if small { "Something small".to_string() } else { format!("A gap of {}", percent(beyond)) };
    format!(" {what} remains near {} Hz at {}.", Cell::significant(hz, 2), outputs[o])
}

/// The content of the sentences.
pub(crate) struct Said<'s> {
    /// The effects that are named, the largest first.
    pub effects: &'s [NamedEffect],
    /// The kind of observation in which each named effect appears.
    pub observed: &'s [Observation],
    /// The best explanation, whether or not it suffices.
    pub nearest: &'s [String],
    /// The number of effects that are fitted but not named.
    pub smaller: usize,
    /// The gaps.
    pub gap: &'s Gap,
    /// The smallest gap that is material, relative to the output.
    pub material: f64,
    /// Whether the records show the noise level.
    pub seen: bool,
    /// The gap that stochastic effects cause, if nothing else is named and the simulation is imperfect as a whole.
    pub noise_alone: Option<f64>,
    /// The states that the simulation lacks, if missing states are the cause of the gap.
    pub lacking: Option<LackingStates>,
    /// The sentence on the location of the remainder, if the simulation is imperfect as a whole.
    pub remains: Option<&'s str>,
    /// The thresholds of the sentences.
    pub settings: &'s AnswerSettings,
}

/// Returns the answer in one or two sentences.
pub(crate) fn sentence(verdict: Verdict, said: &Said) -> String {
    let Said { effects, nearest, gap, .. } = said;
    let [given, refit] = [gap.as_given, gap.refit].map(percent);
    let noise = said.noise();
    match verdict {
        Verdict::None if said.is_immaterial() => said.immaterial(),
        Verdict::None => format!(
            "Nothing is missing: within its stated limits the simulation explains the records down to {refit} \
            ({noise})."
        ),
        Verdict::Unknown if said.lacking.is_some() => said.lacks_states(),
        Verdict::Unknown if nearest.is_empty() => format!(
            "Something outside the vocabulary: no effect explains the gap of {given}, of which a refit leaves {refit} \
            ({noise})."
        ),
        Verdict::Unknown => format!(
            "Something outside the vocabulary: with the nearest explanation, {}, {} ({noise}), and a refit alone \
            leaves {refit}.",
            nearest.join(" and "),
            course(gap.as_given, gap.with_effect),
        ),
        Verdict::Effects => match (said.remains, effects) {
            (Some(remains), _) if said.noise_alone.is_some() => said.mostly_noise(remains),
            _ if said.is_noise() => said.all_noise(),
            (Some(remains), [main, others @ ..]) => said.mostly(main, others, remains),
            _ => said.effects(),
        },
    }
}

impl Said<'_> {
    fn noise(&self) -> String {
        if self.seen {
            format!("noise {}", percent(self.gap.noise_floor))
        } else {
            "the noise level cannot be determined from these records".to_string()
        }
    }

    fn lacks_states(&self) -> String {
        let Some(LackingStates { states, needed, gap }) = self.lacking else { return String::new() };
        let of_nearest = if self.nearest.is_empty() {
            String::new()
        } else {
            format!(
                "; with the nearest effects ({}), a gap of {} remains",
                self.nearest.join(" and "),
                percent(self.gap.with_effect)
            )
        };
        format!(
            "The simulation has too few states, and no effect takes their place: a linear model with {needed} instead \
            of {states}, identified from the fitted records, leaves {} of a gap of {} ({}){of_nearest}.",
            percent(gap),
            percent(self.gap.as_given),
            self.noise(),
        )
    }

    /// Returns whether effects were found, although the whole gap is too small to matter.
    fn is_immaterial(&self) -> bool {
        !self.nearest.is_empty() && self.gap.as_given < self.material
    }

    fn immaterial(&self) -> String {
        format!(
            "Nothing material is missing: the gap is {}, below the {} that the case calls material. With {} it would \
            be {} ({}).",
            percent(self.gap.as_given),
            percent(self.material),
            self.nearest.join(" and "),
            percent(self.gap.with_effect),
            self.noise(),
        )
    }

    fn is_noise(&self) -> bool {
        let random = |observed: &Observation| matches!(observed, Observation::Band | Observation::SensorNoise);
        self.gap.as_given < self.settings.noise_only * self.gap.noise_floor || self.observed.iter().all(random)
    }

    /// States an effect with its probability, or its family where the family is clearly more certain: "dry friction at
    /// input:u1 (94 % sure; coulomb-friction 55 %)".
    fn sure(&self, effect: &NamedEffect) -> String {
        let percent = |probability: f64| format!("{:.0} %", 100.0 * probability);
        let surer = |family: &&Family| family.confidence > effect.confidence + self.settings.family_lead;
        match effect.family.as_ref().filter(surer) {
            Some(family) => format!(
                "{} at {} ({} sure; {} {})",
                family.name,
                effect.location,
                percent(family.confidence),
                effect.effect,
                percent(effect.confidence)
            ),
            None => format!("{} ({} sure)", listed(std::slice::from_ref(effect)), percent(effect.confidence)),
        }
    }

    /// Lists all effects, with the probability of the least certain one.
    fn all(&self) -> String {
        if let [only] = self.effects {
            return self.sure(only);
        }
        let sure = 100.0 * self.effects.iter().map(|e| e.confidence).fold(1.0, f64::min);
        format!("{} ({sure:.0} % sure)", listed(self.effects))
    }

    fn them(&self) -> String {
        let them = if self.effects.len() == 1 { "it" } else { "them" };
        match self.smaller {
            0 => them.into(),
            1 => format!("{them} and a smaller effect"),
            smaller => format!("{them} and {smaller} smaller effects"),
        }
    }

    fn all_noise(&self) -> String {
        format!(
            "{}: unpredictable noise makes up {} of the output; the total gap is {}.",
            self.all(),
            percent(self.gap.noise_floor),
            percent(self.gap.as_given),
        )
    }

    fn mostly_noise(&self, remains: &str) -> String {
        format!(
            "Mostly {}: unpredictable noise makes a gap of {}; the total gap is {}.{remains}",
            self.all(),
            percent(self.noise_alone.unwrap_or(self.gap.noise_floor)),
            percent(self.gap.as_given),
        )
    }

    fn mostly(&self, main: &NamedEffect, others: &[NamedEffect], remains: &str) -> String {
        let others = if others.is_empty() { String::new() } else { format!(", together with {}", listed(others)) };
        format!(
            "Mostly {}{others}: with {} the gap on held-out records{}, and {} of that is noise.{remains}",
            self.sure(main),
            self.them(),
            course(self.gap.as_given, self.gap.with_effect).trim_start_matches("the gap"),
            percent(self.gap.noise_floor),
        )
    }

    fn effects(&self) -> String {
        let gap = self.gap;
        // No simulation can predict dropouts.
        let drops = self.observed.contains(&Observation::Dropouts);
        let rest = if self.seen && !drops && gap.with_effect > self.settings.unexplained * gap.noise_floor {
            format!(" {} of the output remains unexplained.", percent(gap.beyond_noise(gap.with_effect)))
        } else {
            String::new()
        };
        let course = course(gap.as_given, gap.with_effect);
        format!("{}: with {} {course} ({}).{rest}", self.all(), self.them(), self.noise())
    }
}

/// Lists effects: "cubic-stiffness at input:u2 and sensor-gain at output:y1".
fn listed(effects: &[NamedEffect]) -> String {
    let one = |e: &NamedEffect| {
        let differs = if e.shape_differs { " (its shape differs)" } else { "" };
        format!("{} at {}{differs}", e.effect, e.location)
    };
    effects.iter().map(one).collect::<Vec<_>>().join(" and ")
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_gap_that_grows_is_not_said_to_fall() {
        assert_eq!(super::course(0.145, 0.16), "the gap grows from 14.5 % to 16.0 %");
        assert_eq!(super::course(0.145, 0.009), "the gap falls from 14.5 % to 0.90 %");
        assert_eq!(super::course(0.01371, 0.01374), "the gap stays at 1.37 %");
    }
}
