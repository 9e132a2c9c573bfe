//! Settings of the decomposition of a simulation.

use super::group::group;

group! {
    /// The decomposition of a simulation into structural modes, actuators and filters, and the kinds of its outputs.
    PlantSettings {
        /// Damping ratio below which a pair of poles is a structural mode. More strongly damped pairs belong to
        /// filters, unless a lightly damped mode has a higher frequency: filters lie above the structure.
        light_damping: f64 = 0.3, "1", 0.0..=1.0;
        /// Damping ratio below which a pair of poles at a lower frequency than such a mode is a structural mode, too: a
        /// body in a soft suspension, held by its controller or in a fluid.
        heavy_damping: f64 = 0.95, "1", 0.0..=1.0;
        /// Condition number of an eigenvalue, which is the product of the norms of its left and right eigenvectors,
        /// below which its mode is separated from the other states.
        mode_condition: f64 = 1e5, "1", 1.0..=1e15;
        /// Relative distance below which two poles that are not structural modes count as one repeated pole.
        repeated_pole: f64 = 1e-3, "1", 1e-12..=1.0;
        /// Largest relative coupling of a pole's eigenvectors to other channels with which the pole still belongs to
        /// one input's actuator or to one output's filter.
        own_channel: f64 = 1e-3, "1", 1e-12..=1.0;
        /// Magnitude of a pole, over the sample rate, below which the pole is an integrator, whose rate cannot have a
        /// relative error.
        integrator: f64 = 1e-7, "1", 0.0..=1.0;
        /// Largest distance between an output's response and that of a displacement, velocity or acceleration for the
        /// output to count as a measurement of that quantity. The response of a sensor with unknown dynamics is further
        /// from all three.
        kind_distance: f64 = 0.5, "1", 0.0..=1.0;
        /// Largest ratio of that distance to the distance from the next nearest kind.
        kind_ratio: f64 = 0.5, "1", 0.0..=1.0;
        /// Largest distance of a response from the derivative of its presumed integral, such as the displacement at a
        /// port whose velocity is measured. The distance is zero for exact simulations and small for one that was
        /// identified from records. It is nearly one for a motor, whose position is not a combination of its states.
        port_distance: f64 = 0.1, "1", 0.0..=1.0;
        /// Largest phase of a mode's residue in the response of a displacement to a force that acts at the same point.
        /// In a structure without damping, this residue is a positive number. A sensor elsewhere sees some mode with
        /// the opposite sign.
        collocated_phase: f64 = 0.35, "rad", 0.0..=1.5;
        /// Smallest ratio of the response to a fast input (a quarter of the sample rate) to that to a slow one (a
        /// thousandth of it) for the input to count as a motion and the output as the force that this motion requires,
        /// if neither is declared. A spring with friction has a ratio near one, and a damper a much larger one.
        force_rise: f64 = 5.0, "1", 1.0..=1e6;
        /// Displacement that a force may cause immediately, times the lowest mode's frequency, over the velocity that
        /// the force causes. This ratio is zero in an exact simulation and small in one that a simulator computed in
        /// time steps. It may be much larger in a model that was identified from records.
        at_once: f64 = 0.1, "1", 0.0..=1e3;
    }
}
