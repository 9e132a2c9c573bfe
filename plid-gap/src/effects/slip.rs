/// Returns the hysteretic state z after its input has moved by `delta` in one direction: dz/dx = slope - z / width
/// while |z| grows towards its limit slope width, and dz/dx = slope while it falls. The result is exact for any
/// `delta`.
///
/// This solves dz = slope dx - (|dx| z + dx |z|) / (2 width).
pub(super) fn advance(z: f64, delta: f64, slope: f64, width: f64) -> f64 {
    if delta == 0.0 {
        return z;
    }
    // In the direction of motion.
    let (mut along, mut left) = (z * delta.signum(), delta.abs());
    if along < 0.0 {
        let to_zero = -along / slope;
        if left <= to_zero {
            return (along + slope * left) * delta.signum();
        }
        left -= to_zero;
        along = 0.0;
    }
    let limit = slope * width;
    (limit + (along - limit) * (-left / width).exp()) * delta.signum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result agrees with a million Euler steps of the equation itself.
    #[test]
    fn a_loop_is_that_of_the_differential_equation() {
        let (slope, width) = (0.7, 0.4);
        let mut fine = 0.1;
        let mut exact = 0.1;
        for (delta, steps) in [(1.3, 400_000), (-0.2, 100_000), (-1.5, 400_000), (0.9, 300_000)] {
            let dx = delta / f64::from(steps);
            for _ in 0..steps {
                fine += slope * dx - (dx.abs() * fine + dx * fine.abs()) / (2.0 * width);
            }
            exact = advance(exact, delta, slope, width);
            assert!((fine - exact).abs() < 1e-5, "{fine} {exact}");
        }
    }
}
