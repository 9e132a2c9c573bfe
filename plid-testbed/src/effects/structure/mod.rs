//! Effects inside the structure.

mod clearance;
mod coulomb_friction;
mod cubic_stiffness;
mod iwan_joint;
mod joint_hysteresis;
mod missing_mode;
mod modal_damping;
mod modal_frequency;
mod quadratic_damping;
mod quadratic_stiffness;
mod stiffness_drift;

pub use clearance::Clearance;
pub use coulomb_friction::{CoulombFriction, FrictionLaw};
pub use cubic_stiffness::{CubicLaw, CubicStiffness};
pub use iwan_joint::{IwanJoint, SliderLaw};
pub use joint_hysteresis::JointHysteresis;
pub use missing_mode::MissingMode;
pub use modal_damping::ModalDamping;
pub use modal_frequency::ModalFrequency;
pub use quadratic_damping::{DampingLaw, QuadraticDamping};
pub use quadratic_stiffness::{QuadraticLaw, QuadraticStiffness};
pub use stiffness_drift::StiffnessDrift;
