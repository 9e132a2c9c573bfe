//! Targets of the recursion at n = 64 (N = 448), and whether they are met.

use plid_catalogue::{CovarianceName as Form, ExpectationName as Expectation, ScalarName, Variant};
use serde::Serialize;

use super::cell::{expectations as all_expectations, word};
use super::outcome::{Outcome, Timing};
use super::peers::Peers;
use crate::Noise;

/// The number of states for which the targets are set.
pub const STATES: usize = 64;
/// The time between two samples at 1600 Hz in us.
pub const SAMPLE_US: f64 = 625.0;

/// One target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Target {
    /// The quantity.
    pub what: String,
    /// The target in words; empty if there is none for the quantity.
    pub target: String,
    /// The measured value in words.
    pub found: String,
    /// Whether the target is reached; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub met: Option<bool>,
    /// The limiting factor, if the target is missed.
    pub reason: String,
}

/// Returns all targets whose cells were measured.
pub fn targets(outcome: &Outcome, peers: Option<&Peers>) -> Vec<Target> {
    let mut targets = Vec::new();
    targets.extend(all_expectations().into_iter().filter_map(|e| passes(outcome, e)));
    for form in Form::all().into_iter().filter(|&form| form != Form::Direct) {
        for noise in [Noise::Diagonal, Noise::Full] {
            targets.extend(all_expectations().into_iter().filter_map(|e| against_direct(outcome, form, e, noise)));
        }
    }
    targets.extend(peers.map(against_peers).unwrap_or_default());
    targets.extend(slopes(outcome));
    for form in Form::all() {
        targets.extend(single_precision(outcome, form));
    }
    for form in Form::all() {
        targets.extend(two_threads(outcome, form));
    }
    for form in Form::all() {
        targets.extend(real_time(outcome, form));
    }
    targets.extend(allocations(outcome));
    targets
}

fn at_most(what: String, found: f64, limit: f64, unit: &str, reason: impl FnOnce() -> String) -> Target {
    let met = found <= limit;
    Target {
        what,
        target: format!("≤ {limit} {unit}"),
        found: format!("{found:.2} {unit}"),
        met: Some(met),
        reason: if met { String::new() } else { reason() },
    }
}

fn passes(outcome: &Outcome, expectations: Expectation) -> Option<Target> {
    let timing = outcome.plain(STATES, Form::Direct, expectations)?;
    let limit_us = 3.0 * timing.median_us / timing.passes;
    let what = format!("direct, {}", word(&expectations));
    Some(at_most(what, timing.passes, 3.0, "passes over P", || reason(outcome, timing, limit_us)))
}

/// Compares the time of a form with that of the direct form. Only the built-in forms have targets.
fn against_direct(outcome: &Outcome, form: Form, expectations: Expectation, noise: Noise) -> Option<Target> {
    let of = |form| outcome.of(STATES, form, expectations, |cell| cell.noise = noise);
    let (timing, direct) = (of(form)?, of(Form::Direct)?);
    let found = timing.passes / direct.passes;
    let full = if noise == Noise::Full { ", full noise" } else { "" };
    let what = format!("{}, {}{full}", word(&form), word(&expectations));
    let limit = match (form, expectations) {
        _ if noise == Noise::Full => None,
        (Form::Joseph, _) => Some(2.0),
        (Form::ArraySqrt, _) => Some(4.0),
        (Form::BiermanUd, Expectation::JointEkf | Expectation::CertaintyEquivalent) => Some(1.6),
        (Form::BiermanUd, _) => Some(3.0),
        _ => None,
    };
    Some(match limit {
        Some(limit) => at_most(what, found, limit, "× direct", || reason(outcome, timing, limit * direct.median_us)),
        None => stated(what, format!("{found:.2} × direct, {:.2} passes over P", timing.passes)),
    })
}

fn stated(what: String, found: String) -> Target {
    Target { what, target: String::new(), found, met: None, reason: String::new() }
}

/// Returns the reason why a step does not reach its target time, according to the measured limits.
fn reason(outcome: &Outcome, timing: &Timing, target_us: f64) -> String {
    let Some([operations_us, bytes_us]) = outcome.bounds_us(timing) else { return "no limit was measured".into() };
    let megaflops = timing.operations.total() as f64 / 1e6;
    let bound_us = operations_us.max(bytes_us);
    let limits = format!(
        "its {megaflops:.2} Mflop take {operations_us:.0} us at the measured peak, its bytes {bytes_us:.0} us at the \
         rate of the pass"
    );
    if bound_us > target_us {
        format!("not achievable on this machine: {limits}; the target is {target_us:.0} us")
    } else {
        let share = 100.0 * bound_us / timing.median_us;
        let what = if operations_us > bytes_us { "peak" } else { "rate of the pass" };
        format!(
            "{limits}; the step takes {:.0} us, {share:.0} % of the {what}, and the target is {target_us:.0} us",
            timing.median_us
        )
    }
}

fn against_peers(peers: &Peers) -> Vec<Target> {
    let kinds = [(true, "structured", 5.0), (false, "dense", 25.0)];
    let target = |(structured, kind, limit): (bool, &str, f64)| {
        let peer = peers.fastest(STATES, structured)?;
        let (own_us, met) = (peer.plid_us_per_step, peer.ratio >= limit);
        let reason = format!("the target would need a step of {:.0} us", peer.us_per_step / limit);
        Some(Target {
            what: format!("direct, joint-ekf vs. the fastest {kind} peer, {}", peer.name),
            target: format!("≥ {limit} × as fast"),
            found: format!("{:.1} × ({:.0} us, plid {own_us:.0} us)", peer.ratio, peer.us_per_step),
            met: Some(met),
            reason: if met { String::new() } else { reason },
        })
    };
    kinds.into_iter().filter_map(target).collect()
}

fn slopes(outcome: &Outcome) -> Vec<Target> {
    let plain = |variant: &Variant| {
        *variant == super::cell::Cell::plain(STATES, variant.covariance, variant.expectations).variant
    };
    let mut targets = Vec::new();
    for slope in outcome.slopes.iter().filter(|slope| plain(&slope.variant)) {
        let form = slope.variant.covariance;
        let what = format!("slope of log time, {}, {}", word(&form), word(&slope.variant.expectations));
        let found = format!("{:.2} (operations {:.2})", slope.time, slope.operations);
        targets.push(if form == Form::Direct {
            let reason = || {
                format!(
                    "the operations' own slope is {:.2}; the larger matrices leave the nearest cache",
                    slope.operations
                )
            };
            Target { found: found.clone(), ..at_most(what, slope.time, 2.1, "", reason) }
        } else {
            stated(what, found)
        });
    }
    targets
}

fn single_precision(outcome: &Outcome, form: Form) -> Vec<Target> {
    let of = |expectations| {
        let double = outcome.plain(STATES, form, expectations)?;
        let single = outcome.of(STATES, form, expectations, |cell| cell.variant.scalar = ScalarName::F32)?;
        let what = format!("f32, {}, {}", word(&form), word(&expectations));
        let limit_us = 0.6 * double.median_us;
        Some(at_most(what, single.median_us / double.median_us, 0.6, "× f64", || reason(outcome, single, limit_us)))
    };
    all_expectations().into_iter().filter_map(of).collect()
}

fn two_threads(outcome: &Outcome, form: Form) -> Vec<Target> {
    let of = |(states, expectations)| {
        let one = outcome.plain(states, form, expectations)?;
        let two = outcome.of(states, form, expectations, |cell| cell.threads = 2)?;
        let factor = one.median_us / two.median_us;
        let what = format!("two threads, n = {states}, {}, {}", word(&form), word(&expectations));
        let found = format!("{factor:.2} × as fast ({:.0} us)", two.median_us);
        if form != Form::BiermanUd {
            return Some(stated(what, found));
        }
        let met = factor >= 1.5;
        let reason = if met {
            String::new()
        } else {
            "the parts that run on one thread, and the synchronisation of the threads".into()
        };
        Some(Target { what, target: "≥ 1.5 × as fast".into(), found, met: Some(met), reason })
    };
    [48, STATES].into_iter().flat_map(|n| all_expectations().into_iter().map(move |e| (n, e))).filter_map(of).collect()
}

fn real_time(outcome: &Outcome, form: Form) -> Option<Target> {
    // The slowest expectation represents the form.
    let worst = all_expectations()
        .into_iter()
        .filter_map(|expectations| outcome.plain(STATES, form, expectations))
        .max_by(|a, b| a.p99_9_us.total_cmp(&b.p99_9_us))?;
    let what = format!("real time at 1600 Hz: p99.9 of {}, {}", word(&form), word(&worst.cell.variant.expectations));
    Some(at_most(what, worst.p99_9_us, SAMPLE_US, "us", || {
        format!(
            "the median is {:.0} us, the longest of {} steps {:.0} us",
            worst.median_us, worst.steps, worst.longest_us
        )
    }))
}

fn allocations(outcome: &Outcome) -> Option<Target> {
    let counted: Vec<usize> = outcome.timings.iter().filter_map(|timing| timing.allocated_bytes).collect();
    let total: usize = counted.iter().sum();
    let guilty = || {
        let first = outcome.timings.iter().find(|timing| timing.allocated_bytes.is_some_and(|count| count > 0));
        first.map(|timing| format!("for one: {}", timing.key)).unwrap_or_default()
    };
    (!counted.is_empty()).then(|| Target {
        what: format!("bytes allocated within all timed steps of {} cells", counted.len()),
        target: "0".into(),
        found: total.to_string(),
        met: Some(total == 0),
        reason: if total == 0 { String::new() } else { guilty() },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::speed::outcome::testing::{outcome, timing};
    use crate::speed::peers::{Peer, Size};

    fn run(ud: f64) -> Outcome {
        outcome(vec![
            timing(64, Form::Direct, Expectation::JointEkf, 10.0, &[2.5]),
            timing(64, Form::BiermanUd, Expectation::JointEkf, 10.0, &[ud]),
        ])
    }

    fn target<'a>(targets: &'a [Target], what: &str) -> &'a Target {
        targets.iter().find(|target| target.what == what).unwrap_or_else(|| panic!("{what}: {targets:#?}"))
    }

    #[test]
    fn targets_are_met_or_missed_with_a_reason() {
        let good = targets(&run(3.9), None);
        assert_eq!(target(&good, "direct, joint-ekf").found, "2.50 passes over P");
        let ud = target(&good, "bierman-ud, joint-ekf");
        assert_eq!((ud.met, ud.found.as_str(), ud.reason.as_str()), (Some(true), "1.56 × direct", ""));
        let bad = targets(&run(70.0), None);
        let ud = target(&bad, "bierman-ud, joint-ekf");
        assert_eq!(ud.met, Some(false));
        assert!(ud.reason.contains("the step takes 700 us"), "{}", ud.reason);
        assert_eq!(target(&bad, "real time at 1600 Hz: p99.9 of bierman-ud, joint-ekf").met, Some(false));
        assert_eq!(target(&good, "bytes allocated within all timed steps of 2 cells").met, Some(true));
    }

    #[test]
    fn a_target_below_the_limits_is_out_of_reach() {
        let mut run = run(70.0);
        run.timings[1].operations.additions = 10_000_000;
        let all = targets(&run, None);
        assert!(
            target(&all, "bierman-ud, joint-ekf")
                .reason
                .starts_with("not achievable on this machine: its 10.00 Mflop take 200 us")
        );
    }

    #[test]
    fn the_fastest_peer_of_each_kind_counts() {
        let peer = |name: &str, us: f64, structured| Peer {
            name: name.into(),
            version: "1".into(),
            form: "direct".into(),
            dtype: "f64".into(),
            us_per_step: us,
            plid_us_per_step: 100.0,
            ratio: us / 100.0,
            agreement: 1e-9,
            structured,
        };
        let peers = vec![peer("a", 600.0, true), peer("b", 700.0, true), peer("c", 1000.0, false)];
        let size = Size { n: 64, inputs: 3, outputs: 3, peers, refused: Vec::new() };
        let all = targets(&run(3.0), Some(&Peers { sizes: vec![size] }));
        let against = |peer: &str| target(&all, &format!("direct, joint-ekf vs. the fastest {peer}"));
        assert_eq!(against("structured peer, a").met, Some(true));
        assert_eq!(against("dense peer, c").met, Some(false));
        assert!(against("dense peer, c").reason.contains("a step of 40 us"));
    }
}
