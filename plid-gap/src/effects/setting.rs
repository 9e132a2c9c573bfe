use super::place::Names;
use super::{Place, Units};
use plid_model::Model;

use crate::case::ON_A_MODE;
use crate::plant::{Plant, PortSource};
use crate::signal::peaks::MissingModeStart;
use crate::signal::tones::Tone;

/// Largest amount by which the share of a joint's stiffness that a simulation contains may be below 0 or above 1,
/// because of the errors of a fit.
const BESIDE: f64 = 0.5;

/// Sizes from which fits of an added inertia, damper or stiffness start, as shares of that at the port.
const LOAD_SHARES: [f64; 4] = [0.1, -0.1, 0.4, -0.4];

/// Largest relative change of a mode's frequency from which a fit starts.
pub(super) const FARTHEST: f64 = 0.4;

/// Properties of the simulation and of the records by which an effect chooses its locations and starts.
#[derive(Debug, Clone)]
pub struct Setting {
    /// The simulation.
    pub plant: Plant,
    /// Names of channels, ports and modes.
    pub names: Names,
    /// Units of channels and ports.
    pub units: Units,
    /// RMS of each command of the plant at the highest level (m).
    pub u_rms: Vec<f64>,
    /// Largest RMS, over all records, of each input's slope, 1/s (m).
    pub u_slope: Vec<f64>,
    /// RMS of each measured output at the highest level (p).
    pub y_rms: Vec<f64>,
    /// Largest magnitude of each measured output (p).
    pub y_max: Vec<f64>,
    /// RMS of the displacement at each port, simulated at the highest level.
    pub d_rms: Vec<f64>,
    /// Lowest and highest measured displacement at each port; `None` where no output measures it.
    pub d_range: Vec<Option<[f64; 2]>>,
    /// RMS of the velocity at each port.
    pub v_rms: Vec<f64>,
    /// Force at each port that moves the structure about as much as the inputs do at the highest level.
    pub force: Vec<f64>,
    /// Stiffness at each port: the force over the static displacement that it causes.
    pub stiffness: Vec<f64>,
    /// Time from the start of the first record to the end of the last, in s.
    pub duration_s: f64,
    /// Lines in the residual of the linear simulation.
    pub tones: Vec<Tone>,
    /// Modes that the residual's frequency response suggests.
    pub missing: Vec<MissingModeStart>,
    /// The frequency band in Hz that counts; all frequencies if `None`.
    pub band_hz: Option<[f64; 2]>,
}

impl Setting {
    /// Creates a setting with names and locations only, which suffice for a prediction.
    pub fn bare(plant: &Plant, model: &Model) -> Self {
        Self {
            plant: plant.clone(),
            names: Names {
                inputs: model.inputs.clone(),
                outputs: model.outputs.clone(),
                ports: plant.ports.iter().map(|port| port.name.clone()).collect(),
                modes_hz: plant.modes.iter().map(|mode| mode.hz()).collect(),
                parameters: Vec::new(),
            },
            units: Units::default(),
            u_rms: vec![0.0; plant.m],
            u_slope: vec![0.0; plant.m],
            y_rms: vec![0.0; plant.p],
            y_max: vec![0.0; plant.p],
            d_rms: vec![0.0; plant.ports.len()],
            d_range: vec![None; plant.ports.len()],
            v_rms: vec![0.0; plant.ports.len()],
            force: vec![0.0; plant.ports.len()],
            stiffness: plant.ports.iter().map(|port| plant.stiffness(port)).collect(),
            duration_s: 0.0,
            tones: Vec::new(),
            missing: Vec::new(),
            band_hz: None,
        }
    }

    /// Returns whether a frequency counts.
    pub(super) fn counts(&self, hz: f64) -> bool {
        self.band_hz.is_none_or(|[from, to]| (from..=to).contains(&hz))
    }

    /// Returns the inputs by number.
    pub fn inputs(&self) -> Vec<Place> {
        (0..self.plant.m).map(Place::Input).collect()
    }

    /// Returns the outputs by number.
    pub fn outputs(&self) -> Vec<Place> {
        (0..self.plant.p).map(Place::Output).collect()
    }

    /// Returns the modes by number.
    pub fn modes(&self) -> Vec<Place> {
        (0..self.plant.modes.len()).map(Place::Mode).collect()
    }

    /// Returns the loops by number: those of the inputs that command the position of their own port. A plant with a
    /// controller has none, because the controller closes the loops.
    pub fn loops(&self) -> Vec<Place> {
        if self.plant.controller.is_some() {
            return Vec::new();
        }
        let of = |place: Place| match place {
            Place::Input(i) if self.plant.commands_position(self.port(&place)) => Some(Place::Loop(i)),
            _ => None,
        };
        self.loads().into_iter().filter_map(of).collect()
    }

    /// Returns the locations of internal forces: the ports of the inputs, then the other ports.
    pub fn joints(&self) -> Vec<Place> {
        let ports = self.plant.ports.iter().enumerate();
        ports.map(|(k, port)| port.input.map_or(Place::Port(k), Place::Input)).collect()
    }

    /// Returns the locations of [`Setting::joints`] whose displacement is known.
    pub fn springs(&self) -> Vec<Place> {
        self.joints().into_iter().filter(|place| self.sees_displacement(place)).collect()
    }

    /// Returns whether the displacement at a port is known.
    pub(super) fn sees_displacement(&self, place: &Place) -> bool {
        self.plant.ports[self.port(place)].sees_displacement()
    }

    /// Returns whether the simulation contains the stiffness of a joint at a port unless the effect says otherwise: on
    /// a single mode and on a structure of a single mode.
    pub(super) fn contains_joints(&self, port: usize) -> bool {
        self.is_on_a_mode(port) || self.plant.modes.len() == 1
    }

    /// Returns whether the simulation may contain the stiffness of a joint at a port where it does not do so by
    /// default.
    pub(super) fn may_contain_joints(&self, port: usize) -> bool {
        let moved = self.plant.ports[port].moved_by().is_some();
        !self.contains_joints(port) && !moved && self.stiffness[port] > 0.0
    }

    /// Returns whether the simulation may contain this share of a joint's stiffness k at a port: from none to all of
    /// it, and no more than the static stiffness there.
    pub(super) fn may_contain(&self, port: usize, share: f64, k: f64) -> bool {
        let moved = self.plant.ports[port].moved_by().is_some();
        (-BESIDE..1.0 + BESIDE).contains(&share) && (moved || share <= 0.0 || share * k < self.stiffness[port])
    }

    /// Returns the locations of linear forces: declared ports, and the axes of a plant without modes. At ports that
    /// were inferred from modes, and at the joint of a drive, the frequency and the damping ratio of each mode serve
    /// instead.
    pub fn loads(&self) -> Vec<Place> {
        let exact = self.plant.port_source != PortSource::Inferred && self.plant.rest.continuous.is_some();
        let may_act = |place: &Place| {
            let port = self.port(place);
            // A linear force on a prescribed motion is a parameter of the linear model.
            !self.is_on_a_mode(port) && !self.plant.is_joint(port) && self.plant.ports[port].moved_by().is_none()
        };
        if exact { self.joints().into_iter().filter(may_act).collect() } else { Vec::new() }
    }

    /// Returns the locations of [`Setting::loads`] that a force accelerates immediately. A force that first passes
    /// the lag of an actuator does not accelerate the port immediately.
    pub fn inertias(&self) -> Vec<Place> {
        self.loads().into_iter().filter(|place| self.plant.mobility(self.port(place)) > 0.0).collect()
    }

    /// Returns the locations of springs that the simulation contains: [`Setting::inertias`] and the joint of a drive.
    pub fn transmissions(&self) -> Vec<Place> {
        let joint = self.joints().into_iter().filter(|place| self.plant.is_joint(self.port(place)));
        self.inertias().into_iter().chain(joint).collect()
    }

    /// Returns sizes of a linear force from which fits start: shares of the port's own value, or of `other` if the
    /// port has none; and, for each resonance that the records suggest at another frequency, the size that moves the
    /// nearest mode there. If the force moves frequencies, `by` returns the share that multiplies a frequency by a
    /// given factor.
    pub(super) fn load_starts(&self, own: f64, other: f64, by: Option<fn(f64) -> f64>) -> Vec<Vec<f64>> {
        let scale = if own > 0.0 { own } else { other };
        let mut shares = LOAD_SHARES.to_vec();
        if let Some(by) = by {
            let moved = |hz: f64| Some(hz / self.plant.modes[self.plant.mode_at(hz)?].hz());
            let factors = self.missing.iter().filter_map(|mode| moved(mode.hz));
            shares.extend(factors.filter(|factor| (factor - 1.0).abs() < FARTHEST).map(by));
        }
        shares.into_iter().map(|share| vec![share * scale]).collect()
    }

    /// Returns whether a port is on a single mode.
    pub fn is_on_a_mode(&self, port: usize) -> bool {
        self.names.ports[port].starts_with(ON_A_MODE)
    }

    /// Returns multiples of a start at which an internal force is 1, 3 and 10 % of the spring force there. The effect
    /// of a force that shifts a resonance by more than its width cannot be extrapolated from a small change.
    pub(crate) fn bold_sizes(&self, port: usize) -> Vec<f64> {
        if !(self.force[port] > 0.0 && self.stiffness[port] > 0.0) {
            return vec![1.0];
        }
        // The force of a start is a hundredth of `force`.
        let spring = self.stiffness[port] * self.d_rms[port] / (0.01 * self.force[port]);
        [0.01, 0.03, 0.1].map(|share| share * spring).to_vec()
    }

    /// Returns the number of the port at a location.
    ///
    /// # Panics
    /// Panics if the simulation has no port at that location.
    pub fn port(&self, place: &Place) -> usize {
        let found = match *place {
            Place::Port(k) => Some(k),
            Place::Input(i) | Place::Loop(i) => self.plant.ports.iter().position(|port| port.input == Some(i)),
            Place::Frequency(_, port) => Some(port),
            _ => None,
        };
        found.expect("an internal force acts at a port")
    }
}
