//! Settings of the decomposition of a simulation.

use super::group::group;

group! {
    /// The decomposition of a simulation into structural modes, actuators and filters, and the kinds of its outputs.
    PlantSettings {
        /// Damping ratio up to which a pair of poles is a structural mode. More strongly damped pairs belong to
        /// filters, unless a mode that is damped less lies above them: filters lie above the structure.
        light_damping: f64 = 0.3, "1", 0.0..=1.0;
        /// Damping ratio up to which such a lower pair is a structural mode: a body in a soft suspension, held by its
        /// controller or in a fluid.
        heavy_damping: f64 = 0.95, "1", 0.0..=1.0;
        /// Condition number of an eigenvalue, which is the product of the norms of its left and right eigenvectors, up
        /// to which its mode is separated from the rest.
        mode_condition: f64 = 1e5, "1", 1.0..=1e15;
        /// Relative distance below which two poles of the rest count as one repeated pole.
        repeated_pole: f64 = 1e-3, "1", 1e-12..=1.0;
        /// Relative error up to which the eigenvectors of a pole may reach other channels, if the pole is to be that of
        /// one input's actuator or of one output's filter.
        own_channel: f64 = 1e-3, "1", 1e-12..=1.0;
        /// Magnitude of a pole, over the sample rate, below which the pole is an integrator: its rate is not a number
        /// that can be off by a share.
        integrator: f64 = 1e-7, "1", 0.0..=1.0;
        /// Largest distance of an output's response from that of a displacement, velocity or acceleration that it can
        /// be said to measure. A sensor with unknown dynamics is further from all three.
        kind_distance: f64 = 0.5, "1", 0.0..=1.0;
        /// Largest ratio of that distance to the distance of the next kind.
        kind_ratio: f64 = 0.5, "1", 0.0..=1.0;
        /// Largest distance of a response from the derivative of its presumed integral, such as the displacement at a
        /// port whose velocity is measured. It is zero for exact simulations and small for one that was identified from
        /// records; for a motor, whose position is not a combination of its states, it is nearly one.
        port_distance: f64 = 0.1, "1", 0.0..=1.0;
        /// Largest phase of a mode's residue between a force and the displacement where it acts, which is a positive
        /// number in a structure without damping. A sensor elsewhere sees some mode with the opposite sign.
        collocated_phase: f64 = 0.35, "rad", 0.0..=1.5;
        /// Least ratio of the response to a fast input (a quarter of the sample rate) to that to a slow one (a
        /// thousandth of it) for the input to count as a motion and the output as the force that it requires, where
        /// neither is declared. A spring with friction has a ratio near one, and a damper a much larger one.
        force_rise: f64 = 5.0, "1", 1.0..=1e6;
        /// Displacement that a force may cause immediately, times the lowest mode's frequency, over the velocity that
        /// it causes. It is zero in an exact simulation and small after the time steps of a simulator. A model that was
        /// identified from records may have much more.
        at_once: f64 = 0.1, "1", 0.0..=1e3;
    }
}
