//! The truss as a list of modes: frequencies, damping and shapes.
//!
//! The paper gives the frequencies of the dominant modes and of the strut tubes; damping, shapes and the modes
//! that a 30-state model truncates are this project's choice (docs/truss.md says why).

use crate::{INPUTS, OUTPUTS};

/// Six tubes, each bending in two planes.
pub(crate) const TUBES: usize = 6;
pub(crate) const MOST_MODES_PER_TUBE: usize = 2;
/// Modes in addition to those of the tubes.
pub(crate) const PLATFORM_MODES: usize = DOMINANT.len() + TRUNCATED.len();

/// The reason why a mode is in the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeGroup {
    /// Bending of a strut tube, near 60 Hz.
    StrutTube,
    /// One of the five modes that dominate the response.
    Dominant,
    /// Above the dominant modes; a small model truncates it.
    Truncated,
}

/// A mode of unit modal mass: q" + 2 zeta w q' + w^2 q = sum_j input_shape_j a_j, where a_j is the output of
/// actuator j in V; it adds output_shape_i q" to the acceleration at corner i, in V.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Undamped natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Modal force per volt at each actuator.
    pub input_shape: [f64; INPUTS],
    /// Volts at each accelerometer per unit of modal acceleration.
    pub output_shape: [f64; OUTPUTS],
    /// The reason why it is in the list.
    pub group: ModeGroup,
}

impl Mode {
    /// Returns the natural frequency in rad/s.
    #[must_use]
    pub fn angular_frequency(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.frequency_hz
    }
}

/// Motion of the platform, or of the triangle of strut ends, in a mode.
struct Motion {
    piston: f64,
    tip: f64,
    tilt: f64,
}

impl Motion {
    /// Returns the motion at three points 120 degrees apart, of which the first is at `first_deg`.
    fn at_corners(&self, first_deg: f64, scale: f64) -> [f64; 3] {
        std::array::from_fn(|i| {
            let (sin, cos) = (first_deg + 120.0 * i as f64).to_radians().sin_cos();
            scale * (self.piston + self.tip * sin + self.tilt * cos)
        })
    }
}

/// Angles of the first accelerometer and of the end of the first actuator's strut, which are near each other but
/// differ.
const SENSOR_DEG: f64 = 90.0;
const ACTUATOR_DEG: f64 = 100.0;

/// Scale of every shape, of actuators and accelerometers alike. Its square is the gain from command to output, chosen
/// so that 1 V RMS of the shaped white noise on all inputs gives 0.5 V RMS over the outputs.
const SHAPE_SCALE: f64 = 0.1515;
/// Scale of the tubes' shapes relative to the others. It sets the group of tube modes 40 dB below the highest
/// dominant peak.
const TUBE_SCALE: f64 = 0.091;

/// Frequency (Hz), damping ratio, and (piston, tip, tilt) of the platform and of the strut ends.
pub(crate) type Row = (f64, f64, [f64; 3], [f64; 3]);

pub(crate) const DOMINANT: [Row; 5] = [
    (136.0, 0.0045, [0.25, 0.15, 1.00], [0.40, 0.05, 0.95]),
    (168.0, 0.0055, [-0.20, 1.00, 0.25], [-0.15, 0.95, 0.10]),
    (186.0, 0.0040, [1.00, 0.20, -0.15], [1.05, 0.10, -0.25]),
    (212.0, 0.0060, [0.35, -0.95, 0.45], [0.30, -0.90, 0.40]),
    (243.0, 0.0070, [-0.75, 0.35, 0.65], [-0.70, 0.45, 0.60]),
];

pub(crate) const TRUNCATED: [Row; 8] = [
    (312.0, 0.0060, [0.10, 0.20, -0.15], [0.12, 0.15, -0.20]),
    (357.0, 0.0070, [-0.20, 0.10, 0.15], [-0.15, 0.15, 0.10]),
    (401.0, 0.0080, [0.15, -0.20, 0.10], [0.20, -0.20, 0.05]),
    (448.0, 0.0060, [0.20, 0.15, 0.20], [0.20, 0.10, 0.25]),
    (497.0, 0.0090, [-0.10, 0.25, 0.10], [-0.15, 0.20, 0.10]),
    (566.0, 0.0080, [0.25, 0.05, -0.10], [0.20, 0.10, -0.15]),
    (640.0, 0.0100, [0.10, -0.15, 0.25], [0.05, -0.20, 0.20]),
    (731.0, 0.0090, [-0.20, -0.20, 0.10], [-0.25, -0.15, 0.10]),
];

/// The tubes' frequencies in their two planes, Hz: nominally 60, with the scatter of tubes and bonds.
const TUBE_HZ: [[f64; MOST_MODES_PER_TUBE]; TUBES] =
    [[58.1, 61.4], [59.0, 62.3], [57.4, 60.6], [59.6, 63.0], [58.5, 61.0], [60.1, 62.7]];
const TUBE_DAMPING: [f64; TUBES] = [0.0040, 0.0050, 0.0035, 0.0045, 0.0055, 0.0030];

/// Returns all modes, lowest group first. `modes_per_tube` is 1 or 2.
pub(crate) fn modes(modes_per_tube: usize) -> Vec<Mode> {
    let tubes = (0..TUBES).flat_map(|tube| (0..modes_per_tube).map(move |plane| tube_mode(tube, plane)));
    let dominant = DOMINANT.iter().map(|row| platform_mode(row, ModeGroup::Dominant));
    let truncated = TRUNCATED.iter().map(|row| platform_mode(row, ModeGroup::Truncated));
    tubes.chain(dominant).chain(truncated).collect()
}

pub(crate) fn platform_mode(row: &Row, group: ModeGroup) -> Mode {
    let (frequency_hz, damping_ratio, platform, struts) = *row;
    let motion = |[piston, tip, tilt]: [f64; 3]| Motion { piston, tip, tilt };
    Mode {
        frequency_hz,
        damping_ratio,
        input_shape: motion(struts).at_corners(ACTUATOR_DEG, SHAPE_SCALE),
        output_shape: motion(platform).at_corners(SENSOR_DEG, SHAPE_SCALE),
        group,
    }
}

/// Returns the mode of a tube in a plane. Two tubes meet at each corner, and every other tube holds an actuator. The
/// motion of a tube is largest at its own corner and at its own actuator. The others see it through the platform,
/// with opposite signs for the two planes.
pub(crate) fn tube_mode(tube: usize, plane: usize) -> Mode {
    let corner = tube / 2;
    let sign = if plane == 0 { 1.0 } else { -1.0 };
    let own_actuator = if tube.is_multiple_of(2) { 1.0 } else { 0.5 };
    let shape = |own: f64, others: f64| -> [f64; 3] {
        std::array::from_fn(|i| SHAPE_SCALE * TUBE_SCALE * if i == corner { own } else { sign * others })
    };
    Mode {
        frequency_hz: TUBE_HZ[tube][plane],
        damping_ratio: TUBE_DAMPING[tube],
        input_shape: shape(own_actuator, 0.3),
        output_shape: shape(1.0, 0.35),
        group: ModeGroup::StrutTube,
    }
}
