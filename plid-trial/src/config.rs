//! TRIAL.toml: the numbers and kinds of cases to draw. It contains no seed.

use std::path::Path;

use plid_data::config::{ConfigError, from_toml_checked, read_checked};
use plid_testbed::effects::Families;
use plid_testbed::gap::{Channels, Experiment, PlantKind};
use plid_testbed::{INPUTS, OUTPUTS};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::vocabulary::{Outsiders, built_in, family, whole};

/// A trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialConfig {
    /// The name in the report.
    pub name: String,
    /// The numbers of cases.
    pub cases: Cases,
    /// The distributions from which each case is drawn.
    #[serde(default)]
    pub draw: Draw,
}

/// The number of cases in each arm.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cases {
    /// Nothing is missing.
    pub none: usize,
    /// One effect: this many cases of each effect, with its places in turn.
    pub singles_per_effect: usize,
    /// Two effects.
    pub pairs: usize,
    /// Three effects.
    pub triples: usize,
    /// One effect outside the vocabulary, with kinds in turn.
    pub outsiders: usize,
    /// One effect of the vocabulary, with effects in turn. These are additional single effects that are answered a
    /// second time without that effect. As many of the other single effects are answered a second time without an
    /// effect that does not act.
    pub leave_one_out: usize,
    /// One effect: total number of such cases, with effects in turn, in addition to those of `singles_per_effect`.
    pub singles: usize,
}

/// The distributions from which each case is drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Draw {
    /// The effects to draw from: names of the vocabulary, and of effects that the program has added to the testbed. If
    /// the list is empty, they are all effects of the vocabulary that make sense on one of the plants.
    pub effects: Vec<String>,
    /// Smallest gap that an effect causes alone, relative to the gap caused by noise in this case.
    pub least_over_floor: f64,
    /// Largest gap that an effect causes alone. The logarithm of the gap is drawn uniformly.
    pub most: f64,
    /// Share of effects that follow another law of the same physics, if the testbed has one.
    pub near_misses: f64,
    /// Share of cases whose simulation has small errors in addition to the effect.
    pub perturbed: f64,
    /// Share of cases whose simulation declares where internal forces may act.
    pub ports: f64,
    /// Kinds of plants, drawn with equal probability among those on which the effects of a case make sense.
    pub plants: Vec<PlantKind>,
    /// Numbers of channels, drawn with equal probability. A plant that has fewer keeps all of its own. An effect from
    /// one channel into another gets all channels.
    pub channels: Vec<Channels>,
    /// Kinds of experiments, drawn with equal probability.
    pub experiments: Vec<Experiment>,
    /// Share of cases whose simulator is given only by its outputs.
    pub outputs_only: f64,
    /// Share of the other cases whose declared noise is wrong by up to half.
    pub misjudged: f64,
    /// Length of the records relative to full ones.
    pub length: f64,
    /// Least gap that an effect makes alone, whatever the noise.
    pub least: f64,
    /// Gap that small effects make together, in addition to the effects of a case; 0 for none.
    pub imperfections: Span,
    /// Error of the simulation of a case with imperfections, in standard deviations of the stated limits.
    pub beyond_limits: Span,
    /// The half of the effects outside the vocabulary from which outsiders are drawn, or all of them.
    pub outsiders: Outsiders,
    /// The shapes of laws other than the vocabulary's own: fixed ones, those of one half of each family, or all of
    /// them.
    pub families: Families,
}

/// A number, or the ends between which one is drawn uniformly for each case.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Span {
    /// This value in every case.
    Value(f64),
    /// From the first to the second.
    Range([f64; 2]),
}

impl Span {
    /// Returns the least and the largest number.
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::Value(value) => [value, value],
            Self::Range(ends) => ends,
        }
    }

    /// Draws a number. No random number is used if there is no choice.
    pub(crate) fn drawn(self, rng: &mut impl RngExt) -> f64 {
        match self.ends() {
            [low, high] if low < high => rng.random_range(low..=high),
            [only, _] => only,
        }
    }
}

/// Largest number of cases of a trial.
const MOST: usize = 1_000_000;

/// The built-in trial of `--quick`.
const QUICK: &str = include_str!("../experiments/quick.toml");

impl Default for Draw {
    fn default() -> Self {
        let (least_over_floor, most) = (0.5, 0.3);
        Self {
            effects: Vec::new(),
            least_over_floor,
            most,
            near_misses: 0.5,
            perturbed: 0.5,
            ports: 0.67,
            plants: vec![PlantKind::default()],
            channels: vec![Channels::default()],
            experiments: vec![Experiment::default()],
            outputs_only: 0.0,
            misjudged: 0.0,
            length: 1.0,
            least: 0.0,
            imperfections: Span::Value(0.0),
            beyond_limits: Span::Range([1.0, 1.5]),
            outsiders: Outsiders::default(),
            families: Families::default(),
        }
    }
}

impl TrialConfig {
    /// Reads TRIAL.toml.
    ///
    /// # Errors
    /// Returns a [`ConfigError`] with file, line and key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        read_checked(path, Self::problems)
    }

    /// Returns the built-in quick trial.
    ///
    /// # Errors
    /// Returns no error, as a test confirms.
    pub fn quick() -> Result<Self, ConfigError> {
        from_toml_checked(QUICK, "the built-in trial", Self::problems)
    }

    /// Returns the invalid values, each as key and reason.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        let effects = self.effects();
        for name in &self.draw.effects {
            if family(name).is_none() {
                let known: Vec<&str> = whole().iter().map(|kind| kind.name).collect();
                problems.push(("effects", format!("`{name}` is not in the vocabulary: {}", known.join(", "))));
            }
        }
        if (1..effects.len()).any(|i| effects[..i].contains(&effects[i])) {
            problems.push(("effects", "an entry occurs twice".to_owned()));
        }
        match self.total() {
            0 => problems.push(("cases", "the trial has no cases".to_owned())),
            1..=MOST => {}
            total => problems.push(("cases", format!("{total} cases are asked for, but at most {MOST} are possible"))),
        }
        for (key, count, wanted) in [("pairs", self.cases.pairs, 2), ("triples", self.cases.triples, 3)] {
            let together = |plant: &PlantKind| effects.iter().filter(|effect| plant.takes(effect)).count();
            if count > 0 && self.draw.plants.iter().map(together).max().unwrap_or(0) < wanted {
                problems.push((key, format!("they need {wanted} different `effects` on the same plant")));
            }
        }
        self.problems_of_plants(&mut problems);
        self.problems_of_draw(&mut problems);
        problems
    }

    /// Returns whether an effect makes sense on one of the plants.
    pub(crate) fn is_taken(&self, effect: &str) -> bool {
        self.draw.plants.iter().any(|plant| plant.takes(effect))
    }

    /// Returns the invalid values that depend on the kinds of plants.
    fn problems_of_plants(&self, problems: &mut Vec<(&'static str, String)>) {
        let draw = &self.draw;
        for name in draw.effects.iter().filter(|name| family(name).is_some() && !self.is_taken(name)) {
            problems.push(("effects", format!("`{name}` makes sense on none of the `plants`")));
        }
        if self.cases.outsiders > 0 && !draw.outsiders.kinds().iter().any(|kind| self.is_taken(kind.name)) {
            problems.push(("outsiders", "none of the outsiders to draw makes sense on any of the `plants`".to_owned()));
        }
        if draw.imperfections.ends()[1] > 0.0 && draw.plants.iter().any(|plant| plant.has_axes()) {
            let reason = "imperfections are drawn only for structures, and some of the `plants` have axes";
            problems.push(("imperfections", reason.to_owned()));
        }
    }

    /// Returns the invalid values of `draw`.
    fn problems_of_draw(&self, problems: &mut Vec<(&'static str, String)>) {
        let draw = &self.draw;
        for (key, count) in
            [("plants", draw.plants.len()), ("channels", draw.channels.len()), ("experiments", draw.experiments.len())]
        {
            if count == 0 {
                problems.push((key, "there must be at least one".to_owned()));
            }
        }
        for channels in &draw.channels {
            if !(1..=INPUTS).contains(&channels.inputs) || !(1..=OUTPUTS).contains(&channels.outputs) {
                problems.push(("channels", format!("inputs go from 1 to {INPUTS}, outputs from 1 to {OUTPUTS}")));
            }
        }
        if !(0.1..=1.0).contains(&draw.length) {
            problems.push(("length", format!("{} is not from 0.1 to 1", draw.length)));
        }
        let shares = [
            ("near_misses", draw.near_misses),
            ("perturbed", draw.perturbed),
            ("ports", draw.ports),
            ("outputs_only", draw.outputs_only),
            ("misjudged", draw.misjudged),
        ];
        for (key, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                problems.push((key, format!("{value} is not a share from 0 to 1")));
            }
        }
        if draw.most > 0.0 && !(draw.least >= 0.0 && draw.least < draw.most) {
            problems.push(("least", format!("{} is not from 0 to below most, {}", draw.least, draw.most)));
        }
        for (key, span, most) in
            [("imperfections", draw.imperfections, 0.2), ("beyond_limits", draw.beyond_limits, 3.0)]
        {
            let [low, high] = span.ends();
            if !(0.0 <= low && low <= high && high <= most) {
                problems.push((key, format!("{low} to {high} does not rise within 0 to {most}")));
            }
        }
        for (key, value) in [("least_over_floor", draw.least_over_floor), ("most", draw.most)] {
            if !(value.is_finite() && value > 0.0) {
                problems.push((key, format!("{value} is not positive")));
            }
        }
    }

    /// Returns the effects to draw from.
    pub fn effects(&self) -> Vec<&str> {
        if self.draw.effects.is_empty() {
            built_in().iter().map(|kind| kind.name).filter(|name| self.is_taken(name)).collect()
        } else {
            self.draw.effects.iter().map(String::as_str).collect()
        }
    }

    /// Returns the number of cases.
    pub fn total(&self) -> usize {
        let Cases { none, singles_per_effect, pairs, triples, outsiders, leave_one_out, singles } = self.cases;
        let per_effect = singles_per_effect.saturating_mul(self.effects().len());
        [none, per_effect, pairs, triples, outsiders, leave_one_out, singles].into_iter().fold(0, usize::saturating_add)
    }
}

#[cfg(test)]
mod tests {
    use plid_data::config::to_toml;

    use super::*;

    fn read(text: &str) -> Result<TrialConfig, String> {
        from_toml_checked(text, "t.toml", TrialConfig::problems).map_err(|e| e.to_string())
    }

    #[test]
    fn what_is_wrong_is_named_by_key_and_line() {
        let start = "name = \"t\"\n[cases]\nnone = 1\n";
        for (rest, said) in [
            ("nones = 2\n", "line 4: unknown field `nones`"),
            ("[draw]\nports = 1.5\n", "line 5: ports: 1.5 is not a share"),
            ("[draw]\nmost = -0.1\n", "line 5: most: -0.1 is not positive"),
            ("[draw]\nchannels = [{ inputs = 4, outputs = 1 }]\n", "line 5: channels: inputs go from 1 to 3"),
            ("[draw]\nimperfections = [0.05, 0.02]\n", "line 5: imperfections: 0.05 to 0.02 does not rise"),
            ("[draw]\nleast = 0.4\n", "line 5: least: 0.4 is not"),
            ("[draw]\noutsiders = \"both\"\n", "unknown variant `both`"),
            ("[draw]\nfamilies = \"both\"\n", "unknown variant `both`"),
            (
                "outsiders = 1\n[draw]\nplants = [\"arm-loop\"]\noutsiders = \"reported\"\n",
                "outsiders: none of the outsiders to draw makes sense",
            ),
            ("[draw]\nplants = []\n", "line 5: plants: there must be"),
            ("[draw]\nplants = [\"rotor\"]\n", "unknown variant `rotor`"),
            (
                "[draw]\nplants = [\"motor\"]\neffects = [\"missing-mode\"]\n",
                "line 6: effects: `missing-mode` makes sense on none of the `plants`",
            ),
            (
                "[draw]\nplants = [\"truss\"]\neffects = [\"end-stop\"]\n",
                "line 6: effects: `end-stop` makes sense on none",
            ),
            (
                "[draw]\nplants = [\"truss\", \"arm\"]\nimperfections = 0.05\n",
                "line 6: imperfections: imperfections are drawn only",
            ),
            (
                "pairs = 1\n[draw]\nplants = [\"truss\", \"motor\"]\neffects = [\"clearance\", \"added-mass\"]\n",
                "line 4: pairs: they need 2 different `effects` on the same plant",
            ),
            ("[draw]\neffects = [\"cubic\"]\n", "line 5: effects: `cubic` is not in the vocabulary"),
            ("[draw]\neffects = [\"clearance\", \"clearance\"]\n", "twice"),
            ("pairs = 2\n[draw]\neffects = [\"clearance\"]\n", "line 4: pairs: they need 2"),
            ("seed = 3\n", "unknown field `seed`"),
            ("singles_per_effect = 923372036854775807\n", "line 2: cases: 18446744073709551615 cases are asked for"),
        ] {
            let error = read(&format!("{start}{rest}")).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
        assert!(read("name = \"t\"\n[cases]\n").unwrap_err().contains("no case"));
    }

    #[test]
    fn defaults_are_as_said_and_read_back() {
        let config = read("name = \"t\"\n[cases]\nnone = 3\nsingles_per_effect = 2\n").unwrap();
        assert_eq!(config.total(), 3 + 2 * 33);
        assert_eq!((config.draw.least_over_floor, config.draw.most), (0.5, 0.3));
        assert_eq!(config.draw.imperfections.ends(), [0.0, 0.0]);
        assert_eq!(read(&to_toml(&config)).unwrap(), config);
    }

    /// In each of the first five trials, at least one case in four has nothing missing. The other trials have the
    /// required numbers of cases, and the required halves of outsiders and laws.
    #[test]
    fn the_trials_that_come_with_plid_are_as_large_as_they_must_be() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments");
        for name in ["quick", "short", "standard", "passive", "outsiders"] {
            let config = TrialConfig::read(&folder.join(format!("{name}.toml"))).unwrap();
            assert_eq!(config.name, name);
            assert!(4 * config.cases.none >= config.total(), "{name}");
        }
        let standard = TrialConfig::read(&folder.join("standard.toml")).unwrap();
        let singles = standard.cases.singles_per_effect * standard.effects().len();
        assert!(standard.total() >= 800 && standard.cases.none >= 200 && singles >= 300);
        assert!(standard.cases.outsiders >= 2 * standard.draw.outsiders.kinds().len());
        assert_eq!(TrialConfig::quick().unwrap().total(), 60);
        let plants = TrialConfig::read(&folder.join("plants.toml")).unwrap();
        assert!((25..=40).contains(&plants.total()) && plants.draw.plants.iter().all(|plant| plant.has_axes()));
        let imperfect = TrialConfig::read(&folder.join("imperfect.toml")).unwrap();
        assert!(imperfect.total() >= 400 && imperfect.draw.plants.len() == 5 && imperfect.draw.experiments.len() > 1);
        assert_eq!((imperfect.draw.outsiders, imperfect.draw.families), (Outsiders::Reported, Families::Reported));
        let quick = TrialConfig::read(&folder.join("imperfect-quick.toml")).unwrap();
        assert_eq!((quick.draw.outsiders, quick.draw.families), (Outsiders::Development, Families::Development));
        assert_eq!((quick.total(), quick.draw.imperfections), (30, imperfect.draw.imperfections));
    }

    /// What is reported draws outsiders and shapes with which nothing was developed, and all else draws those of
    /// development.
    #[test]
    fn the_trials_that_are_reported_have_their_own_outsiders_and_families() {
        const REPORTED: [&str; 5] = ["standard", "standard-sample", "plants", "imperfect", "imperfect-sample"];
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments");
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let mut reported = 0;
        for file in files.filter(|file| file.extension().is_some_and(|extension| extension == "toml")) {
            let name = file.file_stem().unwrap().to_str().unwrap().to_owned();
            let is_reported = REPORTED.contains(&name.as_str());
            reported += usize::from(is_reported);
            let expected = match is_reported {
                true => (Outsiders::Reported, Families::Reported),
                false => (Outsiders::Development, Families::Development),
            };
            let draw = TrialConfig::read(&file).unwrap().draw;
            assert_eq!((draw.outsiders, draw.families), expected, "{name}");
        }
        assert_eq!(reported, REPORTED.len());
    }
}
