//! The models of the 27 problems, as NIST states them.

use std::f64::consts::PI;

use crate::dual::Dual;

type B<'a> = &'a [Dual];

/// Of parameters b1 .. bn and the predictors of one observation.
pub type Model = fn(b: &[Dual], x: &[f64]) -> Dual;

/// Each problem's name and model.
pub const MODELS: [(&str, Model); 27] = [
    ("Misra1a", |b, x| b[0] * (1.0 - (-b[1] * x[0]).exp())),
    ("Chwirut2", |b, x| (-b[0] * x[0]).exp() / (b[1] + b[2] * x[0])),
    ("Chwirut1", |b, x| (-b[0] * x[0]).exp() / (b[1] + b[2] * x[0])),
    ("Lanczos3", exponentials),
    ("Gauss1", gaussians),
    ("Gauss2", gaussians),
    ("DanWood", |b, x| b[0] * Dual::from(x[0]).power(b[1])),
    ("Misra1b", |b, x| b[0] * (1.0 - 1.0 / (1.0 + b[1] * x[0] / 2.0).square())),
    ("Kirby2", |b, x| polynomial(&b[..3], x[0]) / (1.0 + x[0] * polynomial(&b[3..], x[0]))),
    ("Hahn1", cubics),
    ("Nelson", |b, x| b[0] - b[1] * x[0] * (-b[2] * x[1]).exp()),
    ("MGH17", |b, x| b[0] + b[1] * (-b[3] * x[0]).exp() + b[2] * (-b[4] * x[0]).exp()),
    ("Lanczos1", exponentials),
    ("Lanczos2", exponentials),
    ("Gauss3", gaussians),
    ("Misra1c", |b, x| b[0] * (1.0 - (1.0 + 2.0 * b[1] * x[0]).power((-0.5).into()))),
    ("Misra1d", |b, x| b[0] * b[1] * x[0] / (1.0 + b[1] * x[0])),
    ("Roszman1", |b, x| b[0] - b[1] * x[0] - (b[2] / (x[0] - b[3])).atan() / PI),
    ("ENSO", |b, x| {
        let wave = |cos: Dual, sin: Dual, period: Dual| {
            let angle = 2.0 * PI * x[0] / period;
            cos * angle.cos() + sin * angle.sin()
        };
        b[0] + wave(b[1], b[2], 12.0.into()) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])
    }),
    ("MGH09", |b, x| b[0] * x[0] * (x[0] + b[1]) / (x[0] * (x[0] + b[2]) + b[3])),
    ("Thurber", cubics),
    ("BoxBOD", |b, x| b[0] * (1.0 - (-b[1] * x[0]).exp())),
    ("Rat42", |b, x| b[0] / (1.0 + (b[1] - b[2] * x[0]).exp())),
    ("MGH10", |b, x| b[0] * (b[1] / (x[0] + b[2])).exp()),
    ("Eckerle4", |b, x| b[0] / b[1] * (-0.5 * ((x[0] - b[2]) / b[1]).square()).exp()),
    ("Rat43", |b, x| b[0] / (1.0 + (b[1] - b[2] * x[0]).exp()).power(1.0 / b[3])),
    ("Bennett5", |b, x| b[0] * (b[1] + x[0]).power(-1.0 / b[2])),
];

fn polynomial(coefficients: B, x: f64) -> Dual {
    coefficients.iter().rev().fold(Dual::from(0.0), |sum, &c| sum * x + c)
}

fn cubics(b: B, x: &[f64]) -> Dual {
    polynomial(&b[..4], x[0]) / (1.0 + x[0] * polynomial(&b[4..], x[0]))
}

fn exponentials(b: B, x: &[f64]) -> Dual {
    b.chunks(2).fold(Dual::from(0.0), |sum, b| sum + b[0] * (-b[1] * x[0]).exp())
}

fn gaussians(b: B, x: &[f64]) -> Dual {
    let bell = |b: B| b[0] * (-((x[0] - b[1]) / b[2]).square()).exp();
    b[0] * (-b[1] * x[0]).exp() + bell(&b[2..5]) + bell(&b[5..8])
}
