//! A user-defined effect. One type and one line make it available to the whole diagnosis.
//!
//! The sensor has a quadratic characteristic, y' = y + c y^2. The records are simulated here and diagnosed without and
//! with the effect in the vocabulary.
//!
//! ```sh
//! cargo run --release --example own_effect
//! ```

mod bent;

use bent::BentSensor;
// The names that the effect uses.
use plid::gap::effects::{Action, Effect, Flexible, Memory, Parameter, Place, Range, Sampling, Sensor, Setting, Side};

use plid::gap::case::{Case, CaseConfig, Excitation, Record, columns};
use plid::gap::diagnose;
use plid::gap::effects::Library;
use plid::model::{Model, simulate};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const RATE: f64 = 200.0;
const NOISE: f64 = 0.01;
const BENT: f64 = 0.15;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let case = case()?;
    for (vocabulary, library) in
        [("standard", Library::standard()), ("with one's own", Library::standard().with(Box::new(BentSensor)))]
    {
        let diagnosis = diagnose(&case, &library, &mut |_| {})?.diagnosis;
        println!("{vocabulary}: {}", diagnosis.sentence);
        for effect in &diagnosis.effects {
            for (name, value) in &effect.parameters {
                println!("    {name} = {:.4} {} ({:.3?})", value.value, value.unit, value.ci95.unwrap_or_default());
            }
        }
    }
    println!("true: c = {BENT}");
    Ok(())
}

/// Returns a case of one mode at 17 Hz, one input and one output, with records at rest, at full and at half level.
fn case() -> Result<Case, Box<dyn std::error::Error>> {
    let turn = nalgebra::Complex::from_polar((-0.02 * 0.534_f64).exp(), 0.534);
    let a = nalgebra::dmatrix![turn.re, -turn.im; turn.im, turn.re];
    let mut model = Model::new(
        RATE,
        a,
        nalgebra::dmatrix![0.1; 0.3],
        nalgebra::dmatrix![1.0, -0.4],
        nalgebra::DMatrix::zeros(1, 1),
    )?;
    model.noise.sensor_std = Some(vec![NOISE]);
    model.noise.actuator_std = Some(vec![0.0]);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let mut records = Vec::new();
    for (k, level) in [0.0, 1.0, 0.5, 1.0].into_iter().enumerate() {
        let u = ndarray::Array2::from_shape_simple_fn((1500, 1), || level * normal());
        let y = simulate(&model, u.view(), &model.rest())?.outputs.mapv(|y| y + BENT * y * y + NOISE * normal());
        records.push(Record {
            name: format!("record {}", k + 1),
            excitation: if level > 0.0 { Excitation::Random } else { Excitation::Zero },
            from_rest: true,
            start_s: k as f64 * 1500.0 / RATE,
            held_out: false,
            u: columns(&u),
            y: columns(&y),
            simulated: None,
        });
    }
    let config = CaseConfig::new(RATE, model.inputs.clone(), model.outputs.clone());
    Ok(Case { config, model: Some(model), records, for_simulation: Vec::new(), controller: None, warnings: Vec::new() })
}
