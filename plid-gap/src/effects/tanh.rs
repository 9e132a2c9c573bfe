//! The hyperbolic tangent. Laws of friction compute it in every part of every sample, and the function of the C
//! library would take most of the time of such a run.

/// Argument from which the result is one to the last digit.
const SATURATED: f64 = 19.1;

/// Argument below which the result is a quotient of polynomials; above it, the difference from one loses no digit.
const SMALL: f64 = 0.625;

/// Returns tanh x to about two units of the last digit. The polynomials are those of Cody and Waite (Software Manual
/// for the Elementary Functions, 1980, chapter 13).
pub(super) fn tanh(x: f64) -> f64 {
    const P: [f64; 3] = [-1.613_411_902_399_622_8e3, -9.922_592_967_223_608e1, -9.643_749_277_722_547e-1];
    const Q: [f64; 3] = [4.840_235_707_198_869e3, 2.233_772_071_896_231_3e3, 1.127_447_438_053_494_9e2];
    let size = x.abs();
    if size < SMALL {
        let z = x * x;
        return x + x * (z * ((P[2] * z + P[1]) * z + P[0]) / (((z + Q[2]) * z + Q[1]) * z + Q[0]));
    }
    let far = if size < SATURATED { 1.0 - 2.0 / ((2.0 * size).exp() + 1.0) } else { 1.0 };
    if x.is_nan() { x } else { far.copysign(x) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the whole range, the result agrees with that of the C library.
    #[test]
    fn it_is_the_hyperbolic_tangent() {
        let exact = |x: f64| assert_eq!(tanh(x).to_bits(), x.tanh().to_bits(), "{x}");
        [0.0, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 5e-324, 25.0].into_iter().for_each(exact);
        assert!(tanh(f64::NAN).is_nan());
        let close = |x: f64| assert!((tanh(x) / x.tanh() - 1.0).abs() < 3.0 * f64::EPSILON, "{x}: {}", tanh(x));
        for k in 1..40_000 {
            let x = f64::from(k) * 1.0e-3;
            [x, -x, 1e-3 * x].into_iter().for_each(close);
        }
        let edges = [SMALL, SATURATED].map(|edge| [edge.next_down(), edge, edge.next_up()]);
        edges.concat().into_iter().for_each(close);
    }
}
