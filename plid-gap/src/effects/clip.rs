//! A limit whose corner may be round.

/// Roundness below which a corner is sharp.
const SHARP: f64 = 1e-3;

/// Largest roundness. With 1, the curve is x / (1 + |x/a|), which approaches its limit as slowly as an arctangent.
pub const MOST_ROUND: f64 = 1.0;

/// Returns x / (1 + |x/a|^(1/r))^r, the value of x after a limit of `a` whose corner has the roundness r = |`round`|.
/// With r = 0, the result is clipped; a hyperbolic tangent lies near r = 0.4.
pub fn clip(x: f64, a: f64, round: f64) -> f64 {
    let (ratio, round) = ((x / a).abs(), round.abs());
    if round < SHARP {
        return x.clamp(-a, a);
    }
    // Only numbers up to one are raised to the power 1/r, so that nothing overflows.
    let size = if ratio <= 1.0 {
        ratio * (1.0 + ratio.powf(1.0 / round)).powf(-round)
    } else {
        (1.0 + ratio.powf(-1.0 / round)).powf(-round)
    };
    a * size.copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_a_clip_and_a_slow_curve() {
        for x in [-40.0, -1.0, -0.3, 0.0, 0.3, 1.0, 40.0_f64] {
            let sharp = clip(x, 0.7, 0.0);
            assert_eq!(sharp, x.clamp(-0.7, 0.7));
            assert!((clip(x, 0.7, 2e-3) - sharp).abs() < 2e-3, "{x}");
            assert!((clip(x, 0.7, 0.5) - x / (1.0 + (x / 0.7).powi(2)).sqrt()).abs() < 1e-14, "{x}");
            assert!((clip(x, 0.7, -1.0) - x / (1.0 + (x / 0.7).abs())).abs() < 1e-14, "{x}");
            assert!((clip(x, 0.7, 0.4) - 0.7 * (x / 0.7).tanh()).abs() < 0.03, "{x}");
        }
    }
}
