//! Eq. 11-15: the required thickness of the piezoelectric wafers of an actuator.

use serde::Deserialize;

use crate::claim::{Claim, Context, Finding, Result};

pub const CLAIM: Claim = Claim {
    id: "sizing",
    statement: "Eq. 11-15 give a square adapter of about 0.16 in.",
    limit: "Arithmetic: it says that the printed numbers give the printed result, not that the adapter worked.",
    config: include_str!("../../experiments/sizing.toml"),
    vary: "",
    timed: false,
    run,
};

/// The design values, in inches, pounds per square inch, volts and rad/s.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sizes {
    /// Piezoelectric constant, in/V.
    d31: f64,
    /// Length of a wafer, in.
    length: f64,
    /// Its thickness, in.
    thickness: f64,
    /// Modulus of the ceramic, psi.
    modulus_ceramic: f64,
    /// Modulus of aluminium, psi.
    modulus_aluminium: f64,
    /// Acceleration, in units of gravity.
    acceleration_g: f64,
    /// Angular frequency, rad/s.
    frequency: f64,
    /// Voltage.
    voltage: f64,
    /// The result printed in the paper, in inches.
    printed: f64,
    /// Number of wafers in an actuator.
    wafers: f64,
}

/// Acceleration of gravity in in/s².
const GRAVITY: f64 = 386.0;

fn run(context: &Context<'_>) -> Result<Finding> {
    let s: Sizes = context.config()?;
    let ratio =
        s.modulus_ceramic * s.thickness * s.frequency.powi(2) / (s.modulus_aluminium * s.acceleration_g * GRAVITY);
    let side = s.d31 * (s.length / s.thickness) * ratio * s.voltage;
    let both = s.wafers * side;
    let near = |value: f64| (value / s.printed - 1.0).abs() < 0.05;
    Ok(Finding::default()
        .figure("side of the adapter", side, "in")
        .figure("the same with both wafers", both, "in")
        .part("The printed numbers give the printed result within 5 %, its last digit.", near(side))
        .part("So they do with the paper's own factor of 2 for the two wafers of an actuator.", near(both))
        .say(format!(
            "The equations give {side:.3} in with the paper's numbers, so its arithmetic is right; its own factor of \
             {} for the two wafers, which the result leaves out, would make it {both:.3} in.",
            s.wafers
        )))
}
