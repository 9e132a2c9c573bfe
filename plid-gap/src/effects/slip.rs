/// Returns the hysteretic state z after its input has moved by `delta` in one direction: dz/dx = slope - z / width
/// while |z| grows towards its limit, slope times width, and dz/dx = slope while it falls. The result is exact for
/// any `delta`.
///
/// This solves dz = slope dx - (|dx| z + dx |z|) / (2 width).
pub(super) fn advance(z: f64, delta: f64, slope: f64, width: f64) -> f64 {
    if delta == 0.0 {
        return z;
    }
    // The state and the remaining path, in the direction of motion.
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

/// Returns the hysteretic state z as [`advance`] does, but with the general law of Bouc and Wen for n = 1: dz/dx =
/// 1 - rise |z| while |z| grows, and dz/dx = 1 + fall |z| while it falls. A negative rate stiffens the loop.
///
/// This solves dz = dx - b |dx| z - g dx |z| with rise = b + g and fall = b - g.
pub(super) fn advance_skewed(z: f64, delta: f64, rise: f64, fall: f64) -> f64 {
    if delta == 0.0 {
        return z;
    }
    // The state and the remaining path, in the direction of motion.
    let (mut along, mut left) = (z * delta.signum(), delta.abs());
    if along < 0.0 {
        let to_zero = distance_to_zero(along, fall);
        if left <= to_zero {
            return moved(along, left, fall) * delta.signum();
        }
        left -= to_zero;
        along = 0.0;
    }
    moved(along, left, rise) * delta.signum()
}

/// Returns the solution of dz/dx = 1 - rate z after a path of length `way`.
fn moved(z: f64, way: f64, rate: f64) -> f64 {
    if rate == 0.0 { z + way } else { z + (z - 1.0 / rate) * (-rate * way).exp_m1() }
}

/// Returns the distance over which dz/dx = 1 - rate z leads from a negative z to zero; infinite if z falls there.
fn distance_to_zero(z: f64, rate: f64) -> f64 {
    let change = -rate * z;
    if rate == 0.0 {
        -z
    } else if change > -1.0 {
        change.ln_1p() / rate
    } else {
        f64::INFINITY
    }
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

    /// The general law agrees with its equation, too, whether it yields, stiffens or does both. It contains the
    /// simple law.
    #[test]
    fn a_skewed_loop_is_that_of_the_differential_equation() {
        let way = [(1.3, 400_000), (-0.2, 100_000), (-1.5, 400_000), (0.9, 300_000)];
        for (b, g) in [(1.2, 1.2), (1.2, 0.0), (0.8, -1.1), (0.3, 0.9)] {
            let (mut fine, mut exact) = (0.1_f64, 0.1);
            for (delta, steps) in way {
                let dx: f64 = delta / f64::from(steps);
                for _ in 0..steps {
                    fine += dx - b * dx.abs() * fine - g * dx * fine.abs();
                }
                exact = advance_skewed(exact, delta, b + g, b - g);
                assert!((fine - exact).abs() < 1e-5, "{b} {g}: {fine} {exact}");
            }
        }
        let mut z = [0.1, 0.1];
        for (delta, _) in way {
            z = [advance(z[0], delta, 1.0, 0.4), advance_skewed(z[1], delta, 2.5, 0.0)];
            assert!((z[0] - z[1]).abs() < 1e-14, "{z:?}");
        }
    }
}
