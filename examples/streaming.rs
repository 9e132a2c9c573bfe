//! Follows a plant while it runs, one sample at a time. Its mode stiffens, and a sensor fails for a while.
//!
//!     cargo run --example streaming

use plid::backends::Plain;
use plid::covariance::BiermanUd;
use plid::expectations::MomentMatched;
use plid::model::modes;
use plid::{Identifier, NoiseModel, ObservableForm, Settings, ToModel};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 100.0;
const DAMPING: f64 = 0.03;
/// RMS of the sensor noise. The response of the plant is about eighteen times as large.
const NOISE: f64 = 0.1;

/// One mode of unit mass, driven by an acceleration that is held over the sample. Its displacement is measured.
struct Plant {
    displacement: f64,
    velocity: f64,
}

impl Plant {
    /// Computes the exact motion over a sample under the constant acceleration `u`, in units of the static
    /// displacement.
    fn step(&mut self, frequency_hz: f64, u: f64) {
        let w = std::f64::consts::TAU * frequency_hz;
        let (decay, damped) = (DAMPING * w, w * (1.0 - DAMPING * DAMPING).sqrt());
        let (sin, cos) = (damped / RATE_HZ).sin_cos();
        let shrink = (-decay / RATE_HZ).exp();
        let (q, v) = (self.displacement - u, self.velocity);
        self.displacement = u + shrink * (q * cos + (v + decay * q) / damped * sin);
        self.velocity = shrink * (v * cos - (decay * v + w * w * q) / damped * sin);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut random = ChaCha12Rng::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut plant = Plant { displacement: 0.0, velocity: 0.0 };

    let form = ObservableForm::new(&[2], 1)?;
    let noise = NoiseModel::diagonal(&[NOISE * NOISE], &[0.0], &[1e-6; 2]);
    // Forgetting keeps the gain from vanishing. With a factor of 0.99, the memory is about 100 samples, or one second.
    let settings = Settings { forgetting: 0.99, ..Settings::new(&form, 1.0, 1.0) };
    let mut identifier = Identifier::<BiermanUd<Plain<f64>>, MomentMatched<f64>>::new(form, &noise, &settings)?;

    println!("   time    true   found   damping  innovation  smallest pivot");
    for k in 0..6000 {
        // The mode stays at 7 Hz, then rises to 8 Hz within 20 s, and stays there.
        let true_hz = 7.0 + ((f64::from(k) / RATE_HZ - 20.0) / 20.0).clamp(0.0, 1.0);
        let u = normal();
        let failed = (3000..3020).contains(&k);
        let z = if failed { f64::NAN } else { plant.displacement + NOISE * normal() };
        identifier.step_with_missing(&[z], &[u])?;
        plant.step(true_hz, u);

        if k % 500 == 499 {
            let (found_hz, damping) = mode(&identifier.identified())?;
            let (innovation, health) = (identifier.innovation()[0], identifier.health());
            let time = f64::from(k + 1) / RATE_HZ;
            println!(
                "{time:5.0} s  {true_hz:.2} Hz {found_hz:.2} Hz  {:.1} %  {innovation:+10.3}  {:14.1e}",
                100.0 * damping,
                health.smallest_pivot
            );
            assert!(health.smallest_pivot > 0.0, "the covariance is sound");
            assert!((found_hz / true_hz - 1.0).abs() < 0.02, "the mode is followed");
        }
    }
    let (found_hz, damping) = mode(&identifier.identified())?;
    assert!((found_hz - 8.0).abs() < 0.05 && (damping - DAMPING).abs() < 0.01, "the mode is found again at rest");
    Ok(())
}

/// Returns the frequency in Hz and the damping ratio of the identified mode.
fn mode(plant: &plid::IdentifiedModel) -> Result<(f64, f64), Box<dyn std::error::Error>> {
    let mode = modes(&plant.to_model(RATE_HZ)?)?.swap_remove(0);
    Ok((mode.hz, mode.damping))
}
