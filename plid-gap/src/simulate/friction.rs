//! Dry friction in a part of a sample in which it holds its port, lets it go or brings it to rest.
//!
//! The instant at which it switches is located within the part. The force before and after is replaced by the straight
//! line that has the same sum and the same first moment, so that velocity and displacement at the end of the part are
//! those of the force that switches, up to terms of third order in the length of the part.

/// Displacement and velocity at the end of a part due to the port's own force.
pub struct Response {
    /// Due to a unit that is held.
    pub held: [f64; 2],
    /// Due to a ramp from zero to one.
    pub ramp: [f64; 2],
}

/// The friction in such a part.
pub struct Switched {
    /// The force at the start of the part, and its linear change.
    pub start: f64,
    pub change: f64,
    /// The force that holds the port at the end of the part, or with which it slides off.
    pub force: f64,
    /// The share of the part in which the port slides off; zero if it is at rest at the end.
    pub slides: f64,
}

/// The motion (displacement and velocity) of a port over a part if the force at its start is held.
pub struct Part {
    /// The motion at the start.
    pub from: [f64; 2],
    /// The motion at the end.
    pub to: [f64; 2],
    /// The force.
    pub acting: f64,
    /// Whether the friction holds the port at the start.
    pub stuck: bool,
}

impl Part {
    /// Returns the friction, of at most `most` at rest; `None` if the port slides over the whole part.
    #[inline]
    pub fn switched(&self, most: f64, by: &Response) -> Option<Switched> {
        if self.stuck || self.from[1] == 0.0 {
            return Some(self.leaving_rest(most, by));
        }
        (self.from[1] * self.to[1] <= 0.0).then(|| self.to_rest(most, by))
    }

    /// The port is at rest. The force that keeps it there is a straight line: it brings back both the displacement
    /// and the velocity. If the displacement is not known, the force is constant. The port slides off as soon as this
    /// force exceeds its limit.
    #[inline]
    fn leaving_rest(&self, most: f64, by: &Response) -> Switched {
        let ([d_held, v_held], [d_ramp, v_ramp]) = (by.held, by.ramp);
        let (moved, v) = (self.to[0] - self.from[0], self.to[1]);
        let twist = v_held * d_ramp - d_held * v_ramp;
        let change = if twist == 0.0 { 0.0 } else { (d_held * v - v_held * moved) / twist };
        let start = self.acting - (v + v_ramp * change) / v_held;
        let (middle, end) = (start + 0.5 * change, start + change);
        if start.abs() > most && middle.abs() > most {
            // The other forces have jumped beyond the limit.
            let force = most.copysign(middle);
            return Switched { start: force, change: 0.0, force, slides: 1.0 };
        }
        if start.abs() <= most && end.abs() > most {
            let force = most.copysign(end);
            let share = (force - start) / change;
            let [start, change] = bent(share, [start, force], [force; 2]);
            return Switched { start, change, force, slides: 1.0 - share };
        }
        Switched { start, change, force: end, slides: 0.0 }
    }

    /// The velocity passes through zero. The instant follows from the velocities at both ends of the part, over which
    /// the friction is assumed to change linearly to its limit. From this instant on, the port is held if the limit
    /// allows it. Otherwise, it slides off in the other direction.
    #[inline]
    fn to_rest(&self, most: f64, by: &Response) -> Switched {
        let (v, v_held) = (self.from[1], by.held[1]);
        let last = -most.copysign(v);
        let braked = self.to[1] + 0.5 * v_held * (last - self.acting);
        let share = (v / (v - braked)).clamp(0.0, 1.0);
        let wanted = self.acting - (self.to[1] - v) / v_held;
        let force = wanted.clamp(-most, most);
        let [start, change] = bent(share, [self.acting, last], [force; 2]);
        if force != wanted {
            return Switched { start, change, force, slides: 1.0 - share };
        }
        // The velocity at the end is exactly zero.
        let start = self.acting - (self.to[1] + by.ramp[1] * change) / v_held;
        Switched { start, change, force, slides: 0.0 }
    }
}

/// Returns the start and the change of the straight line with the sum and the first moment of two straight pieces, each
/// of which goes from one value to another. The second piece begins at this share of the part.
#[inline]
fn bent(share: f64, before: [f64; 2], after: [f64; 2]) -> [f64; 2] {
    let left = 1.0 - share;
    let [first, second] = [before, after].map(|[from, to]| 0.5 * (from + to));
    let sum = share * first + left * second;
    // The moment about the end of the part.
    let moment =
        share * (first - share * (before[0] + 2.0 * before[1]) / 6.0) + left * left * (2.0 * after[0] + after[1]) / 6.0;
    [6.0 * moment - 2.0 * sum, 6.0 * sum - 12.0 * moment]
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, dmatrix};
    use plid_model::{Continuous, Model, Port};

    use crate::case::record::Channels;
    use crate::effects::{Effect, Place, Setting, StickFriction};
    use crate::plant::Plant;
    use crate::simulate::{Fineness, simulate};

    const RATE: f64 = 10.0;

    /// The friction, at rest as well as in motion.
    const FORCE: f64 = 0.8;

    /// Commands of several sizes, so that the friction switches at all shares of a part.
    fn sizes(from: f64, to: f64) -> impl Iterator<Item = f64> {
        (0..=22).map(move |k| from + (to - from) * f64::from(k) / 22.0)
    }

    /// Returns a plant whose last two states are the displacement and the velocity of a unit mass, which are also its
    /// outputs, with a port at the mass.
    fn mass(a: DMatrix<f64>, b: DMatrix<f64>) -> Model {
        let n = a.nrows();
        let row = |at: usize| (0..n).map(|k| f64::from(u8::from(k == at))).collect::<Vec<f64>>();
        let c = DMatrix::from_fn(2, n, |o, k| row(n - 2 + o)[k]);
        let (step, held) = plid_model::held(&a, &b, 1.0 / RATE);
        let mut model = Model::new(RATE, step, held, c, DMatrix::zeros(2, 1)).unwrap();
        model.continuous = Some(Continuous { a, b });
        model.ports = vec![Port {
            name: "mass".into(),
            input: None,
            force: row(n - 1),
            displacement: row(n - 2),
            velocity: row(n - 1),
            output: None,
        }];
        model
    }

    /// Returns displacement and velocity at the samples, with this number of parts of a sample.
    fn run(model: &Model, u: Vec<f64>, parts: usize) -> Channels {
        let plant = Plant::new(model).unwrap();
        let setting = Setting::bare(&plant, model);
        let actions = StickFriction.act(&setting, &Place::Port(0), &[FORCE, FORCE, 0.3]);
        simulate(&plant, &actions, &[u], 0.0, None, Fineness { force: parts, drift: 16 })
    }

    /// Returns the relative errors with one, two, four and eight parts of a sample, each the largest of all commands.
    fn errors(commands: &[f64], of: impl Fn(f64, usize) -> f64) -> [f64; 4] {
        [1, 2, 4, 8].map(|parts| commands.iter().map(|u| of(*u, parts).abs()).fold(0.0, f64::max))
    }

    fn assert_third_order(errors: [f64; 4], coarse: f64) {
        assert!(errors[0] < coarse, "{errors:?}");
        assert!(errors.windows(2).all(|pair| pair[1] < 0.2 * pair[0]), "{errors:?}");
    }

    /// A command of half a second accelerates a mass on a damper c, which then slides to rest: the instant at which it
    /// stops and the distance are those of the closed form. Without a damper, they are exact for steps of any length.
    #[test]
    fn a_mass_slides_to_rest_where_it_should() {
        const PUSHED: usize = 5;
        let stop = |c: f64, u: f64, parts: usize| {
            let command = (0..60).map(|k| if k < PUSHED { u } else { 0.0 }).collect();
            let y = run(&mass(dmatrix![0.0, 1.0; 0.0, -c], dmatrix![0.0; 1.0]), command, parts);
            let t = PUSHED as f64 / RATE;
            let (d, time) = if c == 0.0 {
                let v = (u - FORCE) * t;
                (0.5 * v * t + 0.5 * v * v / FORCE, t + v / FORCE)
            } else {
                let v = (u - FORCE) / c * -(-c * t).exp_m1();
                let slides = (c * v / FORCE).ln_1p() / c;
                (((u - FORCE) * t - v) / c + (v - FORCE * slides) / c, t + slides)
            };
            // It moves at the samples between the start and the stop, and never back.
            let moves = (0..60).filter(|&k| y[1][k] > 1e-9).count();
            assert!((moves as f64 + 0.5 - time * RATE).abs() < 0.51, "{c} {u} {parts}: {moves} {time}");
            assert!(y[1].iter().all(|v| *v > -1e-12) && y[1][59].abs() < 1e-12);
            y[0][59] / d - 1.0
        };
        let commands: Vec<f64> = sizes(2.03, 4.0).collect();
        assert!(errors(&commands, |u, parts| stop(0.0, u, parts)).iter().all(|error| *error < 1e-12));
        assert_third_order(errors(&commands, |u, parts| stop(1.0, u, parts)), 4e-4);
        assert_third_order(errors(&commands, |u, parts| stop(3.0, u, parts)), 2e-3);
    }

    /// A force that rises behind a lag, or as a ramp, moves the mass from the instant at which it exceeds the limit. A
    /// ramp is followed exactly.
    #[test]
    fn a_mass_breaks_away_when_it_should() {
        const SAMPLES: usize = 20;
        let breaks = |a: f64, u: f64, parts: usize| {
            let gain = if a == 0.0 { 1.0 } else { a };
            let matrix = dmatrix![-a, 0.0, 0.0; 0.0, 0.0, 1.0; 1.0, 0.0, 0.0];
            let y = run(&mass(matrix, dmatrix![gain; 0.0; 0.0]), vec![u; SAMPLES], parts);
            let end = (SAMPLES - 1) as f64 / RATE;
            let (d, v, begins) = if a == 0.0 {
                let t = end - FORCE / u;
                (u * t.powi(3) / 6.0, u * t * t / 2.0, FORCE / u)
            } else {
                let begins = -(-FORCE / u).ln_1p() / a;
                let t = end - begins;
                let lagged = -(-a * t).exp_m1() / a;
                ((u - FORCE) * (t * t / 2.0 - (t - lagged) / a), (u - FORCE) * (t - lagged), begins)
            };
            let rests = y[0].iter().take_while(|d| d.abs() < 1e-6).count();
            assert!((rests as f64 - 1.0 - begins * RATE).abs() <= 1.0, "{a} {u} {parts}: {rests} {begins}");
            (y[0][SAMPLES - 1] / d - 1.0).abs().max((y[1][SAMPLES - 1] / v - 1.0).abs())
        };
        let commands: Vec<f64> = sizes(1.3, 2.1).collect();
        assert!(errors(&commands, |u, parts| breaks(0.0, u, parts)).iter().all(|error| *error < 1e-12));
        assert_third_order(errors(&commands, |u, parts| breaks(1.5, u, parts)), 2e-4);
    }

    /// The straight line has the sum and the moment of both pieces.
    #[test]
    fn a_straight_line_moves_a_body_as_two_pieces_do() {
        let (before, after) = ([1.0, 3.0], [-2.0, 0.5]);
        for share in [0.0, 0.3, 1.0] {
            let [start, change] = super::bent(share, before, after);
            let (mut sum, mut moment) = (0.0, 0.0);
            for k in 0..100_000 {
                let t = (f64::from(k) + 0.5) / 1e5;
                let f = if t < share {
                    before[0] + (before[1] - before[0]) * t / share
                } else {
                    after[0] + (after[1] - after[0]) * (t - share) / (1.0 - share)
                };
                (sum, moment) = (sum + f * 1e-5, moment + f * (1.0 - t) * 1e-5);
            }
            assert!((start + change / 2.0 - sum).abs() < 1e-4, "{share}");
            assert!((start / 2.0 + change / 6.0 - moment).abs() < 1e-4, "{share}");
        }
    }
}
