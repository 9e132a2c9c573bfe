//! The kinds of places at which effects act: the places of each kind, and their notation in a diagnosis.

use crate::INPUTS;

/// A kind of place, with an example of its notation in a config's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// The port of an input, inside the structure: `u1`.
    Port,
    /// The actuator of an input: `u1`.
    Input,
    /// One actuator, or all of them alike: `u1` or `all`.
    InputOrAll,
    /// From one input into another: `u1->u3`.
    InputPair,
    /// A sensor: `y1`.
    Output,
    /// From one output into another: `y1->y3`.
    OutputPair,
    /// The port of an input, `u1`, at which a disturbance acts. A diagnosis identifies the disturbance by its
    /// frequency, which is the second of its parameters.
    Disturbance,
    /// A mode by its number: `m4`.
    Mode,
    /// A mode that the simulation lacks. It is not in the list of modes, so its place is not written.
    NewMode,
    /// The structure as a whole, or all channels together. This place is not written.
    Whole,
}

/// The numbers of the truss's dominant modes, at which modal effects are drawn.
const DOMINANT_MODES: std::ops::RangeInclusive<usize> = 4..=7;

/// Relative distance within which a stated frequency means that of the label, for a mode and for a disturbance.
const SAME_MODE: f64 = 0.05;
const SAME_FREQUENCY: f64 = 0.1;

impl At {
    /// Returns whether such a place consists of two channels.
    #[must_use]
    pub const fn is_pair(self) -> bool {
        matches!(self, Self::InputPair | Self::OutputPair)
    }

    /// Returns every place of this kind on a truss with these numbers of inputs and outputs. Of the modes, only the
    /// dominant ones count. `None` stands for a place that is not written.
    #[must_use]
    pub fn places(self, inputs: usize, outputs: usize) -> Vec<Option<String>> {
        let single = |letter: char, count: usize| (1..=count).map(move |i| Some(format!("{letter}{i}")));
        let pairs = |letter: char, count: usize| {
            (1..=count).flat_map(move |i| {
                (1..=count).filter(move |&j| j != i).map(move |j| Some(format!("{letter}{i}->{letter}{j}")))
            })
        };
        match self {
            Self::Port | Self::Input | Self::Disturbance => single('u', inputs).collect(),
            Self::InputOrAll => single('u', inputs).chain([Some("all".to_owned())]).collect(),
            Self::InputPair => pairs('u', inputs).collect(),
            Self::Output => single('y', outputs).collect(),
            Self::OutputPair => pairs('y', outputs).collect(),
            Self::Mode => DOMINANT_MODES.map(|m| Some(format!("m{m}"))).collect(),
            Self::NewMode | Self::Whole => vec![None],
        }
    }

    /// Returns whether a location, as a diagnosis states it (`input:u2`, `port:strut2`, `output:y1->y3`,
    /// `mode:168.2`, `freq:120.0 port:strut1`), means the place of a label's effect. The label gives the number of
    /// this place from 0, the parameters of the effect, and the frequency of its mode in Hz.
    #[must_use]
    pub fn is_meant(self, location: &str, loc: usize, par: &[f64], hz: f64) -> bool {
        let (kind, at) = location.split_once(':').unwrap_or((location, ""));
        let number = loc.saturating_add(1);
        let single = |letter: char| at == format!("{letter}{number}");
        let pair = |letter: char| {
            let to = par.get(1).map_or(0, |j| (*j as usize).saturating_add(1));
            at == format!("{letter}{number}->{letter}{to}")
        };
        let stated = at.split_whitespace().next().and_then(|word| word.parse::<f64>().ok());
        let near = |hz: f64, within: f64| stated.is_some_and(|stated| (stated / hz - 1.0).abs() < within);
        match self {
            Self::Port => (kind == "input" && single('u')) || (kind == "port" && at == format!("strut{number}")),
            Self::InputOrAll if loc == INPUTS => kind == "input" && at == "all",
            Self::Input | Self::InputOrAll => kind == "input" && single('u'),
            Self::Output => kind == "output" && single('y'),
            // The letters say whether they are inputs or outputs.
            Self::InputPair => pair('u'),
            Self::OutputPair => pair('y'),
            Self::Disturbance => par.get(1).is_some_and(|hz| near(*hz, SAME_FREQUENCY)),
            Self::Mode | Self::NewMode => near(hz, SAME_MODE),
            // There is only one such place.
            Self::Whole => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_all_there_are() {
        let count = |at: At| at.places(3, 3).len();
        assert_eq!((count(At::InputOrAll), count(At::OutputPair), count(At::Whole)), (4, 6, 1));
        assert_eq!(At::InputPair.places(1, 1).len(), 0);
        assert_eq!(At::Port.places(2, 1), [Some("u1".to_owned()), Some("u2".to_owned())]);
    }

    #[test]
    fn a_location_means_one_place_only() {
        let is = |at: At, location: &str, loc: usize| at.is_meant(location, loc, &[0.1, 2.0], 168.0);
        assert!(is(At::Port, "input:u2", 1) && is(At::Port, "port:strut2", 1) && !is(At::Port, "output:y2", 1));
        assert!(is(At::Input, "input:u2", 1) && !is(At::Input, "port:strut2", 1));
        assert!(is(At::InputOrAll, "input:all", INPUTS) && !is(At::InputOrAll, "input:u3", INPUTS));
        assert!(is(At::InputPair, "input:u1->u3", 0) && !is(At::InputPair, "input:u3->u1", 2));
        assert!(is(At::NewMode, "mode:170.1", 4) && !is(At::Mode, "mode:180", 4) && !is(At::Mode, "mode:", 4));
        assert!(is(At::Disturbance, "freq:2.1 port:strut1", 0) && !is(At::Disturbance, "freq:2.3", 0));
        assert!(is(At::Whole, "structure", 0));
    }
}
