//! Curves that more than one effect uses.

mod course;
mod gap;
mod limit;
mod yielding;

pub use course::Course;
pub use gap::Gap;
pub use limit::Limit;
pub use yielding::Yielding;

/// Returns the force of a stop with a spring k and a damper c that is pressed in by x at the speed dx/dt. A stop
/// pushes and never pulls.
pub(crate) fn stop(k: f64, c: f64, x: f64, speed: f64) -> f64 {
    if x > 0.0 { (k * x + c * speed).max(0.0) } else { 0.0 }
}

/// Returns a |x / a|^q with the sign of x, which is exactly x for q = 1.
pub(crate) fn signed_power(x: f64, a: f64, q: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x * (x / a).abs().powf(q - 1.0) }
}
