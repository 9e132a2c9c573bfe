//! Effects inside the structure.

mod added_damping;
mod added_mass;
mod added_stiffness;
mod backlash;
mod clearance;
mod coulomb_friction;
mod cubic_stiffness;
mod end_stop;
mod gravity_sine;
mod joint_hysteresis;
mod missing_mode;
mod modal_damping;
mod modal_frequency;
mod one_sided_stop;
mod quadratic_damping;
mod quadratic_stiffness;
mod stick_friction;
mod stiffness_drift;

pub use added_damping::AddedDamping;
pub use added_mass::AddedMass;
pub use added_stiffness::AddedStiffness;
pub use backlash::Backlash;
pub use clearance::Clearance;
pub use coulomb_friction::{CoulombFriction, FrictionLaw};
pub use cubic_stiffness::{CubicLaw, CubicStiffness};
pub use end_stop::EndStop;
pub use gravity_sine::GravitySine;
pub use joint_hysteresis::JointHysteresis;
pub use missing_mode::MissingMode;
pub use modal_damping::ModalDamping;
pub use modal_frequency::ModalFrequency;
pub use one_sided_stop::OneSidedStop;
pub use quadratic_damping::{DampingLaw, QuadraticDamping};
pub use quadratic_stiffness::{QuadraticLaw, QuadraticStiffness};
pub use stick_friction::{StickFriction, StickLaw};
pub use stiffness_drift::StiffnessDrift;
